/* Changes keys of a scene and keeps its other lines and comments. The parser gives the bounds of a value in the text;
 * the text is parsed again after each change. Changes have the syntax of --set ("tissue.mesh=a.msh",
 * "supports[0].vertex"). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

#include "study.h"

typedef struct text {
    char *whole;
    yaml_document_t document;
} text;

/* Converts a mark to bytes: marks count characters. */
static size_t byte_at(const text *t, size_t character) {
    size_t at = 0;
    for (; t->whole[at]; at++)
        if (((unsigned char)t->whole[at] & 0xc0) != 0x80 && character-- == 0) break;
    return at;
}

static bool parse(text *t) {
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser)) return false;
    yaml_parser_set_input_string(&parser, (const unsigned char *)t->whole, strlen(t->whole));
    const bool good = yaml_parser_load(&parser, &t->document) != 0;
    yaml_parser_delete(&parser);
    return good;
}

static bool read_text(text *t, const char *path) {
    size_t room = 0;
    FILE *file = fopen(path, "r");
    *t = (text){NULL};
    const bool good = file && getdelim(&t->whole, &room, 0, file) > 0 && parse(t);
    if (file) fclose(file);
    if (!good) free(t->whole);
    return good;
}

/* Replaces the bytes from `from` to before `to`. */
static bool replace(text *t, size_t from, size_t to, const char *words) {
    char *whole = NULL;
    if (asprintf(&whole, "%.*s%s%s", (int)from, t->whole, words, t->whole + to) < 0) return false;
    free(t->whole);
    yaml_document_delete(&t->document);
    t->whole = whole;
    return parse(t);
}

static yaml_node_t *node(text *t, int id) { return yaml_document_get_node(&t->document, id); }

static bool is_flow(const yaml_node_t *n) { return n->data.mapping.style == YAML_FLOW_MAPPING_STYLE; }

/* Returns the end of a value's text; the parser ends a block only at the next token. */
static size_t end_of(text *t, const yaml_node_t *n) {
    if (n->type == YAML_MAPPING_NODE && !is_flow(n) && n->data.mapping.pairs.top > n->data.mapping.pairs.start)
        return end_of(t, node(t, n->data.mapping.pairs.top[-1].value));
    if (n->type == YAML_SEQUENCE_NODE && n->data.sequence.style != YAML_FLOW_SEQUENCE_STYLE &&
        n->data.sequence.items.top > n->data.sequence.items.start)
        return end_of(t, node(t, n->data.sequence.items.top[-1]));
    return byte_at(t, n->end_mark.index);
}

static size_t start_of(text *t, int id) { return byte_at(t, node(t, id)->start_mark.index); }

static yaml_node_pair_t *find(text *t, const yaml_node_t *in, const char *key) {
    if (!in || in->type != YAML_MAPPING_NODE) return NULL;
    for (yaml_node_pair_t *p = in->data.mapping.pairs.start; p < in->data.mapping.pairs.top; p++)
        if (!strcmp((const char *)node(t, p->key)->data.scalar.value, key)) return p;
    return NULL;
}

/* Descends from the root as far as the path exists; `in` is then the node that has, or would have, the rest. */
static yaml_node_pair_t *walk(text *t, char **path, yaml_node_t **in) {
    *in = yaml_document_get_root_node(&t->document);
    for (;;) {
        char key[80], *rest = *path + strcspn(*path, ".[");
        snprintf(key, sizeof key, "%.*s", (int)(rest - *path), *path);
        yaml_node_pair_t *pair = find(t, *in, key);
        if (!pair || !*rest) return pair;
        yaml_node_t *value = node(t, pair->value);
        if (*rest == '[') {
            const long item = strtol(rest + 1, &rest, 10);
            const bool there = value->type == YAML_SEQUENCE_NODE && item >= 0 &&
                               item < value->data.sequence.items.top - value->data.sequence.items.start;
            *in = value = there ? node(t, value->data.sequence.items.start[item]) : NULL;
            if (!value || value->type != YAML_MAPPING_NODE) return NULL;
            rest += *rest == ']';
        }
        if (value->type != YAML_MAPPING_NODE) return pair; /* "gravity:" without a value */
        *in = value, *path = rest + (*rest == '.');
    }
}

/* Nests a path as one key's value: "a.b.c", 1 gives "{b: {c: 1}}". */
static void wrap(const char *path, const char *value, char *out, size_t size) {
    const char *dot = strchr(path, '.');
    char inner[4096];
    if (!dot) {
        snprintf(out, size, "%s: %s", path, value);
        return;
    }
    wrap(dot + 1, value, inner, sizeof inner);
    snprintf(out, size, "%.*s: {%s}", (int)(dot - path), path, inner);
}

static bool set(text *t, char *path, const char *value) {
    yaml_node_t *in;
    char words[4200], line[4300];
    const yaml_node_pair_t *pair = walk(t, &path, &in);
    if (pair) {
        const size_t from = start_of(t, pair->value);
        const char *dot = strchr(path, '.');
        wrap(dot ? dot + 1 : path, value, words, sizeof words);
        snprintf(line, sizeof line, dot ? "%s{%s}" : "%s%s", from && t->whole[from - 1] == ':' ? " " : "",
                 dot ? words : value);
        return replace(t, from, end_of(t, node(t, pair->value)), line);
    }
    if (!in || in->type != YAML_MAPPING_NODE || strchr(path, '[')) return false;
    wrap(path, value, words, sizeof words);
    const yaml_node_pair_t *first = in->data.mapping.pairs.start;
    const bool empty = first == in->data.mapping.pairs.top;
    if (is_flow(in)) {
        snprintf(line, sizeof line, "%s%s", words, empty ? "" : ", ");
        const size_t at = byte_at(t, in->start_mark.index) + 1;
        return replace(t, at, at, line);
    }
    const size_t end = strlen(t->whole), at = start_of(t, first->key);
    if (in == yaml_document_get_root_node(&t->document)) {
        snprintf(line, sizeof line, "%s%s\n", end && t->whole[end - 1] != '\n' ? "\n" : "", words);
        return replace(t, end, end, line);
    }
    snprintf(line, sizeof line, "%s\n%*s", words, (int)node(t, first->key)->start_mark.column, "");
    return replace(t, at, at, line);
}

/* Turns a section into a comment. */
static bool leave_out(text *t, size_t from, size_t to) {
    bool good = true;
    for (size_t at = to; good && at-- > from;)
        if (at == from || t->whole[at - 1] == '\n') {
            char *whole = NULL;
            good = asprintf(&whole, "%.*s# left out: %s", (int)at, t->whole, t->whole + at) >= 0;
            if (good) free(t->whole), t->whole = whole;
        }
    return good && replace(t, 0, 0, "");
}

static bool unset(text *t, char *path) {
    yaml_node_t *in;
    const yaml_node_pair_t *pair = walk(t, &path, &in);
    if (!pair || strchr(path, '.')) return in && in->type == YAML_MAPPING_NODE; /* it is absent */
    const yaml_node_pair_t *begin = in->data.mapping.pairs.start, *end = in->data.mapping.pairs.top;
    const size_t from = start_of(t, pair->key), to = end_of(t, node(t, pair->value));
    if (in == yaml_document_get_root_node(&t->document) && !is_flow(in)) return leave_out(t, from, to);
    if (pair + 1 < end) return replace(t, from, start_of(t, pair[1].key), "");
    if (pair > begin) return replace(t, end_of(t, node(t, pair[-1].value)), to, "");
    return replace(t, from, to, is_flow(in) ? "" : "{}");
}

static bool change(text *t, const char *edit) {
    char path[200];
    const char *value = strchr(edit, '=');
    snprintf(path, sizeof path, "%.*s", value ? (int)(value - edit) : 199, edit);
    return value ? set(t, path, value + 1) : unset(t, path);
}

/* Writes `file` relative to the folder `from`. Both are absolute; `from` has no slash at its end. */
static void write_relative(const char *file, const char *from, char *out, size_t size) {
    size_t shared = 0, used = 0;
    for (size_t i = 0; file[i] == from[i] || (file[i] == '/' && !from[i]); i++) {
        if (file[i] == '/') shared = i + 1; /* common prefix, up to a slash */
        if (!from[i]) break;
    }
    out[0] = 0;
    for (const char *c = from + shared - (shared > strlen(from)); *c; c += strcspn(c, "/"), c += *c == '/')
        used += (size_t)snprintf(out + used, used < size ? size - used : 0, "../");
    snprintf(out + used, used < size ? size - used : 0, "%s", file + shared);
}

/* Computes the absolute folder of `path`. */
static bool find_folder(const char *path, char folder[4096]) {
    char name[2048];
    snprintf(name, sizeof name, "%.2000s", path);
    char *slash = strrchr(name, '/');
    if (slash) slash[slash == name] = 0;
    return realpath(slash ? name : ".", folder) != NULL;
}

/* Applies a change whose value is a file's absolute name, relative to the written scene's folder. */
static bool change_moved(text *t, const char *edit, const char *to) {
    char folder[4096], file[4096], moved[4300];
    const char *value = strchr(edit, '=');
    if (!value || value[1] != '/' || !find_folder(to, folder)) return change(t, edit);
    write_relative(value + 1, folder, file, sizeof file);
    snprintf(moved, sizeof moved, "%.*s=%s", (int)(value - edit), edit, file);
    return change(t, moved);
}

/* Adapts a path: paths are relative to the scene's folder, and the written scene may be in another. */
static void move_path(text *t, const char *scene, const char *to, const char *key) {
    char path[96], *rest = path, file[4096], found[4096], edit[4200];
    yaml_node_t *in;
    snprintf(path, sizeof path, "%s", key);
    const yaml_node_pair_t *pair = walk(t, &rest, &in);
    if (!pair || strchr(rest, '.') || node(t, pair->value)->type != YAML_SCALAR_NODE) return;
    const char *name = (const char *)node(t, pair->value)->data.scalar.value, *slash = strrchr(scene, '/');
    snprintf(file, sizeof file, "%.*s%s", *name == '/' || !slash ? 0 : (int)(slash + 1 - scene), scene, name);
    if (!realpath(file, found)) return;
    snprintf(edit, sizeof edit, "%s=%s", key, found);
    change_moved(t, edit, to);
}

/* Adapts the paths of the bodies' meshes. The text is parsed again after each change, so bodies are found by number. */
static void move_bodies(text *t, const char *scene, const char *to) {
    for (int i = 0;; i++) {
        char path[] = "bodies", *rest = path, key[96];
        yaml_node_t *in;
        const yaml_node_pair_t *pair = walk(t, &rest, &in);
        const yaml_node_t *bodies = pair && !strchr(rest, '.') ? node(t, pair->value) : NULL;
        if (!bodies || bodies->type != YAML_MAPPING_NODE) return;
        if (bodies->data.mapping.pairs.top - bodies->data.mapping.pairs.start <= i) return;
        const yaml_node_t *name = node(t, bodies->data.mapping.pairs.start[i].key);
        if (name->type != YAML_SCALAR_NODE) return;
        snprintf(key, sizeof key, "bodies.%.60s.mesh", (const char *)name->data.scalar.value);
        move_path(t, scene, to, key);
    }
}

int study_write_yaml(const study *t, const char *path, char *const *edit, int edit_count, const char *evidence) {
    static const char *const files[] = {"tissue.mesh", "anisotropy.file", "haptics.profile"};
    text scene;
    tm_error error = {0};
    app_output output;
    if (!read_text(&scene, t->file)) return app_bad_input(t->file, 0, "cannot be read again; leave it as it is");
    for (int i = 0; i < 3; i++) move_path(&scene, t->file, path, files[i]);
    move_bodies(&scene, t->file, path);
    for (int i = 0; i < edit_count; i++)
        if (!change_moved(&scene, edit[i], path))
            app_remark("tm-accuracy: --set %s cannot be written into %s; give it to tm-sim again", edit[i], path);
    const bool begun = app_output_begin(&output, path, &error);
    FILE *file = begun ? app_output_stream(&output) : NULL;
    if (file) fprintf(file, "%s%s", evidence, scene.whole);
    yaml_document_delete(&scene.document);
    free(scene.whole);
    return begun && app_output_end(&output, file, &error) ? 0 : app_report(NULL, 0, &error);
}
