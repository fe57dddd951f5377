/* Internals of the scene's reader, bottom up: memory and faults (scene_base.c), single values (scene_leaf.c), fields
 * into structs (scene_yaml.c), --set on the document (scene_set.c), the file (scene_file.c). */
#ifndef TM_SCENE_READER_H
#define TM_SCENE_READER_H

#include <yaml.h>

#include "scene.h"

enum { SCHEMAS_MAX = 64, PATH_MAX_CHARS = 256, MAX_ITEMS = 200000 };
/* Line of nodes made by --set: above any line of a scene. */
#define SET_LINE 0x40000000u

typedef struct reader {
    app_scene *scene;
    yaml_document_t document;
    bool loaded; /* `document` must be deleted */
    const app_schema *schema[SCHEMAS_MAX];
    int schema_count;
    int items; /* total over all lists: aliases could multiply them */
} reader;

static inline yaml_node_t *node_at(reader *r, int index) { return yaml_document_get_node(&r->document, index); }

/* Returns the name since 0.2 of a key (its full path) or choice (path=choice); null: unchanged. */
const char *app_scene_renamed(const char *path);
char *app_scene_keep(app_scene *scene, const char *text);
/* Returns the line as app_scene_bad counts it: from 1 in the file, below 0 in --set. */
int app_scene_line(const yaml_node_t *node);
tm_status app_scene_bad_shape(const reader *r, const yaml_node_t *node, const char *shown, const char *wanted);
/* Returns "a single value", "a list" or "a mapping". */
const char *app_scene_node_kind(const yaml_node_t *node);
/* Returns whether the value is missing: "key:", "~" or "null". */
bool app_scene_null(const yaml_node_t *node);

/* Reads one value into the struct of its kind at `at`; faults call it `shown`. Returns 0 or a status, as all functions
 * below. */
tm_status app_scene_scalar(reader *r, int line, const app_field *field, const char *shown, const char *text, void *at);
tm_status app_scene_vector(reader *r, yaml_node_t *node, const app_field *field, const char *shown, app_vector *out);
tm_status app_scene_integers(reader *r, yaml_node_t *node, const app_field *field, const char *shown,
                             app_integers *out);
/* Reads keys under `prefix` into the structs at `base`. A null `only` is the top level, where each schema has its own
 * base. */
tm_status app_scene_read_mapping(reader *r, const app_schema *only, yaml_node_t *node, int line, const char *prefix,
                                 const char *shown, char *const *base);

/* Sets one "a.b[0].c=value" in the document, or removes "a.b" from it. Missing keys on the path are created; list items
 * must exist. Returns 0, or a status after adding a fault. */
tm_status app_scene_apply_set(reader *r, int set);

#endif
