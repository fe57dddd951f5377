/* Reads mappings, lists and tables of a YAML document into structs, by tables of fields. Depends only on kinds, keys
 * and lines, not on tissue. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene_reader.h"

enum { SHOWN_MAX_CHARS = 400, MAX_NAMES = 1000 };

/* --- names --- */

static int edit_distance(const char *a, const char *b) {
    enum { LONGEST = 48 };
    int n = (int)strlen(a), m = (int)strlen(b), row[LONGEST + 1];
    if (n > LONGEST || m > LONGEST) return LONGEST;
    for (int j = 0; j <= m; j++) row[j] = j;
    for (int i = 1; i <= n; i++) {
        int diagonal = row[0];
        row[0] = i;
        for (int j = 1; j <= m; j++) {
            int best = diagonal + (a[i - 1] != b[j - 1]);
            if (row[j] + 1 < best) best = row[j] + 1;
            if (row[j - 1] + 1 < best) best = row[j - 1] + 1;
            diagonal = row[j];
            row[j] = best;
        }
    }
    return row[m];
}

/* Returns the field's own key if it is directly under `prefix`, else null. */
static const char *child_key(const app_field *field, const char *prefix) {
    size_t n = strlen(prefix);
    if (strncmp(field->path, prefix, n)) return NULL;
    const char *key = field->path + n;
    if (n) {
        if (*key != '.') return NULL;
        key++;
    }
    return *key && !strpbrk(key, ".[") ? key : NULL;
}

static const app_field *find_field(const app_schema *schema, const char *prefix, const char *name) {
    for (int i = 0; i < schema->count; i++) {
        const char *key = child_key(&schema->field[i], prefix);
        if (key && !strcmp(key, name)) return &schema->field[i];
    }
    return NULL;
}

static tm_status unknown_key(const reader *r, const app_schema *only, int line, const char *name, const char *prefix,
                             const char *shown) {
    char known[512] = "", in[PATH_MAX_CHARS + 8] = "";
    const char *nearest = NULL;
    int distance = 1 + (int)strlen(name) / 3;
    size_t used = 0;
    if (*shown) snprintf(in, sizeof in, " in %s", shown);
    for (int s = 0; s < r->schema_count; s++) {
        const app_schema *schema = r->schema[s];
        if (only && schema != only) continue;
        for (int i = 0; i < schema->count; i++) {
            const char *key = child_key(&schema->field[i], prefix);
            if (!key) continue;
            int d = edit_distance(name, key);
            if (d <= distance && (!nearest || d < distance)) {
                distance = d;
                nearest = key;
            }
            if (used < sizeof known)
                used += (size_t)snprintf(known + used, sizeof known - used, "%s%s", used ? ", " : "", key);
        }
    }
    char path[PATH_MAX_CHARS + 64];
    snprintf(path, sizeof path, "%s%s%.60s", prefix, *prefix ? "." : "", name);
    const char *now = app_scene_renamed(path);
    if (now) return app_scene_bad(r->scene, line, "'%.60s' is called '%s' since 0.2; write '%s'", name, now, now);
    if (name[0] >= '0' && name[0] <= '9')
        return app_scene_bad(
            r->scene, line,
            "unknown key '%.60s'%s, as a comma separates entries; write a decimal point, such as 5.0 kPa", name, in);
    if (nearest) return app_scene_bad(r->scene, line, "unknown key '%.60s'%s; did you mean '%s'?", name, in, nearest);
    return app_scene_bad(r->scene, line, "unknown key '%.60s'%s; use one of: %s", name, in, known);
}

/* --- containers --- */

static tm_status read_list(reader *r, const app_schema *schema, yaml_node_t *node, const app_field *field,
                           const char *shown, app_list *out) {
    char prefix[PATH_MAX_CHARS], name[SHOWN_MAX_CHARS];
    if (app_scene_null(node))
        return app_scene_bad(r->scene, app_scene_line(node),
                             "%s has nothing under it; write at least one line that begins with '- ', or leave the key "
                             "out",
                             shown);
    if (node->type != YAML_SEQUENCE_NODE)
        return app_scene_bad_shape(r, node, shown, "a list: lines that begin with '- '");
    int count = (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    r->items += count;
    if (r->items > MAX_ITEMS)
        return app_scene_bad(r->scene, app_scene_line(node), "more than %d list items; write fewer", MAX_ITEMS);
    *out =
        (app_list){app_scene_alloc(r->scene, field->size * (size_t)(count ? count : 1)), count, app_scene_line(node)};
    snprintf(prefix, sizeof prefix, "%s[]", field->path);
    for (int i = 0; i < count; i++) {
        yaml_node_t *item = node_at(r, node->data.sequence.items.start[i]);
        char *at = (char *)out->item + field->size * (size_t)i;
        snprintf(name, sizeof name, "%.300s[%d]", shown, i);
        if (item->type != YAML_MAPPING_NODE) return app_scene_bad_shape(r, item, name, "keys and values");
        ((app_section *)at)->line = app_scene_line(item);
        tm_status rc = app_scene_read_mapping(r, schema, item, app_scene_line(item), prefix, name, &at);
        if (rc) return rc;
    }
    return 0;
}

static tm_status read_table(reader *r, const app_schema *schema, yaml_node_t *node, const app_field *field,
                            const char *shown, app_list *out) {
    char prefix[PATH_MAX_CHARS], name[SHOWN_MAX_CHARS];
    if (node->type != YAML_MAPPING_NODE) return app_scene_bad_shape(r, node, shown, "names, each with keys and values");
    int count = (int)(node->data.mapping.pairs.top - node->data.mapping.pairs.start);
    if (count > MAX_NAMES)
        return app_scene_bad(r->scene, app_scene_line(node), "%s has %d entries, more than %d; write fewer", shown,
                             count, MAX_NAMES);
    *out =
        (app_list){app_scene_alloc(r->scene, field->size * (size_t)(count ? count : 1)), count, app_scene_line(node)};
    snprintf(prefix, sizeof prefix, "%s.*", field->path);
    for (int i = 0; i < count; i++) {
        yaml_node_pair_t *pair = node->data.mapping.pairs.start + i;
        yaml_node_t *key = node_at(r, pair->key), *value = node_at(r, pair->value);
        char *at = (char *)out->item + field->size * (size_t)i;
        if (key->type != YAML_SCALAR_NODE) return app_scene_bad_shape(r, key, shown, "a name as key");
        *(app_text *)at =
            (app_text){app_scene_keep(r->scene, (const char *)key->data.scalar.value), app_scene_line(key)};
        for (int j = 0; j < i; j++)
            if (!strcmp(((app_text *)((char *)out->item + field->size * (size_t)j))->s, ((app_text *)at)->s))
                return app_scene_bad(r->scene, app_scene_line(key), "'%.60s' is named twice in %s; keep one",
                                     ((app_text *)at)->s, shown);
        snprintf(name, sizeof name, "%.300s.%.60s", shown, ((app_text *)at)->s);
        if (value->type != YAML_MAPPING_NODE) return app_scene_bad_shape(r, value, name, "keys and values");
        tm_status rc = app_scene_read_mapping(r, schema, value, app_scene_line(key), prefix, name, &at);
        if (rc) return rc;
    }
    return 0;
}

/* Reads effects with their own schemas, as the top level does. */
static tm_status read_effects(reader *r, yaml_node_t *key, yaml_node_t *node, const char *shown,
                              app_body_effects *out) {
    char *base[SCHEMAS_MAX];
    if (!app_scene_null(node) && node->type != YAML_MAPPING_NODE)
        return app_scene_bad_shape(r, node, shown, "effects, each with its keys");
    reader effects = *r; /* without the scene's own fields */
    effects.schema_count = r->schema_count - 1;
    memcpy(effects.schema, r->schema + 1, sizeof *r->schema * (size_t)effects.schema_count);
    out->line = app_scene_line(key);
    out->options = app_scene_alloc(r->scene, sizeof *out->options * (size_t)(effects.schema_count + 1));
    for (int i = 0; i < effects.schema_count; i++)
        base[i] = out->options[i] = app_scene_alloc(r->scene, effects.schema[i]->size);
    const tm_status rc =
        app_scene_read_mapping(&effects, NULL, app_scene_null(node) ? NULL : node, out->line, "", shown, base);
    r->items = effects.items;
    return rc;
}

static tm_status read_value(reader *r, const app_schema *schema, yaml_node_t *key, yaml_node_t *node,
                            const app_field *field, const char *shown, char *base) {
    char *at = base + field->offset;
    switch (field->kind) {
    case APP_SECTION:
        if (!app_scene_null(node) && node->type != YAML_MAPPING_NODE)
            return app_scene_bad_shape(r, node, shown, "keys and values under it, or nothing");
        ((app_section *)at)->line = app_scene_line(key);
        return app_scene_read_mapping(r, schema, app_scene_null(node) ? NULL : node, app_scene_line(key), field->path,
                                      shown, &base);
    case APP_VECTOR: return app_scene_vector(r, node, field, shown, (app_vector *)at);
    case APP_INTEGERS: return app_scene_integers(r, node, field, shown, (app_integers *)at);
    case APP_LIST: return read_list(r, schema, node, field, shown, (app_list *)at);
    case APP_EFFECTS: return read_effects(r, key, node, shown, (app_body_effects *)at);
    case APP_TABLE: return read_table(r, schema, node, field, shown, (app_list *)at);
    case APP_NUMBER:
    case APP_INTEGER:
    case APP_TEXT:
    case APP_PATH:
    case APP_CHOICE:
    case APP_FLAG: break;
    }
    if (node->type != YAML_SCALAR_NODE) return app_scene_bad_shape(r, node, shown, "a single value");
    if (app_scene_null(node))
        return app_scene_bad(r->scene, app_scene_line(key), "%s has no value; write one, or leave the key out", shown);
    return app_scene_scalar(r, app_scene_line(node), field, shown, (const char *)node->data.scalar.value, at);
}

/* Sets a field that the scene omits to its default. Lists stay empty; missing sections get their members' defaults. */
static tm_status default_value(reader *r, const app_schema *schema, const app_field *field, char *base) {
    char *at = base + field->offset;
    const char *text = field->fallback && strcmp(field->fallback, "!") ? field->fallback : NULL;
    switch (field->kind) {
    case APP_SECTION:
        for (int i = 0; i < schema->count; i++)
            if (child_key(&schema->field[i], field->path)) default_value(r, schema, &schema->field[i], base);
        return 0;
    case APP_VECTOR:
        if (text && sscanf(text, "[%lf, %lf, %lf]", &((app_vector *)at)->v[0], &((app_vector *)at)->v[1],
                           &((app_vector *)at)->v[2]) != 3)
            return app_scene_bad(r->scene, 0, "%s: the default in the schema is not a vector; correct its row",
                                 field->path);
        return 0;
    case APP_TEXT:
    case APP_PATH: *(app_text *)at = (app_text){text ? text : "", 0}; return 0;
    case APP_LIST:
    case APP_TABLE:
    case APP_EFFECTS:
    case APP_INTEGERS: return 0;
    case APP_NUMBER:
    case APP_INTEGER:
    case APP_CHOICE:
    case APP_FLAG: break;
    }
    return text ? app_scene_scalar(r, 0, field, field->path, text, at) : 0;
}

static tm_status given_twice(reader *r, const yaml_node_t *key, const yaml_node_t *before) {
    char where[600];
    app_scene_where(r->scene, app_scene_line(before), where, sizeof where);
    return app_scene_bad(r->scene, app_scene_line(key), "key '%.60s' is already given (%s); keep one",
                         (const char *)key->data.scalar.value, where);
}

tm_status app_scene_read_mapping(reader *r, const app_schema *only, yaml_node_t *node, int line, const char *prefix,
                                 const char *shown, char *const *base) {
    char name[SHOWN_MAX_CHARS];
    yaml_node_pair_t *begin = node ? node->data.mapping.pairs.start : NULL,
                     *end = node ? node->data.mapping.pairs.top : NULL;
    for (yaml_node_pair_t *pair = begin; pair != end; pair++) {
        yaml_node_t *key = node_at(r, pair->key);
        if (key->type != YAML_SCALAR_NODE)
            return app_scene_bad_shape(r, key, *shown ? shown : "the scene", "a word as key");
        const char *text = (const char *)key->data.scalar.value;
        for (yaml_node_pair_t *other = begin; other != pair; other++) {
            yaml_node_t *before = node_at(r, other->key);
            if (before->type == YAML_SCALAR_NODE && !strcmp((const char *)before->data.scalar.value, text))
                return given_twice(r, key, before);
        }
        const app_field *field = NULL;
        int s = 0;
        for (; s < r->schema_count && !field; s++)
            if (!only || r->schema[s] == only) field = find_field(r->schema[s], prefix, text);
        if (!field) return unknown_key(r, only, app_scene_line(key), text, prefix, shown);
        snprintf(name, sizeof name, "%.300s%s%.90s", shown, *shown ? "." : "", text);
        tm_status rc =
            read_value(r, r->schema[s - 1], key, node_at(r, pair->value), field, name, base[only ? 0 : s - 1]);
        if (rc) return rc;
    }
    for (int s = 0; s < r->schema_count; s++) {
        if (only && r->schema[s] != only) continue;
        for (int i = 0; i < r->schema[s]->count; i++) {
            const app_field *field = &r->schema[s]->field[i];
            const char *key = child_key(field, prefix);
            bool given = false;
            if (!key) continue;
            for (yaml_node_pair_t *pair = begin; pair != end && !given; pair++)
                given = !strcmp((const char *)node_at(r, pair->key)->data.scalar.value, key);
            if (given) continue;
            if (field->fallback && !strcmp(field->fallback, "!"))
                return app_scene_bad(r->scene, line, "%s%skey '%s' is missing; add it: %s", shown, *shown ? ": " : "",
                                     key, field->doc);
            tm_status rc = default_value(r, r->schema[s], field, base[only ? 0 : s]);
            if (rc) return rc;
        }
    }
    return 0;
}
