/* Reads Gmsh's .msh, 2.2 and 4.1, text and binary: https://gmsh.info/doc/texinfo/gmsh.html#MSH-file-format. One code
 * path reads both: a row is a line of text, or nothing in a binary file. mesh_msh_write.c writes. */
#include <stdlib.h>
#include <string.h>

#include "mesh_format.h"
#include "mesh_msh.h"

typedef struct reader {
    const char *at, *end;
    int line; /* 0 in a binary file */
    int major;
    bool binary;
    tm_io_raw *raw;
    tm_error *error;
} reader;

static tm_status bad(const reader *r, const char *what) {
    if (r->binary)
        return tm_fail(r->error, TM_ERR_FILE, -1,
                       "its binary data ends early: %s; the file is damaged or truncated, save it again", what);
    return tm_fail(r->error, TM_ERR_FILE, -1, "%s; the file is damaged or truncated, save it again", what);
}

/* --- numbers, rows and lines --- */

static void skip_spaces(reader *r) {
    while (r->at < r->end && (*r->at == ' ' || *r->at == '\t' || *r->at == '\r')) r->at++;
}

/* Reads an integer: at the start of the row's rest, or the next `bytes` (4: signed). */
static bool whole(reader *r, size_t bytes, int64_t *out) {
    if (r->binary) {
        int32_t narrow;
        if ((size_t)(r->end - r->at) < bytes) return false;
        memcpy(bytes == 4 ? (void *)&narrow : (void *)out, r->at, bytes);
        if (bytes == 4) *out = narrow;
        r->at += bytes;
        return true;
    }
    skip_spaces(r);
    const char *p = r->at;
    bool minus = p < r->end && *p == '-';
    p += minus;
    int64_t value = 0;
    int digits = 0;
    for (; p < r->end && *p >= '0' && *p <= '9' && digits < 18; p++, digits++) value = 10 * value + (*p - '0');
    if (digits == 0 || (p < r->end && !strchr(" \t\r\n", *p))) return false;
    *out = minus ? -value : value;
    r->at = p;
    return true;
}

static bool real(reader *r, double *out) {
    if (r->binary) {
        if ((size_t)(r->end - r->at) < sizeof *out) return false;
        memcpy(out, r->at, sizeof *out);
        r->at += sizeof *out;
        return true;
    }
    char *after;
    skip_spaces(r);
    if (r->at >= r->end || *r->at == '\n') return false;
    *out = strtod(r->at, &after); /* stops at the file's final NUL at the latest */
    if (after == r->at || after > r->end) return false;
    r->at = after;
    return true;
}

/* Reads ints of the file: numbers of geometric entities. */
static bool narrow(reader *r, int32_t *out, int count) {
    for (int i = 0; i < count; i++) {
        int64_t value;
        if (!whole(r, 4, &value) || value < -INT32_MAX || value > INT32_MAX) return false;
        out[i] = (int32_t)value;
    }
    return true;
}

/* Reads counts and what follows them, on a row. Counts bound loops that consume input in each iteration. */
static bool counts(reader *r, int64_t *out, int count) {
    for (int i = 0; i < count; i++)
        if (!whole(r, 8, &out[i]) || out[i] < 0) return false;
    return true;
}

/* Starts a row: the next line. */
static bool row(reader *r) {
    r->line += !r->binary;
    return r->at < r->end;
}

/* Checks that only spaces are left of the row. */
static bool row_ends(reader *r) {
    if (r->binary) return true;
    skip_spaces(r);
    if (r->at < r->end && *r->at != '\n') return false;
    r->at += r->at < r->end;
    return true;
}

/* Skips the rest of the row. */
static void row_rest(reader *r) {
    if (r->binary) return;
    const char *stop = memchr(r->at, '\n', (size_t)(r->end - r->at));
    r->at = stop ? stop + 1 : r->end;
}

/* Reads a line of text in either kind of file, without trailing spaces. */
static bool line(reader *r, const char **text, size_t *length) {
    if (r->at >= r->end) return false;
    const char *stop = memchr(r->at, '\n', (size_t)(r->end - r->at));
    if (!stop) stop = r->end;
    *text = r->at;
    *length = (size_t)(stop - r->at);
    while (*length && strchr("\r \t", (*text)[*length - 1])) --*length;
    r->at = stop < r->end ? stop + 1 : r->end;
    r->line += !r->binary;
    return true;
}

static bool is(const char *text, size_t length, const char *word) {
    return strlen(word) == length && memcmp(text, word, length) == 0;
}

static tm_status section_end(reader *r, const char *mark, const char *what) {
    const char *text;
    size_t length;
    if (r->binary && r->at < r->end && *r->at == '\n') r->at++;
    return line(r, &text, &length) && is(text, length, mark) ? TM_OK : bad(r, what);
}

/* Skips to the end of an unused section. */
static void skip_section(reader *r, const char *name, size_t length) {
    char mark[80];
    if (length < 2 || length > 60) return;
    int size = snprintf(mark, sizeof mark, "$End%.*s", (int)length - 1, name + 1);
    const char *stop = tm_io_find(r->at, r->end, mark, (size_t)size);
    if (!stop) stop = r->end;
    for (; r->at < stop; r->at++) r->line += !r->binary && *r->at == '\n';
    const char *text;
    line(r, &text, &length);
}

/* --- names and entities --- */

/* Reads a count in text, on its own line, in either kind of file. */
static bool text_count(reader *r, int64_t *count) {
    const bool binary = r->binary;
    r->line += !binary;
    r->binary = false;
    const bool good = whole(r, 8, count) && *count >= 0 && row_ends(r);
    r->binary = binary;
    return good;
}

/* dimension number "name" */
static tm_status physical_names(reader *r) {
    int64_t count;
    if (!text_count(r, &count)) return bad(r, "$PhysicalNames begins with their number");
    for (int64_t i = 0; i < count; i++) {
        const char *text, *from, *to;
        size_t length;
        int dim, tag;
        if (!line(r, &text, &length)) return bad(r, "the file ends within its names");
        from = memchr(text, '"', length);
        to = from ? memchr(from + 1, '"', length - (size_t)(from + 1 - text)) : NULL;
        if (!to || sscanf(text, "%d %d", &dim, &tag) != 2 || dim < 0 || dim > 3)
            return bad(r, "a name is: dimension number \"name\"");
        tm_status status = tm_io_add_name(r->raw, dim, tag, from + 1, (size_t)(to - from - 1), r->error);
        if (status) return status;
    }
    return TM_OK;
}

/* Reads one entity: its number, its parent if partitioned, a point or a box, its groups, and its boundary. */
static tm_status entity(reader *r, int dim, bool partitioned) {
    int32_t tag, group, parent[2];
    int64_t count;
    double corner;
    bool good = row(r) && narrow(r, &tag, 1);
    if (good && partitioned) {
        good = narrow(r, parent, 2) && counts(r, &count, 1);
        for (int64_t i = 0; good && i < count; i++) good = narrow(r, parent, 1);
    }
    for (int i = 0; good && i < (dim == 0 ? 3 : 6); i++) good = real(r, &corner);
    good = good && counts(r, &count, 1);
    for (int64_t i = 0; good && i < count; i++) {
        good = narrow(r, &group, 1);
        tm_status status = good ? tm_io_add_member(r->raw, dim, tag, abs(group), r->error) : TM_OK;
        if (status) return status;
    }
    if (good && dim > 0) {
        good = counts(r, &count, 1);
        for (int64_t i = 0; good && i < count; i++) good = narrow(r, &group, 1);
    }
    return good && row_ends(r) ? TM_OK : bad(r, "an entity is: number, position, groups, bounds");
}

static tm_status entities(reader *r, bool partitioned) {
    int64_t count[4], ghosts = 0;
    int32_t ghost[2];
    bool good = true;
    if (partitioned) {
        good = row(r) && counts(r, count, 1) && row_ends(r) && row(r) && counts(r, &ghosts, 1) && row_ends(r);
        for (int64_t i = 0; good && i < ghosts; i++) /* number, partition */
            good = row(r) && narrow(r, ghost, 2) && row_ends(r);
    }
    if (!good || !row(r) || !counts(r, count, 4) || !row_ends(r)) return bad(r, "$Entities begins with 4 numbers");
    for (int dim = 0; dim < 4; dim++)
        for (int64_t i = 0; i < count[dim]; i++) {
            tm_status status = entity(r, dim, partitioned);
            if (status) return status;
        }
    return TM_OK;
}

static tm_status vertex(reader *r, int64_t tag) {
    double p[3];
    for (int i = 0; i < 3; i++)
        if (!real(r, &p[i])) return bad(r, "a coordinate is missing or not a number");
    return tm_io_add_vertex(r->raw, tag, p, r->error);
}

static tm_status nodes_2(reader *r) {
    int64_t count, tag;
    if (!text_count(r, &count)) return bad(r, "$Nodes begins with their number");
    for (int64_t i = 0; i < count; i++) {
        if (!row(r)) return bad(r, "the file ends within its vertices");
        if (!whole(r, 4, &tag) || tag <= 0) return bad(r, "a vertex is: number x y z");
        tm_status status = vertex(r, tag);
        if (status) return status;
        row_rest(r);
    }
    return TM_OK;
}

/* Reads a block: its vertices' numbers, then their coordinates, with parameters for points on a curve or surface. */
static tm_status node_block(reader *r) {
    int32_t head[3]; /* dimension, entity, parametric */
    int64_t count, tag;
    if (!row(r) || !narrow(r, head, 3) || !counts(r, &count, 1) || head[0] < 0 || head[0] > 3 || !row_ends(r))
        return bad(r, "a block of vertices begins with 4 numbers");
    reader tags = *r;
    for (int64_t i = 0; i < count; i++)
        if (!row(r) || !whole(r, 8, &tag) || tag <= 0 || !row_ends(r)) return bad(r, "a vertex number is missing");
    for (int64_t i = 0; i < count; i++) {
        double more;
        if (!row(r)) return bad(r, "the file ends within its vertices");
        if (!row(&tags) || !whole(&tags, 8, &tag) || !row_ends(&tags)) return bad(r, "a vertex number is missing");
        tm_status status = vertex(r, tag);
        for (int k = 0; !status && r->binary && head[2] && k < head[0]; k++)
            if (!real(r, &more)) status = bad(r, "a coordinate is missing or not a number");
        if (status) return status;
        row_rest(r);
    }
    return TM_OK;
}

static tm_status nodes_4(reader *r) {
    int64_t head[4];
    if (!row(r) || !counts(r, head, 4) || !row_ends(r)) return bad(r, "$Nodes begins with 4 numbers");
    for (int64_t b = 0; b < head[0]; b++) {
        tm_status status = node_block(r);
        if (status) return status;
    }
    return TM_OK;
}

/* First-order elements by Gmsh's type numbers. */
static const struct kind {
    int dim, corners;
    const char *refused; /* a volume other than a tetrahedron */
} kinds[] = {{-1, -1, NULL},       {1, 2, NULL},    {2, 3, NULL},      {2, 4, NULL},       {3, 4, NULL},
             {3, 8, "hexahedron"}, {3, 6, "prism"}, {3, 5, "pyramid"}, [15] = {0, 1, NULL}};

static tm_status kind_of(reader *r, int64_t tag, int64_t type, struct kind *out) {
    *out = type > 0 && type < (int64_t)(sizeof kinds / sizeof *kinds) ? kinds[type] : kinds[0];
    if (out->corners <= 0) return tm_io_higher_order(r->error, tag, type);
    return out->refused ? tm_io_other_volume(r->error, tag, out->refused) : TM_OK;
}

/* Reads the corners of an element with known number and type, to the end of its row. */
static tm_status corners(reader *r, size_t bytes, int64_t tag, const struct kind *kind, int32_t place) {
    int64_t corner[8]; /* of any kind */
    bool there = true;
    for (int k = 0; k < kind->corners; k++) there = there && whole(r, bytes, &corner[k]);
    if (!there || !row_ends(r)) return bad(r, "an element has too few or too many vertices");
    return tm_io_add_element(r->raw, tag, kind->dim, place, corner, kind->corners, r->error);
}

/* Reads the tags of an element of 2.2. The first is its group, and also serves as its entity. */
static tm_status element_2(reader *r, int64_t tag, const struct kind *kind, int64_t tags) {
    int32_t first = 0, tag_of;
    for (int64_t i = 0; i < tags; i++) {
        if (!narrow(r, &tag_of, 1)) return bad(r, "an element is: number type tags vertices");
        if (i == 0) first = abs(tag_of);
    }
    tm_status status = first ? tm_io_add_member(r->raw, kind->dim, first, first, r->error) : TM_OK;
    return status ? status : corners(r, 4, tag, kind, first);
}

enum { MAX_TAGS = 100 };

static tm_status elements_2(reader *r) {
    int64_t count, tag;
    int32_t head[3]; /* text: number, type, tags; binary: type, number of elements, tags */
    struct kind kind;
    tm_status status = TM_OK;
    if (!text_count(r, &count)) return bad(r, "$Elements begins with their number");
    while (count > 0 && !status) {
        if (!row(r)) return bad(r, "the file ends within its elements");
        if (!narrow(r, head, 3) || head[2] < 0 || head[2] > MAX_TAGS || (r->binary && (head[1] < 1 || head[1] > count)))
            return bad(r, "an element is: number type tags vertices");
        for (int64_t i = 0, block = r->binary ? head[1] : 1; i < block && !status; i++, count--) {
            tag = head[0];
            if (r->binary && !whole(r, 4, &tag)) return bad(r, "an element number is missing");
            status = kind_of(r, tag, r->binary ? head[0] : head[1], &kind);
            if (!status) status = element_2(r, tag, &kind, head[2]);
        }
    }
    return status;
}

static tm_status elements_4(reader *r) {
    int64_t head[4], count, tag;
    int32_t block[3]; /* dimension, entity, type */
    struct kind kind;
    tm_status status = TM_OK;
    if (!row(r) || !counts(r, head, 4) || !row_ends(r)) return bad(r, "$Elements begins with 4 numbers");
    for (int64_t b = 0; b < head[0] && !status; b++) {
        if (!row(r) || !narrow(r, block, 3) || !counts(r, &count, 1) || !row_ends(r))
            return bad(r, "a block of elements begins with 4 numbers");
        for (int64_t i = 0; i < count && !status; i++) {
            if (!row(r) || !whole(r, 8, &tag)) return bad(r, "an element number is missing");
            status = kind_of(r, tag, block[2], &kind);
            if (!status) status = corners(r, 8, tag, &kind, block[1]);
        }
    }
    return status;
}

/* --- the file --- */

/* Reads $MeshFormat: version, 0 for text, bytes of a size; then the number 1 in a binary file. */
static tm_status format(reader *r) {
    const char *text;
    size_t length;
    int32_t one;
    bool there = line(r, &text, &length);
    while (there && length == 0) there = line(r, &text, &length);
    if (!there || !is(text, length, "$MeshFormat")) return bad(r, "a .msh file begins with $MeshFormat");
    if (!line(r, &text, &length)) return bad(r, "the file ends after its first line");
    char *after;
    double version = strtod(text, &after);
    long binary = strtol(after, &after, 10), bytes = strtol(after, NULL, 10);
    r->major = version >= 2 && version < 3 ? 2 : 4;
    if (r->major == 4 && !(version > 4.05 && version < 4.2))
        return tm_fail(r->error, TM_ERR_FILE, -1, ".msh format '%.*s'; save as 4.1 or 2.2 (gmsh -format msh41)",
                       (int)(length > 20 ? 20 : length), text);
    if (!(r->binary = binary != 0)) return TM_OK;
    if (!narrow(r, &one, 1) || bytes != 8) return bad(r, "its data size is not 8 bytes");
    if (one == 1) return TM_OK;
    return tm_fail(r->error, TM_ERR_FILE, -1, "the binary file has another byte order; save it as text");
}

static tm_status read_msh(tm_io_text *file, tm_io_raw *raw) {
    reader r = {.at = file->at, .end = file->end, .raw = raw, .error = file->error};
    bool nodes = false, elements = false, twice = false;
    const char *text;
    size_t length;
    tm_status status = format(&r);
    while (!status && line(&r, &text, &length)) {
        if (is(text, length, "$PhysicalNames")) {
            status = physical_names(&r);
        } else if (is(text, length, "$Entities") || is(text, length, "$PartitionedEntities")) {
            status = entities(&r, text[1] == 'P');
        } else if (is(text, length, "$Nodes")) {
            status = nodes ? bad(&r, "a second $Nodes") : r.major == 2 ? nodes_2(&r) : nodes_4(&r);
            nodes = true;
            if (!status) twice = (status = tm_io_vertices_end(raw, r.error)) != TM_OK; /* not on a line of its own */
            if (!status) status = section_end(&r, "$EndNodes", "$EndNodes expected here");
        } else if (is(text, length, "$Elements")) {
            elements = true;
            status = !nodes ? bad(&r, "$Elements before $Nodes") : r.major == 2 ? elements_2(&r) : elements_4(&r);
            if (!status) status = section_end(&r, "$EndElements", "$EndElements expected here");
        } else if (length > 4 && text[0] == '$' && memcmp(text, "$End", 4) != 0) {
            skip_section(&r, text, length);
        }
    }
    file->line = r.binary || twice ? 0 : r.line;
    return status || (nodes && elements) ? status : bad(&r, nodes ? "no $Elements" : "no $Nodes");
}
const tm_io_format tm_io_format_msh = {".msh", "$MeshFormat", read_msh, tm_io_write_msh};
