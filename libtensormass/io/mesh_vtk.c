/* VTK's legacy files, text and binary: with counts among the corners (to 4.2), and with OFFSETS and CONNECTIVITY (5,
 * what VTK 9, ParaView and meshio write unless told otherwise). Format:
 * https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "mesh_format.h"

typedef struct reader {
    const char *at, *end;
    bool binary, offsets; /* since version 5 */
    tm_error *error;
    double *point;      /* [3*points] */
    int64_t *offset;    /* [cells + 1] */
    int64_t *corner;    /* [corners] */
    int64_t *cell_type; /* [cells] */
    int64_t points, cells;
} reader;

static tm_status bad(reader *r, const char *what) {
    return tm_fail(r->error, TM_ERR_FILE, -1, "%s; write it anew", what);
}
static tm_status cut_short(reader *r) { return bad(r, "the file is cut short"); }
static tm_status no_memory(reader *r) { return tm_fail(r->error, TM_ERR_MEMORY, -1, "no memory for the mesh"); }

/* --- words and values --- */

/* The next line, without its end and the spaces around. False at the end of the file. */
static bool next_line(reader *r, char *line, size_t size) {
    if (r->at >= r->end) return false;
    const char *stop = memchr(r->at, '\n', (size_t)(r->end - r->at));
    if (!stop) stop = r->end;
    const char *from = r->at, *to = stop;
    while (from < to && isspace((unsigned char)*from)) from++;
    while (to > from && isspace((unsigned char)to[-1])) to--;
    size_t length = (size_t)(to - from) < size - 1 ? (size_t)(to - from) : size - 1;
    memcpy(line, from, length);
    line[length] = 0;
    r->at = stop < r->end ? stop + 1 : r->end;
    return true;
}

typedef enum kind { WHOLE, NATURAL, REAL } kind;
static const struct type {
    const char *name;
    int bytes;
    kind kind;
} types[] = {{"unsigned_char", 1, NATURAL},
             {"char", 1, WHOLE},
             {"unsigned_short", 2, NATURAL},
             {"short", 2, WHOLE},
             {"unsigned_int", 4, NATURAL},
             {"int", 4, WHOLE},
             {"vtkidtype", 4, WHOLE},
             {"unsigned_long", 8, NATURAL},
             {"long", 8, WHOLE},
             {"vtktypeint64", 8, WHOLE},
             {"vtktypeint32", 4, WHOLE},
             {"vtktypeuint64", 8, NATURAL},
             {"float", 4, REAL},
             {"double", 8, REAL}};

static const struct type *type_of(const char *name) {
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (strcasecmp(types[i].name, name) == 0) return &types[i];
    return NULL;
}

/* Big endian. */
static double binary_value(const char *at, const struct type *type) {
    uint64_t bits = 0;
    for (int i = 0; i < type->bytes; i++) bits = bits << 8 | (unsigned char)at[i];
    if (type->kind == NATURAL) return (double)bits;
    if (type->kind == WHOLE) return (double)((int64_t)(bits << (64 - 8 * type->bytes)) >> (64 - 8 * type->bytes));
    double d;
    float f;
    uint32_t half = (uint32_t)bits;
    memcpy(&d, &bits, sizeof d);
    memcpy(&f, &half, sizeof f);
    return type->bytes == 8 ? d : (double)f;
}

static bool text_value(reader *r, double *value) {
    char *end;
    while (r->at < r->end && isspace((unsigned char)*r->at)) r->at++;
    *value = strtod(r->at, &end); /* the text ends in a NUL */
    if (end == r->at || end > r->end) return false;
    r->at = end;
    return true;
}

/* `count` values into `real` or `whole`, or, both null, past them. Refuses before it takes memory for what is not
 * there: the arrays are the caller's, made after has_room. */
static bool has_room(const reader *r, int64_t count, const struct type *type) {
    int64_t left = r->end - r->at, each = r->binary ? type->bytes : 2;
    return count >= 0 && count <= (left + 1) / each;
}

static bool values(reader *r, int64_t count, const struct type *type, double *real, int64_t *whole) {
    if (!has_room(r, count, type)) return false;
    for (int64_t i = 0; i < count; i++) {
        double value = 0;
        if (!r->binary && !text_value(r, &value)) return false;
        if (r->binary) {
            if (r->end - r->at < type->bytes) return false;
            value = binary_value(r->at, type);
            r->at += type->bytes;
        }
        if (real) real[i] = value;
        if (whole) whole[i] = fabs(value) < 9e15 ? (int64_t)value : -1;
    }
    if (r->binary && r->at < r->end && *r->at == '\n') r->at++;
    return true;
}

static bool make(int64_t **array, int64_t count) {
    free(*array);
    return (*array = malloc((size_t)(count + 1) * sizeof **array)) != NULL;
}

/* --- sections --- */

static tm_status read_points(reader *r, const char *line) {
    char name[32];
    long long count;
    const struct type *type = sscanf(line, "%*s %lld %31s", &count, name) == 2 ? type_of(name) : NULL;
    if (!type) return bad(r, "its line POINTS is not understood");
    if (count < 0 || count > INT32_MAX / 4 || !has_room(r, 3 * count, type)) return cut_short(r);
    free(r->point);
    r->points = count;
    if (!(r->point = malloc((size_t)(3 * count + 1) * sizeof *r->point))) return no_memory(r);
    return values(r, 3 * count, type, r->point, NULL) ? TM_OK : cut_short(r);
}

static tm_status read_array(reader *r, const char *word, int64_t count, int64_t **array) {
    char line[200] = "", name[32] = "", kind_of[32] = "";
    while (!*line && next_line(r, line, sizeof line)) continue;
    const struct type *type = sscanf(line, "%31s %31s", name, kind_of) == 2 ? type_of(kind_of) : NULL;
    if (!type || strcasecmp(name, word))
        return tm_fail(r->error, TM_ERR_FILE, -1, "%s expected after CELLS; write it anew", word);
    if (!has_room(r, count, type)) return cut_short(r);
    if (!make(array, count)) return no_memory(r);
    return values(r, count, type, NULL, *array) ? TM_OK : cut_short(r);
}

/* Version 5: one offset more than there are cells. */
static tm_status read_offsets(reader *r, int64_t offsets, int64_t corners) {
    r->cells = offsets > 0 ? offsets - 1 : 0;
    tm_status status = read_array(r, "OFFSETS", offsets, &r->offset);
    if (!status) status = read_array(r, "CONNECTIVITY", corners, &r->corner);
    if (status) return status;
    if (offsets == 0) r->offset[0] = 0;
    for (int64_t c = 0; c < r->cells; c++)
        if (r->offset[c] < 0 || r->offset[c] > r->offset[c + 1] || r->offset[c + 1] > corners)
            return bad(r, "its OFFSETS do not ascend");
    return TM_OK;
}

/* Before: each cell is a count and its corners, `size` numbers in all. */
static tm_status read_counted(reader *r, int64_t cells, int64_t size) {
    const struct type *type = type_of("int");
    if (!has_room(r, size, type) || cells > size) return cut_short(r);
    r->cells = cells;
    if (!make(&r->corner, size) || !make(&r->offset, cells)) return no_memory(r);
    if (!values(r, size, type, NULL, r->corner)) return cut_short(r);
    int64_t at = 0, kept = 0;
    for (int64_t c = 0; c < cells; c++) {
        int64_t count = at < size ? r->corner[at++] : -1;
        if (count < 0 || count > size - at) return bad(r, "its CELLS do not have the corners that they count");
        r->offset[c] = kept;
        for (int64_t k = 0; k < count; k++) r->corner[kept++] = r->corner[at++];
    }
    r->offset[cells] = kept;
    return TM_OK;
}

static tm_status read_cells(reader *r, const char *line) {
    long long first, second;
    if (sscanf(line, "%*s %lld %lld", &first, &second) != 2 || first < 0 || second < 0)
        return bad(r, "its line CELLS is not understood");
    return r->offsets ? read_offsets(r, first, second) : read_counted(r, first, second);
}

static tm_status read_types(reader *r, const char *line) {
    long long count;
    if (sscanf(line, "%*s %lld", &count) != 1 || !r->offset || count != r->cells)
        return bad(r, "CELL_TYPES does not fit CELLS");
    if (!has_room(r, count, type_of("int"))) return cut_short(r);
    if (!make(&r->cell_type, count)) return no_memory(r);
    return values(r, count, type_of("int"), NULL, r->cell_type) ? TM_OK : cut_short(r);
}

/* FIELD comes before the points, with arrays of anything (strings, too): nothing of it is wanted. */
static tm_status skip_field(reader *r) {
    const char *next = tm_io_find(r->at, r->end, "\nPOINTS ", 8);
    if (!next) return cut_short(r);
    r->at = next + 1;
    return TM_OK;
}

static tm_status read_sections(reader *r) {
    char line[400];
    tm_status status = TM_OK;
    double version = 0;
    for (int i = 0; i < 3; i++) { /* version, title, text or binary */
        if (!next_line(r, line, sizeof line)) return cut_short(r);
        if (i == 0) r->offsets = sscanf(line, "# vtk DataFile Version %lf", &version) == 1 && version >= 5;
    }
    r->binary = strcasecmp(line, "BINARY") == 0;
    if (!r->binary && strcasecmp(line, "ASCII")) return bad(r, "neither ASCII nor BINARY in its third line");
    while (!status && !r->cell_type && next_line(r, line, sizeof line)) {
        if (!strncasecmp(line, "DATASET", 7) && strcasecmp(line + 7 + strspn(line + 7, " \t"), "UNSTRUCTURED_GRID"))
            return tm_fail(r->error, TM_ERR_MESH, -1, "%s; save an unstructured grid of tetrahedra", line);
        if (!strncasecmp(line, "POINTS ", 7)) status = read_points(r, line);
        if (!strncasecmp(line, "CELLS ", 6)) status = read_cells(r, line);
        if (!strncasecmp(line, "CELL_TYPES ", 11)) status = read_types(r, line);
        if (!strncasecmp(line, "FIELD ", 6) && !r->point) status = skip_field(r);
        if (!strcasecmp(line, "METADATA")) /* to the empty line */
            while (next_line(r, line, sizeof line) && *line) continue;
    }
    return status ? status : r->cell_type && r->point ? TM_OK : cut_short(r);
}

/* --- the mesh --- */

/* VTK_TETRA, VTK_QUADRATIC_EDGE, VTK_QUAD */
enum { TETRA = 10, QUADRATIC = 21, FLAT_TYPES = 9 };

/* What is no volume is passed over. */
static tm_status check_cells(reader *r) {
    static const int flat[FLAT_TYPES + 1] = {0, 1, 0, 2, 0, 3, 0, 0, 4, 4}; /* corners, 0: any number */
    for (int64_t c = 0; c < r->cells; c++) {
        int64_t type = r->cell_type[c];
        int64_t corners = r->offset[c + 1] - r->offset[c];
        if (type >= 0 && type <= FLAT_TYPES && (!flat[type] || corners == flat[type])) continue;
        if (type >= QUADRATIC)
            return tm_fail(r->error, TM_ERR_MESH, c + 1,
                           "cell %lld is of a higher order (type %lld); save first-order tetrahedra", (long long)c,
                           (long long)type);
        if (type != TETRA || corners != 4)
            return tm_fail(r->error, TM_ERR_MESH, c + 1,
                           "cell %lld is no tetrahedron (type %lld, %lld corners); mesh with tetrahedra alone",
                           (long long)c, (long long)type, (long long)corners);
        for (int k = 0; k < 4; k++) {
            int64_t v = r->corner[r->offset[c] + k];
            if (v < 0 || v >= r->points)
                return tm_fail(r->error, TM_ERR_MESH, c + 1,
                               "cell %lld names vertex %lld, which is not there; write the mesh anew", (long long)c,
                               (long long)v);
        }
    }
    return TM_OK;
}

/* Tags count vertices and cells of the file from 1. */
static tm_status add_all(const reader *r, tm_io_raw *raw) {
    tm_status status = TM_OK;
    for (int64_t v = 0; v < r->points && !status; v++)
        status = tm_io_add_vertex(raw, v + 1, r->point + 3 * v, r->error);
    if (!status) status = tm_io_vertices_end(raw, r->error);
    for (int64_t c = 0; c < r->cells && !status; c++) {
        const int64_t *v = r->corner + r->offset[c];
        if (r->cell_type[c] != TETRA) continue;
        const int64_t corner[4] = {v[0] + 1, v[1] + 1, v[2] + 1, v[3] + 1};
        status = tm_io_add_element(raw, c + 1, 3, 0, corner, 4, r->error);
    }
    return status;
}

static tm_status read_vtk(tm_io_text *text, tm_io_raw *raw) {
    reader r = {.at = text->at, .end = text->end, .error = text->error};
    tm_status status = read_sections(&r);
    if (!r.binary && status == TM_ERR_FILE && r.at > text->at) text->line = tm_io_line(text->at, r.at - 1);
    if (!status) status = check_cells(&r);
    if (!status) status = add_all(&r, raw);
    free(r.point);
    free(r.offset);
    free(r.corner);
    free(r.cell_type);
    return status;
}

/* Regions as numbers of the cells; groups are lost. */
static void put_vtk(const tm_mesh_file *m, FILE *file) {
    fprintf(file, "# vtk DataFile Version 2.0\ntensormass mesh\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %d double\n",
            m->vertex_count);
    for (int32_t v = 0; v < m->vertex_count; v++)
        fprintf(file, "%.17g %.17g %.17g\n", m->vertex_m[3 * (size_t)v], m->vertex_m[3 * (size_t)v + 1],
                m->vertex_m[3 * (size_t)v + 2]);
    fprintf(file, "CELLS %d %lld\n", m->tet_count, 5LL * m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet + 4 * (size_t)t;
        fprintf(file, "4 %d %d %d %d\n", v[0], v[1], v[2], v[3]);
    }
    fprintf(file, "CELL_TYPES %d\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) fprintf(file, "10\n");
    fprintf(file, "CELL_DATA %d\nSCALARS region int 1\nLOOKUP_TABLE default\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) fprintf(file, "%d\n", m->region[t]);
}

const tm_io_format tm_io_format_vtk = {".vtk", "# vtk DataFile", read_vtk, put_vtk};
