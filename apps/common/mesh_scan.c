/* The tags of a .msh in the order of the file, and its element types. Gmsh's reader sorts by tag, leaves out vertices
 * that no element uses, and writes beyond its buffers where one volume mixes first and second order. Here is the text
 * form, with line numbers. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

typedef app_mesh_cursor cursor;

enum { MAX_COUNT = 500 * 1000 * 1000, TET4 = 4 };

/* Vertices of a first-order element, -1 for any other. */
int app_mesh_type_vertices(int64_t type) {
    static const int vertices[] = {-1, 2, 3, 4, 4, 8, 6, 5};
    return type == 15 ? 1 : type >= 1 && type <= 7 ? vertices[type] : -1;
}

tm_status app_mesh_scan_element(cursor *c, int64_t tag, int64_t type) {
    static const char *const name[] = {"hexahedron", "prism", "pyramid"};
    char place[40] = "";
    if (c->line) snprintf(place, sizeof place, "line %d: ", c->line);
    if (app_mesh_type_vertices(type) < 0)
        return app_mesh_fail(
            c->error, TM_ERR_MESH, tag,
            "%selement %lld is not of first order (type %lld); save first-order elements (gmsh -order 1)", place,
            (long long)tag, (long long)type);
    if (type >= 5 && type <= 7)
        return app_mesh_fail(c->error, TM_ERR_MESH, tag, "%selement %lld is a %s; mesh with tetrahedra alone", place,
                             (long long)tag, name[type - 5]);
    if (type == TET4 && !app_mesh_append(&c->scan->tet_tag, &c->scan->tet_count, tag))
        return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
    return TM_OK;
}

static int by_value(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

/* c->sorted := the tags, ascending. */
static tm_status sort_tags(cursor *c, const int64_t *tag, int64_t count, const char *what) {
    if (!(c->sorted = malloc(((size_t)count + 1) * sizeof *c->sorted)))
        return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
    if (count) memcpy(c->sorted, tag, (size_t)count * sizeof *c->sorted);
    qsort(c->sorted, (size_t)count, sizeof *c->sorted, by_value);
    for (int64_t i = 1; i < count; i++)
        if (c->sorted[i] == c->sorted[i - 1])
            return app_mesh_fail(c->error, TM_ERR_MESH, c->sorted[i], "%s %lld is there twice; number them anew", what,
                                 (long long)c->sorted[i]);
    return TM_OK;
}

tm_status app_mesh_scan_vertices_end(cursor *c) {
    return sort_tags(c, c->scan->vertex_tag, c->scan->vertex_count, "vertex");
}

tm_status app_mesh_scan_corner(cursor *c, int64_t element, int64_t vertex) {
    if (bsearch(&vertex, c->sorted, (size_t)c->scan->vertex_count, sizeof *c->sorted, by_value)) return TM_OK;
    return app_mesh_fail(c->error, TM_ERR_MESH, element,
                         "element %lld names vertex %lld, which is not there; write the mesh anew", (long long)element,
                         (long long)vertex);
}

static tm_status bad(cursor *c, const char *what) {
    return app_mesh_fail(c->error, TM_ERR_FILE, -1, "line %d: %s; the file is damaged or cut short, write it anew",
                         c->line, what);
}

/* The next line without its end, or null at the end of the file. */
static bool next_line(cursor *c, const char **start, size_t *length) {
    if (c->at >= c->end) return false;
    const char *stop = memchr(c->at, '\n', (size_t)(c->end - c->at));
    if (!stop) stop = c->end;
    *start = c->at;
    *length = (size_t)(stop - c->at);
    while (*length && ((*start)[*length - 1] == '\r' || (*start)[*length - 1] == ' ')) --*length;
    c->at = stop < c->end ? stop + 1 : c->end;
    c->line++;
    return true;
}

/* Up to `wanted` whole numbers from the next line. Returns how many there were, -1 at the end of the file. */
static int line_integers(cursor *c, int64_t *out, int wanted) {
    const char *text;
    size_t length;
    if (!next_line(c, &text, &length)) return -1;
    int n = 0;
    const char *p = text, *stop = text + length;
    while (n < wanted) {
        while (p < stop && (*p == ' ' || *p == '\t')) p++;
        char *after;
        if (p >= stop) break;
        errno = 0;
        out[n] = strtoll(p, &after, 10);
        if (after == p || errno || after > stop) break;
        p = after;
        n++;
    }
    return n;
}

bool app_mesh_append(int64_t **array, int64_t *count, int64_t value) {
    if ((*count & (*count - 1)) == 0) { /* grows at powers of two */
        int64_t *grown = realloc(*array, (size_t)(*count ? 2 * *count : 1) * sizeof **array);
        if (!grown) return false;
        *array = grown;
    }
    (*array)[(*count)++] = value;
    return true;
}

static tm_status coordinates(cursor *c, bool tagged) {
    const char *text;
    size_t length;
    if (!next_line(c, &text, &length)) return bad(c, "the file ends among its vertices");
    const char *p = text, *stop = text + length;
    char *after;
    if (tagged) {
        long long tag = strtoll(p, &after, 10);
        if (after == p || tag <= 0) return bad(c, "a vertex is: number x y z");
        if (!app_mesh_append(&c->scan->vertex_tag, &c->scan->vertex_count, tag))
            return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
        p = after;
    }
    for (int i = 0; i < 3; i++) {
        strtod(p, &after);
        if (after == p || after > stop) return bad(c, "a coordinate is missing or not a number");
        p = after;
    }
    return TM_OK;
}

static tm_status nodes_2(cursor *c) {
    int64_t count;
    if (line_integers(c, &count, 1) != 1 || count < 0 || count > MAX_COUNT)
        return bad(c, "$Nodes begins with their number");
    for (int64_t i = 0; i < count; i++) {
        tm_status status = coordinates(c, true);
        if (status) return status;
    }
    return TM_OK;
}

static tm_status elements_2(cursor *c) {
    enum { TAGS = 100 };
    int64_t count, field[3 + TAGS + 8];
    if (line_integers(c, &count, 1) != 1 || count < 0 || count > MAX_COUNT)
        return bad(c, "$Elements begins with their number");
    for (int64_t i = 0; i < count; i++) {
        int n = line_integers(c, field, 3 + TAGS + 8);
        if (n < 3 || field[2] < 0 || field[2] > TAGS)
            return bad(c, n < 0 ? "the file ends among its elements" : "an element is: number type tags vertices");
        tm_status status = app_mesh_scan_element(c, field[0], field[1]);
        int corners = app_mesh_type_vertices(field[1]), first = 3 + (int)field[2];
        if (!status && n != first + corners) status = bad(c, "an element has too few or too many vertices");
        for (int k = 0; !status && k < corners; k++) status = app_mesh_scan_corner(c, field[0], field[first + k]);
        if (status) return status;
    }
    return TM_OK;
}

static tm_status nodes_4(cursor *c) {
    int64_t head[4], tag;
    if (line_integers(c, head, 4) != 4 || head[0] < 0 || head[0] > MAX_COUNT)
        return bad(c, "$Nodes begins with 4 numbers");
    for (int64_t b = 0, blocks = head[0]; b < blocks; b++) {
        if (line_integers(c, head, 4) != 4 || head[3] < 0 || head[3] > MAX_COUNT)
            return bad(c, "a block of vertices begins with 4 numbers");
        for (int64_t i = 0; i < head[3]; i++) {
            if (line_integers(c, &tag, 1) != 1 || tag <= 0) return bad(c, "a vertex number is missing");
            if (!app_mesh_append(&c->scan->vertex_tag, &c->scan->vertex_count, tag))
                return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
        }
        for (int64_t i = 0; i < head[3]; i++) {
            tm_status status = coordinates(c, false);
            if (status) return status;
        }
    }
    return TM_OK;
}

static tm_status elements_4(cursor *c) {
    int64_t head[4], field[1 + 8 + 1];
    if (line_integers(c, head, 4) != 4 || head[0] < 0 || head[0] > MAX_COUNT)
        return bad(c, "$Elements begins with 4 numbers");
    for (int64_t b = 0, blocks = head[0]; b < blocks; b++) {
        if (line_integers(c, head, 4) != 4 || head[3] < 0 || head[3] > MAX_COUNT)
            return bad(c, "a block of elements begins with 4 numbers");
        for (int64_t i = 0; i < head[3]; i++) {
            int n = line_integers(c, field, 1 + 8 + 1), corners = app_mesh_type_vertices(head[2]);
            if (n < 1) return bad(c, "an element number is missing");
            tm_status status = app_mesh_scan_element(c, field[0], head[2]);
            if (!status && n != 1 + corners) status = bad(c, "an element has too few or too many vertices");
            for (int k = 0; !status && k < corners; k++) status = app_mesh_scan_corner(c, field[0], field[1 + k]);
            if (status) return status;
        }
    }
    return TM_OK;
}

static bool is(const char *text, size_t length, const char *word) {
    return strlen(word) == length && memcmp(text, word, length) == 0;
}

/* $MeshFormat's line: version, 0 for text, bytes of a number. */
static tm_status format_line(cursor *c, int *major, bool *binary) {
    const char *text;
    size_t length;
    if (!next_line(c, &text, &length) || !is(text, length, "$MeshFormat"))
        return bad(c, "a .msh file begins with $MeshFormat");
    if (!next_line(c, &text, &length)) return bad(c, "the file ends after its first line");
    char *after;
    double version = strtod(text, &after);
    *binary = strtol(after, NULL, 10) != 0;
    *major = version >= 2 && version < 3 ? 2 : 4;
    if (*major == 2 || (version > 4.05 && version < 4.2)) return TM_OK;
    return app_mesh_fail(c->error, TM_ERR_FILE, -1,
                         "line %d: .msh format '%.*s'; save as 4.1 or 2.2 (gmsh -format msh41)", c->line,
                         (int)(length > 20 ? 20 : length), text);
}

static tm_status scan_text(cursor *c, int major) {
    bool nodes = false, elements = false;
    const char *line;
    size_t length;
    tm_status status = TM_OK;
    while (!status && next_line(c, &line, &length)) {
        if (is(line, length, "$Nodes")) {
            status = nodes ? bad(c, "a second $Nodes") : major == 2 ? nodes_2(c) : nodes_4(c);
            nodes = true;
            if (!status) status = app_mesh_scan_vertices_end(c);
            if (!status && !(next_line(c, &line, &length) && is(line, length, "$EndNodes")))
                status = bad(c, "$EndNodes expected here");
        } else if (is(line, length, "$Elements")) {
            elements = true;
            status = !nodes ? bad(c, "$Elements before $Nodes") : major == 2 ? elements_2(c) : elements_4(c);
            if (!status && !(next_line(c, &line, &length) && is(line, length, "$EndElements")))
                status = bad(c, "$EndElements expected here");
        }
    }
    return status || (nodes && elements) ? status : bad(c, nodes ? "no $Elements" : "no $Nodes");
}

tm_status app_mesh_scan_msh(const char *text, size_t size, app_mesh_scan *scan, tm_error *error) {
    *scan = (app_mesh_scan){0};
    cursor c = {text, text + size, 0, scan, error, NULL};
    int major = 0;
    bool binary = false;
    tm_status status = format_line(&c, &major, &binary);
    if (!status) status = binary ? app_mesh_scan_binary(&c, major) : scan_text(&c, major);
    free(c.sorted);
    c.sorted = NULL;
    if (!status) status = sort_tags(&c, scan->tet_tag, scan->tet_count, "tetrahedron");
    free(c.sorted);
    if (status) app_mesh_scan_free(scan);
    return status;
}

void app_mesh_scan_free(app_mesh_scan *scan) {
    free(scan->vertex_tag);
    free(scan->tet_tag);
    *scan = (app_mesh_scan){0};
}
