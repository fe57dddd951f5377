/* Inside the scene's reader, from the ground up: memory and complaints (scene_base.c), single values (scene_leaf.c),
 * fields into structs (scene_yaml.c), --set over the document (scene_set.c), the file (scene_file.c). */
#ifndef TM_SCENE_READER_H
#define TM_SCENE_READER_H

#include <yaml.h>

#include "scene.h"

enum { SCHEMAS_MAX = 64, PATH_MAX_CHARS = 256, MAX_ITEMS = 200000 };
/* Lines of nodes that --set made: far past any line of a scene. */
#define SET_LINE 0x40000000u

typedef struct reader {
    app_scene *scene;
    yaml_document_t document;
    bool loaded; /* `document` is to be deleted */
    const app_schema *schema[SCHEMAS_MAX];
    int schema_count;
    int items; /* of lists, all told: aliases could multiply them */
} reader;

static inline yaml_node_t *node_at(reader *r, int index) { return yaml_document_get_node(&r->document, index); }

/* The name since 0.2 of a key, by its whole path, or of a choice (path=choice); null: it has not changed. */
const char *app_scene_renamed(const char *path);
char *app_scene_keep(app_scene *scene, const char *text);
/* As app_scene_bad counts: from 1 in the file, below 0 in --set. */
int app_scene_line(const yaml_node_t *node);
tm_status app_scene_bad_shape(const reader *r, const yaml_node_t *node, const char *shown, const char *wanted);
/* "a single value", "a list", "a mapping" */
const char *app_scene_node_kind(const yaml_node_t *node);
/* Nothing was written: "key:", "~" or "null". */
bool app_scene_null(const yaml_node_t *node);

/* One value into the struct of its kind at `at`. `shown` names it in complaints. 0 or a status, like all below. */
tm_status app_scene_scalar(reader *r, int line, const app_field *field, const char *shown, const char *text, void *at);
tm_status app_scene_vector(reader *r, yaml_node_t *node, const app_field *field, const char *shown, app_vector *out);
tm_status app_scene_integers(reader *r, yaml_node_t *node, const app_field *field, const char *shown,
                             app_integers *out);
/* Keys under `prefix` into the structs at `base`. `only` null: the top level, where every schema has its own base. */
tm_status app_scene_read_mapping(reader *r, const app_schema *only, yaml_node_t *node, int line, const char *prefix,
                                 const char *shown, char *const *base);

/* Lays one "a.b[0].c=value" over the document, or takes "a.b" out of it. A step that is not there is made; a list's
 * item must be there. 0 or a status, having complained. */
tm_status app_scene_apply_set(reader *r, int set);

#endif
