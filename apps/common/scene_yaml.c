/* Reads a YAML file through tables of fields. Knows nothing of tissue: only kinds, units, ranges and lines. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "app.h"
#include "scene_reader.h"
#include "units.h"

enum { SHOWN_MAX_CHARS = 400, MAX_ITEMS = 200000, MAX_NAMES = 1000, SCENE_MAX_BYTES = 4 << 20 };
typedef struct block {
    struct block *next;
    max_align_t data[];
} block;

void *app_scene_alloc(app_scene *scene, size_t bytes) {
    block *b = calloc(1, sizeof(block) + bytes);
    if (!b) abort(); /* a scene is kilobytes: out of memory here has no cure */
    b->next = scene->arena;
    scene->arena = b;
    return b->data;
}

static char *keep(app_scene *scene, const char *text) {
    size_t bytes = strlen(text) + 1;
    return memcpy(app_scene_alloc(scene, bytes), text, bytes);
}

void app_scene_free(app_scene *scene) {
    if (!scene) return;
    for (block *b = scene->arena; b;) {
        block *next = b->next;
        free(b);
        b = next;
    }
    free(scene);
}

void app_scene_where(const app_scene *scene, int line, char *text, size_t size) {
    if (line < 0)
        snprintf(text, size, "--set %s", scene->set[-line - 1]);
    else if (line)
        snprintf(text, size, "%s:%d", scene->file, line);
    else
        snprintf(text, size, "default");
}

int app_scene_bad(const app_scene *scene, int line, const char *format, ...) {
    char message[1024], file[512];
    va_list list;
    va_start(list, format);
    vsnprintf(message, sizeof message, format, list);
    va_end(list);
    if (line < 0)
        snprintf(file, sizeof file, "--set %s", scene->set[-line - 1]);
    else
        snprintf(file, sizeof file, "%s", scene->file);
    return app_bad_input(file, line < 0 ? 0 : line, "%s", message);
}

int app_scene_warn(const app_scene *scene, int line, const char *format, ...) {
    char message[1024];
    va_list list;
    va_start(list, format);
    vsnprintf(message, sizeof message, format, list);
    va_end(list);
    int rc = app_scene_bad(scene, line, "warning: %s", message);
    return scene->strict ? rc : APP_DONE;
}

static int line_of(const yaml_node_t *node) {
    size_t line = node->start_mark.line;
    return line >= SET_LINE ? -(int)(line - SET_LINE) - 1 : (int)line + 1;
}

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

/* The field's own key if it lies directly under `prefix`, else null. */
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

static int unknown_key(const reader *r, const app_schema *only, int line, const char *name, const char *prefix,
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
    if (name[0] >= '0' && name[0] <= '9')
        return app_scene_bad(r->scene, line,
                             "unknown key '%.60s'%s: a comma separates entries; write a decimal point, such as 5.0 kPa",
                             name, in);
    if (nearest) return app_scene_bad(r->scene, line, "unknown key '%.60s'%s; did you mean '%s'?", name, in, nearest);
    return app_scene_bad(r->scene, line, "unknown key '%.60s'%s; use one of: %s", name, in, known);
}

/* --- leaves --- */

const char *app_scene_node_kind(const yaml_node_t *node) {
    return node->type == YAML_SCALAR_NODE     ? "a single value"
           : node->type == YAML_SEQUENCE_NODE ? "a list"
                                              : "a mapping";
}

static int bad_shape(const reader *r, const yaml_node_t *node, const char *shown, const char *wanted) {
    return app_scene_bad(r->scene, line_of(node), "%s is %s; write %s", shown, app_scene_node_kind(node), wanted);
}

static int in_range(const reader *r, int line, const app_field *field, const char *shown, double value) {
    if (field->min == field->max || (value >= field->min && value <= field->max)) return 0;
    const char *unit = field->unit && strcmp(field->unit, "none") ? " in SI units" : "";
    if (isinf(field->max))
        return app_scene_bad(r->scene, line, "%s = %g is below %g%s; choose at least that", shown, value, field->min,
                             unit);
    return app_scene_bad(r->scene, line, "%s = %g is outside %g to %g%s; choose a value inside", shown, value,
                         field->min, field->max, unit);
}

static int quantity(const reader *r, int line, const app_field *field, const char *shown, const char *text,
                    double *si) {
    char why[256];
    if (!app_parse_quantity(text, field->unit, si, why, sizeof why))
        return app_scene_bad(r->scene, line, "%s: %s", shown, why);
    return in_range(r, line, field, shown, *si);
}

static int integer(const reader *r, int line, const app_field *field, const char *shown, const char *text,
                   int64_t *value) {
    char *end;
    double number = strtod(text, &end);
    if (end == text || *end || number != floor(number) || fabs(number) > 9e15)
        return app_scene_bad(r->scene, line, "%s: '%.60s' is not a whole number; write one without unit", shown, text);
    *value = (int64_t)number;
    return in_range(r, line, field, shown, number);
}

static int choice(const reader *r, int line, const app_field *field, const char *shown, const char *text, int *index) {
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
    snprintf(all, sizeof all, "%s", field->unit);
    for (char *c = all; *c; c++)
        if (*c == '|') *c = ' ';
    return app_scene_bad(r->scene, line, "%s: '%.60s' is not a choice; use one of: %s", shown, text, all);
}

static int flag(const reader *r, int line, const char *shown, const char *text, bool *on) {
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
    if (text[0] == '/' || !slash || !*text) return keep(scene, text);
    size_t folder = (size_t)(slash - scene->file) + 1;
    char *path = app_scene_alloc(scene, folder + strlen(text) + 1);
    memcpy(path, scene->file, folder);
    strcpy(path + folder, text);
    return path;
}

static int scalar(reader *r, int line, const app_field *field, const char *shown, const char *text, void *at) {
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
    case APP_TEXT: *(app_text *)at = (app_text){keep(r->scene, text), line}; return 0;
    /* A relative path of --set is the caller's, not the scene's. */
    case APP_PATH:
        *(app_text *)at = (app_text){line < 0 ? keep(r->scene, text) : resolve_path(r->scene, text), line};
        return 0;
    case APP_SECTION:
    case APP_VECTOR:
    case APP_INTEGERS:
    case APP_LIST:
    case APP_TABLE: break;
    }
    abort(); /* a table row's default that its kind cannot have */
}

static int vector(reader *r, yaml_node_t *node, const app_field *field, const char *shown, app_vector *out) {
    char wanted[128];
    snprintf(wanted, sizeof wanted, "three numbers, such as [0, 0, 1%s]", !strcmp(field->unit, "length") ? " mm" : "");
    if (node->type != YAML_SEQUENCE_NODE) return bad_shape(r, node, shown, wanted);
    int count = (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    if (count != 3)
        return app_scene_bad(r->scene, line_of(node), "%s has %d components; write %s", shown, count, wanted);
    for (int i = 0; i < 3; i++) {
        yaml_node_t *item = node_at(r, node->data.sequence.items.start[i]);
        if (item->type != YAML_SCALAR_NODE) return bad_shape(r, item, shown, wanted);
        int rc = quantity(r, line_of(item), field, shown, (const char *)item->data.scalar.value, &out->v[i]);
        if (rc) return rc;
    }
    out->line = line_of(node);
    return 0;
}

static int integers(reader *r, yaml_node_t *node, const app_field *field, const char *shown, app_integers *out) {
    bool one = node->type == YAML_SCALAR_NODE;
    if (node->type == YAML_MAPPING_NODE) return bad_shape(r, node, shown, "a whole number or a list of them");
    int count = one ? 1 : (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    r->items += count;
    if (r->items > MAX_ITEMS)
        return app_scene_bad(r->scene, line_of(node), "more than %d list items; write fewer", MAX_ITEMS);
    if (!count)
        return app_scene_bad(r->scene, line_of(node),
                             "%s is an empty list; write at least one number, or leave the key out", shown);
    out->item = app_scene_alloc(r->scene, sizeof *out->item * (size_t)count);
    for (int i = 0; i < count; i++) {
        yaml_node_t *item = one ? node : node_at(r, node->data.sequence.items.start[i]);
        if (item->type != YAML_SCALAR_NODE) return bad_shape(r, item, shown, "whole numbers");
        int rc = integer(r, line_of(item), field, shown, (const char *)item->data.scalar.value, &out->item[i]);
        if (rc) return rc;
    }
    out->count = count;
    out->line = line_of(node);
    return 0;
}

/* --- containers --- */

static int read_mapping(reader *r, const app_schema *only, yaml_node_t *node, int line, const char *prefix,
                        const char *shown, char *const *base);

bool app_scene_null(const yaml_node_t *node) {
    if (node->type != YAML_SCALAR_NODE || node->data.scalar.style != YAML_PLAIN_SCALAR_STYLE) return false;
    const char *text = (const char *)node->data.scalar.value;
    return !*text || !strcmp(text, "~") || !strcmp(text, "null");
}

static int read_list(reader *r, const app_schema *schema, yaml_node_t *node, const app_field *field, const char *shown,
                     app_list *out) {
    char prefix[PATH_MAX_CHARS], name[SHOWN_MAX_CHARS];
    if (app_scene_null(node))
        return app_scene_bad(r->scene, line_of(node),
                             "%s has nothing under it; write at least one line that begins with '- ', or leave the key "
                             "out",
                             shown);
    if (node->type != YAML_SEQUENCE_NODE) return bad_shape(r, node, shown, "a list: lines that begin with '- '");
    int count = (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    r->items += count;
    if (r->items > MAX_ITEMS)
        return app_scene_bad(r->scene, line_of(node), "more than %d list items; write fewer", MAX_ITEMS);
    *out = (app_list){app_scene_alloc(r->scene, field->size * (size_t)(count ? count : 1)), count, line_of(node)};
    snprintf(prefix, sizeof prefix, "%s[]", field->path);
    for (int i = 0; i < count; i++) {
        yaml_node_t *item = node_at(r, node->data.sequence.items.start[i]);
        char *at = (char *)out->item + field->size * (size_t)i;
        snprintf(name, sizeof name, "%.300s[%d]", shown, i);
        if (item->type != YAML_MAPPING_NODE) return bad_shape(r, item, name, "keys and values");
        ((app_section *)at)->line = line_of(item);
        int rc = read_mapping(r, schema, item, line_of(item), prefix, name, &at);
        if (rc) return rc;
    }
    return 0;
}

static int read_table(reader *r, const app_schema *schema, yaml_node_t *node, const app_field *field, const char *shown,
                      app_list *out) {
    char prefix[PATH_MAX_CHARS], name[SHOWN_MAX_CHARS];
    if (node->type != YAML_MAPPING_NODE) return bad_shape(r, node, shown, "names, each with keys and values");
    int count = (int)(node->data.mapping.pairs.top - node->data.mapping.pairs.start);
    if (count > MAX_NAMES)
        return app_scene_bad(r->scene, line_of(node), "%s has %d entries, more than %d; write fewer", shown, count,
                             MAX_NAMES);
    *out = (app_list){app_scene_alloc(r->scene, field->size * (size_t)(count ? count : 1)), count, line_of(node)};
    snprintf(prefix, sizeof prefix, "%s.*", field->path);
    for (int i = 0; i < count; i++) {
        yaml_node_pair_t *pair = node->data.mapping.pairs.start + i;
        yaml_node_t *key = node_at(r, pair->key), *value = node_at(r, pair->value);
        char *at = (char *)out->item + field->size * (size_t)i;
        if (key->type != YAML_SCALAR_NODE) return bad_shape(r, key, shown, "a name as key");
        *(app_text *)at = (app_text){keep(r->scene, (const char *)key->data.scalar.value), line_of(key)};
        for (int j = 0; j < i; j++)
            if (!strcmp(((app_text *)((char *)out->item + field->size * (size_t)j))->s, ((app_text *)at)->s))
                return app_scene_bad(r->scene, line_of(key), "'%.60s' is named twice in %s; keep one",
                                     ((app_text *)at)->s, shown);
        snprintf(name, sizeof name, "%.300s.%.60s", shown, ((app_text *)at)->s);
        if (value->type != YAML_MAPPING_NODE) return bad_shape(r, value, name, "keys and values");
        int rc = read_mapping(r, schema, value, line_of(key), prefix, name, &at);
        if (rc) return rc;
    }
    return 0;
}

static int read_value(reader *r, const app_schema *schema, yaml_node_t *key, yaml_node_t *node, const app_field *field,
                      const char *shown, char *base) {
    char *at = base + field->offset;
    switch (field->kind) {
    case APP_SECTION:
        if (!app_scene_null(node) && node->type != YAML_MAPPING_NODE)
            return bad_shape(r, node, shown, "keys and values under it, or nothing");
        ((app_section *)at)->line = line_of(key);
        return read_mapping(r, schema, app_scene_null(node) ? NULL : node, line_of(key), field->path, shown, &base);
    case APP_VECTOR: return vector(r, node, field, shown, (app_vector *)at);
    case APP_INTEGERS: return integers(r, node, field, shown, (app_integers *)at);
    case APP_LIST: return read_list(r, schema, node, field, shown, (app_list *)at);
    case APP_TABLE: return read_table(r, schema, node, field, shown, (app_list *)at);
    case APP_NUMBER:
    case APP_INTEGER:
    case APP_TEXT:
    case APP_PATH:
    case APP_CHOICE:
    case APP_FLAG: break;
    }
    if (node->type != YAML_SCALAR_NODE) return bad_shape(r, node, shown, "a single value");
    if (app_scene_null(node))
        return app_scene_bad(r->scene, line_of(key), "%s has no value; write one, or leave the key out", shown);
    return scalar(r, line_of(node), field, shown, (const char *)node->data.scalar.value, at);
}

/* Values of fields that a scene leaves out. Lists stay empty; sections that are not there get their members' defaults.
 */
static int default_value(reader *r, const app_schema *schema, const app_field *field, char *base) {
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
            abort();
        return 0;
    case APP_TEXT:
    case APP_PATH: *(app_text *)at = (app_text){text ? text : "", 0}; return 0;
    case APP_LIST:
    case APP_TABLE:
    case APP_INTEGERS: return 0;
    case APP_NUMBER:
    case APP_INTEGER:
    case APP_CHOICE:
    case APP_FLAG: break;
    }
    return text ? scalar(r, 0, field, field->path, text, at) : 0;
}

/* `only` null: the top level, where every schema has its own base. */
static int read_mapping(reader *r, const app_schema *only, yaml_node_t *node, int line, const char *prefix,
                        const char *shown, char *const *base) {
    char name[SHOWN_MAX_CHARS];
    yaml_node_pair_t *begin = node ? node->data.mapping.pairs.start : NULL,
                     *end = node ? node->data.mapping.pairs.top : NULL;
    for (yaml_node_pair_t *pair = begin; pair != end; pair++) {
        yaml_node_t *key = node_at(r, pair->key);
        if (key->type != YAML_SCALAR_NODE) return bad_shape(r, key, *shown ? shown : "the scene", "a word as key");
        const char *text = (const char *)key->data.scalar.value;
        for (yaml_node_pair_t *other = begin; other != pair; other++) {
            yaml_node_t *before = node_at(r, other->key);
            if (before->type == YAML_SCALAR_NODE && !strcmp((const char *)before->data.scalar.value, text))
                return app_scene_bad(r->scene, line_of(key), "key '%.60s' is already given on line %d; keep one", text,
                                     line_of(before));
        }
        const app_field *field = NULL;
        int s = 0;
        for (; s < r->schema_count && !field; s++)
            if (!only || r->schema[s] == only) field = find_field(r->schema[s], prefix, text);
        if (!field) return unknown_key(r, only, line_of(key), text, prefix, shown);
        snprintf(name, sizeof name, "%.300s%s%.90s", shown, *shown ? "." : "", text);
        int rc = read_value(r, r->schema[s - 1], key, node_at(r, pair->value), field, name, base[only ? 0 : s - 1]);
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
            int rc = default_value(r, r->schema[s], field, base[only ? 0 : s]);
            if (rc) return rc;
        }
    }
    return 0;
}

/* --- the file --- */

static int not_yaml(const app_scene *scene, const yaml_parser_t *parser, const char *text, size_t size) {
    return app_bad_input(scene->file, (int)parser->problem_mark.line + 1, "not YAML: %s%s%s; %s",
                         parser->problem ? parser->problem : "unreadable", parser->context ? " " : "",
                         parser->context ? parser->context : "",
                         app_scene_yaml_remedy(text, size, parser->problem_mark.line, parser->problem));
}

static int load_document(reader *r, const char *text, size_t size) {
    app_scene *scene = r->scene;
    yaml_parser_t parser;
    yaml_document_t second;
    int rc = app_scene_check_limits(scene, text, size);
    if (rc) return rc;
    yaml_parser_initialize(&parser);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, &r->document)) {
        rc = not_yaml(scene, &parser, text, size);
        yaml_parser_delete(&parser);
        return rc;
    }
    yaml_node_t *root = yaml_document_get_root_node(&r->document);
    if (!root)
        rc = app_bad_input(scene->file, 1, "the scene is empty; begin with 'tissue:' (docs/scene-reference.md)");
    else if (root->type != YAML_MAPPING_NODE)
        rc = app_bad_input(scene->file, line_of(root), "the scene is %s; write keys and values, such as 'tissue:'",
                           app_scene_node_kind(root));
    else if (yaml_parser_load(&parser, &second)) {
        if (yaml_document_get_root_node(&second))
            rc = app_bad_input(scene->file, (int)second.start_mark.line + 1,
                               "a second document begins here; keep one scene a file");
        yaml_document_delete(&second);
    } else
        rc = not_yaml(scene, &parser, text, size);
    yaml_parser_delete(&parser);
    if (rc) yaml_document_delete(&r->document);
    return rc;
}

/* The whole file, to be freed. */
static int read_scene(const char *path, char **text, size_t *size) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    *text = NULL;
    if (!file) return app_bad_input(path, 0, "cannot be read: %m; give the path of a scene file");
    int rc = 0;
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode))
        rc = app_bad_input(path, 0, "is not a regular file; give the path of a scene file");
    else if (info.st_size > SCENE_MAX_BYTES)
        rc = app_bad_input(path, 0, "is larger than a scene may be (4 MB); give a scene, not a mesh");
    else if (!(*text = malloc((size_t)info.st_size + 1)))
        rc = app_bad_input(path, 0, "out of memory; close other programs");
    else
        *size = fread(*text, 1, (size_t)info.st_size, file);
    if (!rc && ferror(file)) rc = app_bad_input(path, 0, "cannot be read: %m; check the disk");
    fclose(file);
    return rc;
}

int app_scene_load(const char *file, char *const *set, int set_count, const app_schema *effect, int effect_count,
                   app_scene **out) {
    char *text;
    size_t size = 0;
    int rc = read_scene(file, &text, &size);
    if (rc) {
        free(text);
        return rc;
    }
    app_scene *scene = calloc(1, sizeof *scene);
    if (!scene) abort();
    scene->file = keep(scene, file);
    scene->set_count = set_count;
    scene->set = app_scene_alloc(scene, sizeof *scene->set * (size_t)(set_count + 1));
    for (int i = 0; i < set_count; i++) scene->set[i] = keep(scene, set[i]);
    scene->effect_count = effect_count;
    scene->effect = app_scene_alloc(scene, sizeof *scene->effect * (size_t)(effect_count + 1));
    reader r = {.scene = scene, .schema_count = effect_count + 1};
    char *base[sizeof r.schema / sizeof r.schema[0]] = {(char *)scene};
    if (r.schema_count > (int)(sizeof base / sizeof base[0])) abort();
    r.schema[0] = &app_scene_schema;
    for (int i = 0; i < effect_count; i++) {
        r.schema[i + 1] = &effect[i];
        base[i + 1] = scene->effect[i] = app_scene_alloc(scene, effect[i].size);
    }
    rc = load_document(&r, text, size);
    free(text);
    if (!rc) {
        for (int i = 0; i < set_count && !rc; i++) rc = app_scene_apply_set(&r, i);
        if (!rc) rc = read_mapping(&r, NULL, node_at(&r, 1), 1, "", "", base);
        yaml_document_delete(&r.document);
    }
    if (rc)
        app_scene_free(scene);
    else
        *out = scene;
    return rc;
}
