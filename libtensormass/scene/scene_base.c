/* Basis of the scene's reader: memory, and faults with their place. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene_reader.h"

typedef struct block {
    struct block *next;
    max_align_t data[];
} block;

void *app_scene_alloc(app_scene *scene, size_t bytes) {
    block *b = calloc(1, sizeof(block) + bytes);
    if (!b && scene->no_memory) longjmp(*(jmp_buf *)scene->no_memory, 1);
    if (!b) return NULL;
    b->next = scene->arena;
    scene->arena = b;
    return b->data;
}

tm_status app_scene_no_memory(const app_host *host, const char *file) {
    return app_host_tell(host, TM_FAULT, TM_ERR_MEMORY, file, 0, "out of memory; close other programs");
}

char *app_scene_keep(app_scene *scene, const char *text) {
    size_t bytes = strlen(text) + 1;
    return memcpy(app_scene_alloc(scene, bytes), text, bytes);
}

bool app_scene_quote(const char *text, char *out, size_t size) {
    size_t quotes = 0;
    for (const char *c = text; *c; c++) quotes += *c == '\'';
    if (strlen(text) + quotes + 3 > size) return false; /* a quote at each end, and the end of the string */
    *out++ = '\'';
    for (; *text; *out++ = *text++)
        if (*text == '\'') *out++ = '\'';
    *out++ = '\'';
    *out = 0;
    return true;
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

static tm_status tell(const app_scene *scene, int line, tm_severity severity, tm_status status, const char *format,
                      va_list list) {
    char message[1024], file[512];
    vsnprintf(message, sizeof message, format, list);
    if (line < 0)
        snprintf(file, sizeof file, "--set %s", scene->set[-line - 1]);
    else
        snprintf(file, sizeof file, "%s", scene->file);
    return app_host_tell(&scene->host, severity, status, file, line, message);
}

tm_status app_scene_fail(const app_scene *scene, int line, tm_status status, const char *format, ...) {
    va_list list;
    va_start(list, format);
    tell(scene, line, TM_FAULT, status, format, list);
    va_end(list);
    return status;
}

tm_status app_scene_bad(const app_scene *scene, int line, const char *format, ...) {
    va_list list;
    va_start(list, format);
    tell(scene, line, TM_FAULT, TM_ERR_ARGUMENT, format, list);
    va_end(list);
    return TM_ERR_ARGUMENT;
}

tm_status app_scene_warn(const app_scene *scene, int line, const char *format, ...) {
    const tm_status status = scene->strict ? TM_ERR_ARGUMENT : TM_OK;
    va_list list;
    va_start(list, format);
    tell(scene, line, TM_WARNING, status, format, list);
    va_end(list);
    return status;
}

int app_scene_line(const yaml_node_t *node) {
    size_t line = node->start_mark.line;
    return line >= SET_LINE ? -(int)(line - SET_LINE) - 1 : (int)line + 1;
}

const char *app_scene_node_kind(const yaml_node_t *node) {
    return node->type == YAML_SCALAR_NODE     ? "a single value"
           : node->type == YAML_SEQUENCE_NODE ? "a list"
                                              : "a mapping";
}

bool app_scene_null(const yaml_node_t *node) {
    if (node->type != YAML_SCALAR_NODE || node->data.scalar.style != YAML_PLAIN_SCALAR_STYLE) return false;
    const char *text = (const char *)node->data.scalar.value;
    return !*text || !strcmp(text, "~") || !strcmp(text, "null");
}

tm_status app_scene_bad_shape(const reader *r, const yaml_node_t *node, const char *shown, const char *wanted) {
    return app_scene_bad(r->scene, app_scene_line(node), "%s is %s; write %s", shown, app_scene_node_kind(node),
                         wanted);
}
