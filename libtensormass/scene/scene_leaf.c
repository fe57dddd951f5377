/* Reads single values of a scene: numbers with units, choices, flags, texts, paths, vectors, lists of numbers. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene_reader.h"
#include "units.h"

static tm_status in_range(const reader *r, int line, const app_field *field, const char *shown, double value) {
    if (field->min == field->max || (value >= field->min && value <= field->max)) return 0;
    const char *unit = field->unit && strcmp(field->unit, "none") ? " in SI units" : "";
    if (isinf(field->max))
        return app_scene_bad(r->scene, line, "%s = %g is below %g%s; choose at least that", shown, value, field->min,
                             unit);
    return app_scene_bad(r->scene, line, "%s = %g is outside %g to %g%s; choose a value inside", shown, value,
                         field->min, field->max, unit);
}

static tm_status quantity(const reader *r, int line, const app_field *field, const char *shown, const char *text,
                          double *si) {
    char why[256], unit[32];
    const size_t length = strcspn(field->unit, "|");
    snprintf(unit, sizeof unit, "%.*s", (int)length, field->unit);
    if (field->unit[length] && !strcmp(text, field->unit + length + 1)) { /* "rate|auto": the word means 0 */
        *si = 0;
        return 0;
    }
    if (!app_parse_quantity(text, unit, si, why, sizeof why))
        return app_scene_bad(r->scene, line, "%s: %s", shown, why);
    return in_range(r, line, field, shown, *si);
}

static tm_status integer(const reader *r, int line, const app_field *field, const char *shown, const char *text,
                         int64_t *value) {
    char *end;
    double number = strtod(text, &end);
    if (end == text || *end || number != floor(number) || fabs(number) > 9e15)
        return app_scene_bad(r->scene, line, "%s: '%.60s' is not a whole number; write one without unit", shown, text);
    *value = (int64_t)number;
    return in_range(r, line, field, shown, number);
}

static tm_status choice(const reader *r, int line, const app_field *field, const char *shown, const char *text,
                        int *index) {
    const char *at = field->unit;
    size_t n = strlen(text);
    for (int i = 0;; i++) {
        size_t length = strcspn(at, "|");
        if (length == n && !memcmp(at, text, n)) {
            *index = i;
            return 0;
        }
        if (!at[length]) break;
        at += length + 1;
    }
    char all[256];
    snprintf(all, sizeof all, "%s=%.60s", field->path, text);
    const char *now = app_scene_renamed(all);
    if (now)
        return app_scene_bad(r->scene, line, "%s: '%.60s' is called '%s' since 0.2; write '%s'", shown, text, now, now);
    snprintf(all, sizeof all, "%s", field->unit);
    for (char *c = all; *c; c++)
        if (*c == '|') *c = ' ';
    return app_scene_bad(r->scene, line, "%s: '%.60s' is not allowed; use one of: %s", shown, text, all);
}

static tm_status flag(const reader *r, int line, const char *shown, const char *text, bool *on) {
    static const char *const words[2][4] = {{"no", "false", "off", "0"}, {"yes", "true", "on", "1"}};
    for (int v = 0; v < 2; v++)
        for (int i = 0; i < 4; i++)
            if (!strcmp(text, words[v][i])) {
                *on = v;
                return 0;
            }
    return app_scene_bad(r->scene, line, "%s: '%.60s' is neither yes nor no; write yes or no", shown, text);
}

static const char *resolve_path(app_scene *scene, const char *text) {
    const char *slash = strrchr(scene->file, '/');
    if (text[0] == '/' || !slash || !*text) return app_scene_keep(scene, text);
    size_t folder = (size_t)(slash - scene->file) + 1;
    char *path = app_scene_alloc(scene, folder + strlen(text) + 1);
    memcpy(path, scene->file, folder);
    strcpy(path + folder, text);
    return path;
}

tm_status app_scene_scalar(reader *r, int line, const app_field *field, const char *shown, const char *text, void *at) {
    switch (field->kind) {
    case APP_NUMBER:
        ((app_number *)at)->line = line;
        return quantity(r, line, field, shown, text, &((app_number *)at)->si);
    case APP_INTEGER:
        ((app_integer *)at)->line = line;
        return integer(r, line, field, shown, text, &((app_integer *)at)->value);
    case APP_CHOICE:
        ((app_choice *)at)->line = line;
        return choice(r, line, field, shown, text, &((app_choice *)at)->index);
    case APP_FLAG: ((app_flag *)at)->line = line; return flag(r, line, shown, text, &((app_flag *)at)->on);
    case APP_TEXT: *(app_text *)at = (app_text){app_scene_keep(r->scene, text), line}; return 0;
    /* A relative path of --set starts from the working directory, not from the scene's folder. */
    case APP_PATH:
        *(app_text *)at = (app_text){line < 0 ? app_scene_keep(r->scene, text) : resolve_path(r->scene, text), line};
        return 0;
    case APP_SECTION:
    case APP_VECTOR:
    case APP_INTEGERS:
    case APP_LIST:
    case APP_EFFECTS:
    case APP_TABLE: break;
    }
    /* The table has a default that is invalid for its kind. */
    return app_scene_bad(r->scene, line, "%s: the default in the schema is not a valid value; correct its row", shown);
}

tm_status app_scene_vector(reader *r, yaml_node_t *node, const app_field *field, const char *shown, app_vector *out) {
    char wanted[128];
    snprintf(wanted, sizeof wanted, "three numbers, such as [0, 0, 1%s]", !strcmp(field->unit, "length") ? " mm" : "");
    if (node->type != YAML_SEQUENCE_NODE) return app_scene_bad_shape(r, node, shown, wanted);
    int count = (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    if (count != 3)
        return app_scene_bad(r->scene, app_scene_line(node), "%s has %d components; write %s", shown, count, wanted);
    for (int i = 0; i < 3; i++) {
        yaml_node_t *item = node_at(r, node->data.sequence.items.start[i]);
        if (item->type != YAML_SCALAR_NODE) return app_scene_bad_shape(r, item, shown, wanted);
        tm_status rc =
            quantity(r, app_scene_line(item), field, shown, (const char *)item->data.scalar.value, &out->v[i]);
        if (rc) return rc;
    }
    out->line = app_scene_line(node);
    return 0;
}

tm_status app_scene_integers(reader *r, yaml_node_t *node, const app_field *field, const char *shown,
                             app_integers *out) {
    bool one = node->type == YAML_SCALAR_NODE;
    if (node->type == YAML_MAPPING_NODE) return app_scene_bad_shape(r, node, shown, "a whole number or a list of them");
    int count = one ? 1 : (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    r->items += count;
    if (r->items > MAX_ITEMS)
        return app_scene_bad(r->scene, app_scene_line(node), "more than %d list items; write fewer", MAX_ITEMS);
    if (!count)
        return app_scene_bad(r->scene, app_scene_line(node),
                             "%s is an empty list; write at least one number, or leave the key out", shown);
    out->item = app_scene_alloc(r->scene, sizeof *out->item * (size_t)count);
    for (int i = 0; i < count; i++) {
        yaml_node_t *item = one ? node : node_at(r, node->data.sequence.items.start[i]);
        if (item->type != YAML_SCALAR_NODE) return app_scene_bad_shape(r, item, shown, "whole numbers");
        tm_status rc =
            integer(r, app_scene_line(item), field, shown, (const char *)item->data.scalar.value, &out->item[i]);
        if (rc) return rc;
    }
    out->count = count;
    out->line = app_scene_line(node);
    return 0;
}
