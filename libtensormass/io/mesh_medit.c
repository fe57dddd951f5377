/* Reads and writes Medit's .mesh (text): https://www.ljll.fr/frey/logiciels/Docmedit.dir. Vertices and elements are
 * keywords with a count; elements are numbered across all kinds from 1. References are written (regions), not read. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_format.h"

typedef struct reader {
    const char *at, *end;
    tm_io_raw *raw;
    tm_error *error;
    int64_t vertices, elements;
    bool ended; /* all vertices are read */
} reader;

static const struct kind {
    const char *word;
    int dim, corners;
    const char *refused; /* a volume other than a tetrahedron */
} kinds[] = {{"Edges", 1, 2, NULL},      {"Triangles", 2, 3, NULL},         {"Quadrilaterals", 2, 4, NULL},
             {"Tetrahedra", 3, 4, NULL}, {"Hexahedra", 3, 8, "hexahedron"}, {"Hexaedra", 3, 8, "hexahedron"},
             {"Prisms", 3, 6, "prism"},  {"Pyramids", 3, 5, "pyramid"}};

static void skip_spaces(reader *r) {
    while (r->at < r->end && (isspace((unsigned char)*r->at) || *r->at == '#'))
        if (*r->at++ == '#')
            while (r->at < r->end && *r->at != '\n') r->at++;
}

/* Reads an integer. */
static bool whole(reader *r, int64_t *out) {
    char *after;
    skip_spaces(r);
    *out = strtoll(r->at, &after, 10); /* stops at the file's final NUL at the latest */
    if (after == r->at || after > r->end) return false;
    r->at = after;
    return true;
}

/* Reads a number. */
static bool real(reader *r, double *out) {
    char *after;
    skip_spaces(r);
    *out = strtod(r->at, &after);
    if (after == r->at || after > r->end) return false;
    r->at = after;
    return true;
}

/* Returns the next word, which may be a number. Returns false at the end of the file. */
static bool next_word(reader *r, const char **word, size_t *length) {
    skip_spaces(r);
    *word = r->at;
    while (r->at < r->end && !isspace((unsigned char)*r->at)) r->at++;
    *length = (size_t)(r->at - *word);
    return *length > 0;
}

/* Reports a list that ends before its announced count. */
static tm_status cut_short(reader *r, int64_t found, int64_t announced, const char *what) {
    return tm_fail(r->error, TM_ERR_FILE, -1,
                   "has %lld of the %lld %s that its header counts, so it is truncated; save it again",
                   (long long)found, (long long)announced, what);
}

static tm_status not_understood(reader *r, const char *what) {
    return tm_fail(r->error, TM_ERR_FILE, -1, "its %s cannot be read; save it again", what);
}

static tm_status read_vertices(reader *r) {
    int64_t count, reference;
    if (!whole(r, &count) || count < 0 || r->ended) return not_understood(r, "Vertices");
    for (int64_t i = 0; i < count; i++) {
        double p[3];
        if (!real(r, &p[0]) || !real(r, &p[1]) || !real(r, &p[2]) || !whole(r, &reference))
            return cut_short(r, i, count, "vertices");
        tm_status status = tm_io_add_vertex(r->raw, ++r->vertices, p, r->error);
        if (status) return status;
    }
    r->ended = true;
    return tm_io_vertices_end(r->raw, r->error);
}

static tm_status read_elements(reader *r, const struct kind *kind) {
    int64_t count, corner[8], reference;
    if (!whole(r, &count) || count < 0) return not_understood(r, kind->word);
    for (int64_t i = 0; i < count; i++) {
        r->elements++;
        if (kind->refused) return tm_io_other_volume(r->error, r->elements, kind->refused);
        bool there = true;
        for (int k = 0; k < kind->corners; k++) there = there && whole(r, &corner[k]);
        if (!there || !whole(r, &reference)) return cut_short(r, i, count, kind->word);
        tm_status status = tm_io_add_element(r->raw, r->elements, kind->dim, 0, corner, kind->corners, r->error);
        if (status) return status;
    }
    return TM_OK;
}

static bool is(const char *word, size_t length, const char *wanted) {
    return strlen(wanted) == length && memcmp(word, wanted, length) == 0;
}

/* Reads what follows a keyword: vertices or a kind of elements. Others are skipped word by word. */
static tm_status read_section(reader *r, const char *word, size_t length) {
    int64_t number;
    if (is(word, length, "Dimension") && (!whole(r, &number) || number != 3))
        return tm_fail(r->error, TM_ERR_MESH, -1, "its dimension is not 3; mesh a volume");
    if (is(word, length, "Vertices")) return read_vertices(r);
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        if (is(word, length, kinds[k].word)) return read_elements(r, &kinds[k]);
        if (length == strlen(kinds[k].word) + 2 && memcmp(word, kinds[k].word, length - 2) == 0 &&
            word[length - 2] == 'P' && whole(r, &number) && number > 0)
            return tm_io_higher_order(r->error, r->elements + 1, word[length - 1] - '0');
    }
    return TM_OK; /* another keyword, or one of its numbers */
}

static tm_status read_medit(tm_io_text *text, tm_io_raw *raw) {
    reader r = {.at = text->at, .end = text->end, .raw = raw, .error = text->error};
    const char *word;
    size_t length;
    tm_status status = TM_OK;
    while (!status && next_word(&r, &word, &length) && !is(word, length, "End"))
        status = read_section(&r, word, length);
    if (!status && !r.ended) status = not_understood(&r, "Vertices");
    if (status == TM_ERR_FILE) text->line = tm_io_line(text->at, r.at);
    return status;
}

static void put_medit(const tm_mesh_file *m, FILE *file) {
    fprintf(file, "MeshVersionFormatted 2\nDimension 3\nVertices\n%d\n", m->vertex_count);
    for (int32_t v = 0; v < m->vertex_count; v++)
        fprintf(file, "%.17g %.17g %.17g 0\n", m->vertex_m[3 * (size_t)v], m->vertex_m[3 * (size_t)v + 1],
                m->vertex_m[3 * (size_t)v + 2]);
    fprintf(file, "Tetrahedra\n%d\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet + 4 * (size_t)t;
        fprintf(file, "%d %d %d %d %d\n", v[0] + 1, v[1] + 1, v[2] + 1, v[3] + 1, m->region[t] + 1);
    }
    fprintf(file, "End\n");
}

const tm_io_format tm_io_format_medit = {".mesh", "MeshVersionFormatted", read_medit, put_medit};
