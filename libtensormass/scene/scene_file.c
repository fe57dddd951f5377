/* Reads a scene's file: checks its limits, parses one YAML document, applies --set, reads the fields. */
#include "scene_reader.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Limits of a scene, checked before libyaml builds it: its time for nesting, aliases and directives is quadratic. */

/* Typical scenes have a depth of 5, no anchors and some hundred values. */
enum { MAX_DEPTH = 16, MAX_ANCHORS = 64, MAX_DIRECTIVES = 4, MAX_VALUES = 1000000 };

static tm_status too_many(const app_scene *scene, size_t line, const char *what, int most, const char *instead) {
    return app_host_bad(&scene->host, scene->file, (int)line + 1, "more than %d %s; %s", most, what, instead);
}

static tm_status check_directives(const app_scene *scene, const char *text, size_t size) {
    size_t line = 0;
    int count = 0;
    for (const char *at = text, *end = text + size; at < end; line++) {
        if (*at == '%' && ++count > MAX_DIRECTIVES)
            return too_many(scene, line, "lines that begin with %", MAX_DIRECTIVES, "leave them out");
        const char *stop = memchr(at, '\n', (size_t)(end - at));
        at = stop ? stop + 1 : end;
    }
    return 0;
}

/* Refuses nesting, anchors, directives and counts above the limits, in linear time. Returns 0 or a status. */
/* Invalid YAML passes: the parser that follows reports it with a better message. */
static tm_status app_scene_check_limits(const app_scene *scene, const char *text, size_t size) {
    yaml_parser_t parser;
    yaml_event_t event;
    int depth = 0, anchors = 0, values = 0, rc = check_directives(scene, text, size);
    bool going = !rc && yaml_parser_initialize(&parser), made = going;
    if (going) yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    while (going && yaml_parser_parse(&parser, &event)) {
        size_t line = event.start_mark.line;
        const unsigned char *anchor = NULL;
        going = event.type != YAML_STREAM_END_EVENT;
        switch (event.type) {
        case YAML_SEQUENCE_START_EVENT:
            anchor = event.data.sequence_start.anchor;
            depth++;
            break;
        case YAML_MAPPING_START_EVENT:
            anchor = event.data.mapping_start.anchor;
            depth++;
            break;
        case YAML_SEQUENCE_END_EVENT:
        case YAML_MAPPING_END_EVENT: depth--; break;
        case YAML_SCALAR_EVENT:
            anchor = event.data.scalar.anchor;
            values++;
            break;
        case YAML_ALIAS_EVENT: anchor = event.data.alias.anchor; break;
        default: break;
        }
        anchors += anchor != NULL;
        if (depth > MAX_DEPTH)
            rc = too_many(scene, line, "nested levels of lists and mappings", MAX_DEPTH, "a scene needs five");
        else if (anchors > MAX_ANCHORS)
            rc = too_many(scene, line, "anchors (&) and aliases (*)", MAX_ANCHORS, "write the values out");
        else if (values > MAX_VALUES)
            rc = too_many(scene, line, "values", MAX_VALUES, "give a scene, not a mesh");
        yaml_event_delete(&event);
        going = going && !rc;
    }
    if (made) yaml_parser_delete(&parser);
    return rc;
}

/* Returns the remedy for a line (from 0) that is not YAML. */
/* libyaml's messages, and the usual cause. */
static const char *app_scene_yaml_remedy(const char *text, size_t size, size_t line, const char *problem) {
    const char *at = text, *end = text + size;
    for (; line && at < end; line--) {
        const char *stop = memchr(at, '\n', (size_t)(end - at));
        at = stop ? stop + 1 : end;
    }
    const char *stop = at < end ? memchr(at, '\n', (size_t)(end - at)) : NULL;
    size_t length = (size_t)((stop ? stop : end) - at), blank = 0;
    while (blank < length && (at[blank] == ' ' || at[blank] == '\t')) blank++;
    if (memchr(at, '\t', blank)) return "indent with spaces, not with tabs";
    if (problem && (strstr(problem, "alphabetic") || strstr(problem, "alias")) && memchr(at, '*', length))
        return "put the asterisk in quotes: \"*\":";
    if (problem && strstr(problem, "mapping values are not allowed"))
        return "put text with a colon in quotes, and each key on its own line";
    if (problem && strstr(problem, "did not find expected"))
        return "look for an unclosed bracket or quote, or a wrong indentation";
    return "correct the line";
}

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

/* Reads the complete file; the caller frees it. */
static tm_status read_scene(const app_host *host, const char *path, char **text, size_t *size) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    *text = NULL;
    if (!file) return app_host_bad(host, path, 0, "cannot be read: %m; give the path of a scene file");
    tm_status rc = 0;
    if (fstat(fileno(file), &info) || !S_ISREG(info.st_mode))
        rc = app_host_bad(host, path, 0, "is not a regular file; give the path of a scene file");
    else if (info.st_size > SCENE_MAX_BYTES)
        rc = app_host_bad(host, path, 0, "is larger than 4 MB, the limit of a scene; give a scene, not a mesh");
    else if (!(*text = malloc((size_t)info.st_size + 1)))
        rc = app_scene_no_memory(host, path);
    else
        *size = fread(*text, 1, (size_t)info.st_size, file);
    if (!rc && ferror(file)) rc = app_host_bad(host, path, 0, "cannot be read: %m; check the disk");
    fclose(file);
    return rc;
}

/* Allocates the scene's arrays, sets the defaults, then reads the file's fields. */
static tm_status read_fields(reader *r, const app_schema *effect, char *const *set, const char *text, size_t size) {
    app_scene *scene = r->scene;
    scene->set = app_scene_alloc(scene, sizeof *scene->set * (size_t)(scene->set_count + 1));
    for (int i = 0; i < scene->set_count; i++) scene->set[i] = app_scene_keep(scene, set[i]);
    scene->effect = app_scene_alloc(scene, sizeof *scene->effect * (size_t)(scene->effect_count + 1));
    char *base[sizeof r->schema / sizeof r->schema[0]] = {(char *)scene};
    r->schema[0] = app_scene_schema();
    for (int i = 0; i < scene->effect_count; i++) {
        r->schema[i + 1] = &effect[i];
        base[i + 1] = scene->effect[i] = app_scene_alloc(scene, effect[i].size);
    }
    tm_status rc = load_document(r, text, size);
    r->loaded = !rc;
    for (int i = 0; i < scene->set_count && !rc; i++) rc = app_scene_apply_set(r, i);
    return rc ? rc : app_scene_read_mapping(r, NULL, node_at(r, 1), 1, "", "", base);
}

/* Reads the scene; if memory is exhausted, longjmp returns here. What outlives the reading is in the caller's frame. */
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
