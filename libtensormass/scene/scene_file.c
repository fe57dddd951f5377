/* A scene's file: read whole, within limits, one YAML document, changed by --set, and then read through its fields. */
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "scene_reader.h"

enum { SCENE_MAX_BYTES = 4 << 20 };

static tm_status not_yaml(const app_scene *scene, const yaml_parser_t *parser, const char *text, size_t size) {
    if (parser->error == YAML_MEMORY_ERROR || parser->error == YAML_NO_ERROR)
        return app_scene_no_memory(&scene->host, scene->file);
    return app_host_bad(&scene->host, scene->file, (int)parser->problem_mark.line + 1, "not YAML: %s%s%s; %s",
                        parser->problem ? parser->problem : "unreadable", parser->context ? " " : "",
                        parser->context ? parser->context : "",
                        app_scene_yaml_remedy(text, size, parser->problem_mark.line, parser->problem));
}

static tm_status load_document(reader *r, const char *text, size_t size) {
    app_scene *scene = r->scene;
    yaml_parser_t parser;
    yaml_document_t second;
    tm_status rc = app_scene_check_limits(scene, text, size);
    if (rc) return rc;
    if (!yaml_parser_initialize(&parser)) return app_scene_no_memory(&scene->host, scene->file);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, &r->document)) {
        rc = not_yaml(scene, &parser, text, size);
        yaml_parser_delete(&parser);
        return rc;
    }
    yaml_node_t *root = yaml_document_get_root_node(&r->document);
    if (!root)
        rc = app_host_bad(&scene->host, scene->file, 1,
                          "the scene is empty; begin with 'tissue:' (docs/scene-reference.md)");
    else if (root->type != YAML_MAPPING_NODE)
        rc = app_host_bad(&scene->host, scene->file, app_scene_line(root),
                          "the scene is %s; write keys and values, such as 'tissue:'", app_scene_node_kind(root));
    else if (yaml_parser_load(&parser, &second)) {
        if (yaml_document_get_root_node(&second))
            rc = app_host_bad(&scene->host, scene->file, (int)second.start_mark.line + 1,
                              "a second document begins here; keep one scene a file");
        yaml_document_delete(&second);
    } else
        rc = not_yaml(scene, &parser, text, size);
    yaml_parser_delete(&parser);
    if (rc) yaml_document_delete(&r->document);
    return rc;
}

/* The whole file, to be freed. */
static tm_status read_scene(const app_host *host, const char *path, char **text, size_t *size) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    *text = NULL;
    if (!file) return app_host_bad(host, path, 0, "cannot be read: %m; give the path of a scene file");
    tm_status rc = 0;
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode))
        rc = app_host_bad(host, path, 0, "is not a regular file; give the path of a scene file");
    else if (info.st_size > SCENE_MAX_BYTES)
        rc = app_host_bad(host, path, 0, "is larger than a scene may be (4 MB); give a scene, not a mesh");
    else if (!(*text = malloc((size_t)info.st_size + 1)))
        rc = app_scene_no_memory(host, path);
    else
        *size = fread(*text, 1, (size_t)info.st_size, file);
    if (!rc && ferror(file)) rc = app_host_bad(host, path, 0, "cannot be read: %m; check the disk");
    fclose(file);
    return rc;
}

/* The scene's own arrays, and its file laid over what its fields have by default. */
static tm_status read_fields(reader *r, const app_schema *effect, char *const *set, const char *text, size_t size) {
    app_scene *scene = r->scene;
    scene->set = app_scene_alloc(scene, sizeof *scene->set * (size_t)(scene->set_count + 1));
    for (int i = 0; i < scene->set_count; i++) scene->set[i] = app_scene_keep(scene, set[i]);
    scene->effect = app_scene_alloc(scene, sizeof *scene->effect * (size_t)(scene->effect_count + 1));
    char *base[sizeof r->schema / sizeof r->schema[0]] = {(char *)scene};
    r->schema[0] = &app_scene_schema;
    for (int i = 0; i < scene->effect_count; i++) {
        r->schema[i + 1] = &effect[i];
        base[i + 1] = scene->effect[i] = app_scene_alloc(scene, effect[i].size);
    }
    tm_status rc = load_document(r, text, size);
    r->loaded = !rc;
    for (int i = 0; i < scene->set_count && !rc; i++) rc = app_scene_apply_set(r, i);
    return rc ? rc : app_scene_read_mapping(r, NULL, node_at(r, 1), 1, "", "", base);
}

/* Comes back from wherever in the reading memory ran out. All that outlives the reading is of the caller's frame. */
static tm_status read_or_no_memory(reader *r, const char *file, const app_schema *effect, char *const *set,
                                   const char *text, size_t size) {
    jmp_buf back;
    if (setjmp(back)) return app_scene_no_memory(&r->scene->host, file);
    r->scene->no_memory = &back;
    r->scene->file = app_scene_keep(r->scene, file);
    return read_fields(r, effect, set, text, size);
}

tm_status app_scene_load(const char *file, char *const *set, int set_count, const app_schema *effect, int effect_count,
                         const app_host *host, app_scene **out) {
    char *text;
    size_t size = 0;
    if (effect_count >= SCHEMAS_MAX)
        return app_host_bad(host, file, 0, "%d effects; build with fewer than %d", effect_count, SCHEMAS_MAX);
    tm_status rc = read_scene(host, file, &text, &size);
    app_scene *scene = rc ? NULL : calloc(1, sizeof *scene);
    if (!scene) {
        free(text);
        return rc ? rc : app_scene_no_memory(host, file);
    }
    scene->host = *host;
    scene->set_count = set_count;
    scene->effect_count = effect_count;
    reader r = {.scene = scene, .schema_count = effect_count + 1};
    rc = read_or_no_memory(&r, file, effect, set, text, size);
    scene->no_memory = NULL;
    free(text);
    if (r.loaded) yaml_document_delete(&r.document);
    if (rc)
        app_scene_free(scene);
    else
        *out = scene;
    return rc;
}
