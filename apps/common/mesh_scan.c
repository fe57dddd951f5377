/* The tags of an ASCII .msh in the order of the file. Gmsh's reader sorts by tag and leaves out vertices that no element uses;
 * fibre files and results count in file order, and a vertex left out is an error to tell. Gives line numbers, too. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

typedef struct cursor {
    const char *at, *end;
    int line;
    app_mesh_scan *scan;
    tm_error *error;
} cursor;

enum { MAX_COUNT = 500 * 1000 * 1000, TET4 = 4 };

static tm_status bad(cursor *c, const char *what) {
    return app_mesh_fail(c->error, TM_ERR_FILE, -1, "line %d: %s; the file is damaged or cut short, write it anew", c->line, what);
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

static bool append(int64_t **array, int64_t *count, int64_t value) {
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
        if (!append(&c->scan->vertex_tag, &c->scan->vertex_count, tag)) return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
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
    if (line_integers(c, &count, 1) != 1 || count < 0 || count > MAX_COUNT) return bad(c, "$Nodes begins with their number");
    for (int64_t i = 0; i < count; i++) {
        tm_status status = coordinates(c, true);
        if (status) return status;
    }
    return TM_OK;
}

static tm_status elements_2(cursor *c) {
    int64_t count, field[2];
    if (line_integers(c, &count, 1) != 1 || count < 0 || count > MAX_COUNT) return bad(c, "$Elements begins with their number");
    for (int64_t i = 0; i < count; i++) {
        int n = line_integers(c, field, 2);
        if (n != 2) return bad(c, n < 0 ? "the file ends among its elements" : "an element is: number type tags vertices");
        if (field[1] == TET4 && !append(&c->scan->tet_tag, &c->scan->tet_count, field[0]))
            return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
    }
    return TM_OK;
}

static tm_status nodes_4(cursor *c) {
    int64_t head[4], tag;
    if (line_integers(c, head, 4) != 4 || head[0] < 0 || head[0] > MAX_COUNT) return bad(c, "$Nodes begins with 4 numbers");
    for (int64_t b = 0, blocks = head[0]; b < blocks; b++) {
        if (line_integers(c, head, 4) != 4 || head[3] < 0 || head[3] > MAX_COUNT) return bad(c, "a block of vertices begins with 4 numbers");
        for (int64_t i = 0; i < head[3]; i++) {
            if (line_integers(c, &tag, 1) != 1 || tag <= 0) return bad(c, "a vertex number is missing");
            if (!append(&c->scan->vertex_tag, &c->scan->vertex_count, tag)) return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
        }
        for (int64_t i = 0; i < head[3]; i++) {
            tm_status status = coordinates(c, false);
            if (status) return status;
        }
    }
    return TM_OK;
}

static tm_status elements_4(cursor *c) {
    int64_t head[4], tag;
    if (line_integers(c, head, 4) != 4 || head[0] < 0 || head[0] > MAX_COUNT) return bad(c, "$Elements begins with 4 numbers");
    for (int64_t b = 0, blocks = head[0]; b < blocks; b++) {
        if (line_integers(c, head, 4) != 4 || head[3] < 0 || head[3] > MAX_COUNT) return bad(c, "a block of elements begins with 4 numbers");
        for (int64_t i = 0; i < head[3]; i++) {
            if (line_integers(c, &tag, 1) != 1) return bad(c, "an element number is missing");
            if (head[2] == TET4 && !append(&c->scan->tet_tag, &c->scan->tet_count, tag))
                return app_mesh_fail(c->error, TM_ERR_MEMORY, -1, "no memory");
        }
    }
    return TM_OK;
}

static bool is(const char *text, size_t length, const char *word) { return strlen(word) == length && memcmp(text, word, length) == 0; }

/* $MeshFormat's line: version, 0 for text, bytes of a number. */
static tm_status format_line(cursor *c, int *major, bool *binary) {
    const char *text;
    size_t length;
    if (!next_line(c, &text, &length) || !is(text, length, "$MeshFormat")) return bad(c, "a .msh file begins with $MeshFormat");
    if (!next_line(c, &text, &length)) return bad(c, "the file ends after its first line");
    char *after;
    double version = strtod(text, &after);
    *binary = strtol(after, NULL, 10) != 0;
    *major = (int)version;
    if (*major == 2 || (version > 4.05 && version < 4.2)) return TM_OK;
    return app_mesh_fail(c->error, TM_ERR_FILE, -1, "line %d: .msh format '%.*s'; save as 4.1 or 2.2 (gmsh -format msh41)", c->line,
                         (int)(length > 20 ? 20 : length), text);
}

tm_status app_mesh_scan_msh(const char *text, size_t size, app_mesh_scan *scan, tm_error *error) {
    *scan = (app_mesh_scan){0};
    cursor c = {text, text + size, 0, scan, error};
    int major = 0;
    bool binary = false, nodes = false, elements = false;
    const char *line;
    size_t length;
    tm_status status = format_line(&c, &major, &binary);
    if (!status && binary) {
        const char *at = major == 2 ? memmem(text, size, "$Nodes", 6) : NULL;
        scan->vertex_count = at ? strtoll(at + 6, NULL, 10) : -1;
        scan->tet_count = -1;
        return TM_OK;
    }
    while (!status && next_line(&c, &line, &length)) {
        if (is(line, length, "$Nodes")) {
            nodes = true;
            status = major == 2 ? nodes_2(&c) : nodes_4(&c);
            if (!status && !(next_line(&c, &line, &length) && is(line, length, "$EndNodes"))) status = bad(&c, "$EndNodes expected here");
        } else if (is(line, length, "$Elements")) {
            elements = true;
            status = major == 2 ? elements_2(&c) : elements_4(&c);
            if (!status && !(next_line(&c, &line, &length) && is(line, length, "$EndElements")))
                status = bad(&c, "$EndElements expected here");
        }
    }
    if (!status && !(nodes && elements)) status = bad(&c, nodes ? "no $Elements" : "no $Nodes");
    if (status) app_mesh_scan_free(scan);
    return status;
}

void app_mesh_scan_free(app_mesh_scan *scan) {
    free(scan->vertex_tag);
    free(scan->tet_tag);
    *scan = (app_mesh_scan){0};
}
