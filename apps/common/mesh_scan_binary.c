/* The tags of a binary .msh, 2.2 or 4.1, in the order of the file. */
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

typedef app_mesh_cursor cursor;

static tm_status short_file(cursor *c) {
    return app_mesh_fail(c->error, TM_ERR_FILE, -1,
                         "its binary part breaks off; the file is damaged or cut short, write it anew");
}

static bool take(cursor *c, void *out, size_t bytes) {
    if ((size_t)(c->end - c->at) < bytes) return false;
    if (out) memcpy(out, c->at, bytes);
    c->at += bytes;
    return true;
}

static bool skip(cursor *c, uint64_t count, size_t each) {
    if (count > (uint64_t)(c->end - c->at) / each) return false;
    c->at += count * each;
    return true;
}

/* To behind the section's own line. */
static bool find_section(cursor *c, const char *line) {
    const char *found = memmem(c->at, (size_t)(c->end - c->at), line, strlen(line));
    if (!found) return false;
    c->at = found + strlen(line);
    return true;
}

/* A count in text, on a line of its own. */
static bool take_count(cursor *c, int64_t *count) {
    char *after;
    *count = strtoll(c->at, &after, 10); /* ends at the file's final NUL at the latest */
    if (after == c->at || after >= c->end || *after != '\n' || *count < 0) return false;
    c->at = after + 1;
    return true;
}

static tm_status no_memory(cursor *c) { return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory"); }

static tm_status scan_2(cursor *c) {
    int64_t count;
    if (!find_section(c, "\n$Nodes\n") || !take_count(c, &count)) return short_file(c);
    for (int64_t i = 0; i < count; i++) {
        int32_t tag;
        if (!take(c, &tag, sizeof tag) || !skip(c, 3, sizeof(double))) return short_file(c);
        if (!app_mesh_append(&c->scan->vertex_tag, &c->scan->vertex_count, tag)) return no_memory(c);
    }
    tm_status status = app_mesh_scan_vertices_end(c);
    if (status) return status;
    if (!find_section(c, "\n$Elements\n") || !take_count(c, &count)) return short_file(c);
    while (count > 0) {
        int32_t head[3], tag, vertex; /* type, number, tags */
        if (!take(c, head, sizeof head) || head[1] < 1 || head[1] > count || head[2] < 0 || head[2] > 100)
            return short_file(c);
        count -= head[1];
        for (int32_t i = 0; i < head[1]; i++) {
            if (!take(c, &tag, sizeof tag)) return short_file(c);
            status = app_mesh_scan_element(c, tag, head[0]);
            if (status) return status;
            if (!skip(c, (uint64_t)head[2], sizeof(int32_t))) return short_file(c);
            for (int k = 0; k < app_mesh_type_vertices(head[0]); k++) {
                if (!take(c, &vertex, sizeof vertex)) return short_file(c);
                if ((status = app_mesh_scan_corner(c, tag, vertex))) return status;
            }
        }
    }
    return TM_OK;
}

static tm_status nodes_4(cursor *c) {
    uint64_t head[4], count, tag;
    if (!find_section(c, "\n$Nodes\n") || !take(c, head, sizeof head)) return short_file(c);
    for (uint64_t b = 0; b < head[0]; b++) {
        int32_t entity[3]; /* dimension, tag, parametric */
        if (!take(c, entity, sizeof entity) || !take(c, &count, sizeof count) || entity[0] < 0 || entity[0] > 3)
            return short_file(c);
        for (uint64_t i = 0; i < count; i++) {
            if (!take(c, &tag, sizeof tag) || tag > INT64_MAX) return short_file(c);
            if (!app_mesh_append(&c->scan->vertex_tag, &c->scan->vertex_count, (int64_t)tag)) return no_memory(c);
        }
        if (!skip(c, count, (size_t)(3 + (entity[2] ? entity[0] : 0)) * sizeof(double))) return short_file(c);
    }
    return TM_OK;
}

static tm_status elements_4(cursor *c) {
    uint64_t head[4], count, tag, vertex;
    if (!find_section(c, "\n$Elements\n") || !take(c, head, sizeof head)) return short_file(c);
    for (uint64_t b = 0; b < head[0]; b++) {
        int32_t entity[3]; /* dimension, tag, type */
        if (!take(c, entity, sizeof entity) || !take(c, &count, sizeof count)) return short_file(c);
        for (uint64_t i = 0; i < count; i++) {
            if (!take(c, &tag, sizeof tag) || tag > INT64_MAX) return short_file(c);
            tm_status status = app_mesh_scan_element(c, (int64_t)tag, entity[2]);
            if (status) return status;
            for (int k = 0; k < app_mesh_type_vertices(entity[2]); k++) {
                if (!take(c, &vertex, sizeof vertex)) return short_file(c);
                if ((status = app_mesh_scan_corner(c, (int64_t)tag, vertex > INT64_MAX ? -1 : (int64_t)vertex)))
                    return status;
            }
        }
    }
    return TM_OK;
}

tm_status app_mesh_scan_binary(cursor *c, int major) {
    int32_t one;
    c->line = 0;
    if (!take(c, &one, sizeof one)) return short_file(c);
    if (one != 1)
        return app_mesh_fail(c->error, TM_ERR_FILE, -1, "a binary file of another byte order; save it as text");
    c->at--; /* a section begins with the end of the line before */
    if (major == 2) return scan_2(c);
    tm_status status = nodes_4(c);
    if (!status) status = app_mesh_scan_vertices_end(c);
    return status ? status : elements_4(c);
}
