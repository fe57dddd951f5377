/* Reads VTK's legacy files, text and binary: with counts among the corners (to 4.2), or with OFFSETS and CONNECTIVITY
 * (5, default of VTK 9, ParaView and meshio). Format:
 * https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "vtk_cells.h"

typedef struct reader {
    const char *at, *end;
    bool binary, offsets, surface; /* offsets: since version 5; surface: dataset of polygons */
    const char *dataset;           /* other accepted type: "UNSTRUCTURED_GRID" */
    tm_io_vtk *v;
} reader;

static tm_status bad(reader *r, const char *what) { return tm_io_vtk_bad(r->v, what); }
static tm_status cut_short(reader *r) { return bad(r, "the file is truncated"); }
static tm_status no_memory(reader *r) { return tm_io_vtk_no_memory(r->v); }

/* --- words and values --- */

/* Returns the next line, without its end and the surrounding spaces. Returns false at the end of the file. */
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

/* Reads `count` values into `real` or `whole`, or skips them if both are null. Refuses missing values before memory is
 * allocated: the caller allocates after has_capacity. */
static bool has_capacity(const reader *r, int64_t count, const struct type *type) {
    int64_t left = r->end - r->at, each = r->binary ? type->bytes : 2;
    return count >= 0 && count <= (left + 1) / each;
}

static bool values(reader *r, int64_t count, const struct type *type, double *real, int64_t *whole) {
    if (!has_capacity(r, count, type)) return false;
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

/* VTK writes spaces in a name as %20. */
static void plain_name(char *name) {
    char *to = name;
    for (const char *from = name; *from; to++) {
        unsigned code;
        if (*from == '%' && sscanf(from + 1, "%2x", &code) == 1 && isxdigit((unsigned char)from[1]) &&
            isxdigit((unsigned char)from[2])) {
            *to = (char)code;
            from += 3;
        } else
            *to = *from++;
    }
    *to = 0;
}

/* --- sections --- */

static tm_status read_points(reader *r, const char *line) {
    char name[32];
    long long count;
    const struct type *type = sscanf(line, "%*s %lld %31s", &count, name) == 2 ? type_of(name) : NULL;
    if (!type) return bad(r, "its line POINTS cannot be read");
    if (count < 0 || count > INT32_MAX / 4 || !has_capacity(r, 3 * count, type)) return cut_short(r);
    free(r->v->point);
    r->v->points = count;
    if (!(r->v->point = malloc((size_t)(3 * count + 1) * sizeof *r->v->point))) return no_memory(r);
    return values(r, 3 * count, type, r->v->point, NULL) ? TM_OK : cut_short(r);
}

static tm_status read_array(reader *r, const char *word, int64_t count, int64_t **array) {
    char line[200] = "", name[32] = "", kind_of[32] = "";
    while (!*line && next_line(r, line, sizeof line)) continue;
    const struct type *type = sscanf(line, "%31s %31s", name, kind_of) == 2 ? type_of(kind_of) : NULL;
    if (!type || strcasecmp(name, word))
        return tm_fail(r->v->error, TM_ERR_FILE, -1, "%s is expected after CELLS; save it again", word);
    if (!has_capacity(r, count, type)) return cut_short(r);
    if (!make(array, count)) return no_memory(r);
    return values(r, count, type, NULL, *array) ? TM_OK : cut_short(r);
}

/* Reads version 5: one offset more than cells. */
static tm_status read_offsets(reader *r, int64_t offsets, int64_t corners) {
    r->v->cells = 0;
    tm_status status = read_array(r, "OFFSETS", offsets, &r->v->offset);
    if (!status) status = read_array(r, "CONNECTIVITY", corners, &r->v->corner);
    if (status) return status;
    if (offsets == 0) r->v->offset[0] = 0;
    r->v->cells = offsets > 0 ? offsets - 1 : 0;
    return tm_io_vtk_check(r->v, corners);
}

/* Reads earlier versions: each cell is a count and its corners, `size` numbers in total. */
static tm_status read_counted(reader *r, int64_t cells, int64_t size) {
    const struct type *type = type_of("int");
    if (!has_capacity(r, size, type) || cells > size) return cut_short(r);
    r->v->cells = 0;
    if (!make(&r->v->corner, size) || !make(&r->v->offset, cells)) return no_memory(r);
    if (!values(r, size, type, NULL, r->v->corner)) return cut_short(r);
    int64_t at = 0, kept = 0;
    for (int64_t c = 0; c < cells; c++) {
        int64_t count = at < size ? r->v->corner[at++] : -1;
        if (count < 0 || count > size - at) return bad(r, "its CELLS do not have as many vertices as they say");
        r->v->offset[c] = kept;
        for (int64_t k = 0; k < count; k++) r->v->corner[kept++] = r->v->corner[at++];
    }
    r->v->offset[cells] = kept;
    r->v->cells = cells;
    return tm_io_vtk_check(r->v, kept);
}

static tm_status read_cells(reader *r, const char *line) {
    long long first, second;
    if (sscanf(line, "%*s %lld %lld", &first, &second) != 2 || first < 0 || second < 0)
        return bad(r, "its line CELLS cannot be read");
    return r->offsets ? read_offsets(r, first, second) : read_counted(r, first, second);
}

static tm_status read_types(reader *r, const char *line) {
    long long count;
    if (sscanf(line, "%*s %lld", &count) != 1 || !r->v->offset || count != r->v->cells)
        return bad(r, "CELL_TYPES and CELLS have different lengths");
    if (!has_capacity(r, count, type_of("int"))) return cut_short(r);
    if (!make(&r->v->cell_type, count)) return no_memory(r);
    return values(r, count, type_of("int"), NULL, r->v->cell_type) ? TM_OK : cut_short(r);
}

/* Reads a FIELD before the points, with arrays of any type (strings, too); only the names of regions are used. */
static tm_status read_field(reader *r) {
    static const char word[] = "\nregion_names ";
    const char *next = tm_io_find(r->at, r->end, "\nPOINTS ", 8);
    if (!next) return cut_short(r);
    const char *names = tm_io_find(r->at - 1, next, word, sizeof word - 1);
    char line[400];
    if (names) r->at = names + 1;
    for (int64_t n = -1; names && r->at <= next && next_line(r, line, sizeof line) && n < 65536; n++) {
        if (n >= 0 && strcmp(line, "METADATA") == 0) break;
        plain_name(line);
        if (n >= 0 && !tm_io_vtk_name(r->v, n, line)) return no_memory(r);
    }
    r->at = next + 1;
    return TM_OK;
}

/* Reads cell and point data: integers named region of cells, fields of groups (0 or 1) of points. Other data is skipped
 * line by line. After binary data lines have no meaning, so the search ends there. */
static tm_status read_regions(reader *r, const char *line) {
    char name[64], type_name[32], lookup[100];
    int components = 1;
    const struct type *type =
        sscanf(line, "%*s %63s %31s %d", name, type_name, &components) >= 2 ? type_of(type_name) : NULL;
    if (!type || strcmp(name, "region") || components != 1 || r->v->region) return TM_OK;
    next_line(r, lookup, sizeof lookup); /* LOOKUP_TABLE default */
    if (!has_capacity(r, r->v->cells, type)) return cut_short(r);
    if (!make(&r->v->region, r->v->cells)) return no_memory(r);
    return values(r, r->v->cells, type, NULL, r->v->region) ? TM_OK : cut_short(r);
}

static tm_status read_groups(reader *r, const char *line) {
    int arrays = 0;
    char row[400] = "", name[300], type_name[32];
    long long components = 0, tuples = 0;
    if (sscanf(line, "FIELD groups %d", &arrays) != 1) return TM_OK;
    for (int i = 0; i < arrays; i++) {
        for (*row = 0; !*row && next_line(r, row, sizeof row);) continue;
        const int got = sscanf(row, "%299s %lld %lld %31s", name, &components, &tuples, type_name);
        const struct type *type = got == 4 ? type_of(type_name) : NULL;
        if (!type || components != 1 || tuples != r->v->points || !has_capacity(r, tuples, type))
            return bad(r, "its FIELD groups does not have one number for each point");
        plain_name(name);
        uint8_t *in = tm_io_vtk_group_add(r->v, name);
        int64_t *value = malloc(((size_t)tuples + 1) * sizeof *value);
        const bool good = in && value && values(r, tuples, type, NULL, value);
        for (int64_t p = 0; good && p < tuples; p++) in[p] = value[p] != 0;
        free(value);
        if (!in || !value) return no_memory(r);
        if (!good) return cut_short(r);
    }
    return TM_OK;
}

static tm_status check_dataset(reader *r, const char *line) {
    const char *is = line + 7 + strspn(line + 7, " \t");
    r->surface = !strcasecmp(is, "POLYDATA") && strcmp(r->dataset, "POLYDATA") == 0;
    if (r->surface || !strcasecmp(is, "UNSTRUCTURED_GRID")) return TM_OK;
    return tm_fail(
        r->v->error, TM_ERR_MESH, -1,
        !strcasecmp(is, "POLYDATA")
            ? "%s is a surface, not a volume; save an unstructured grid, or fill it with tetrahedra: tm-mesh fill"
            : "%s; save an unstructured grid of tetrahedra",
        line);
}

static tm_status read_section(reader *r, const char *line) {
    const bool done = r->surface ? r->v->offset != NULL : r->v->cell_type != NULL;
    char skipped[400];
    if (!strcasecmp(line, "METADATA")) /* to the empty line */
        while (next_line(r, skipped, sizeof skipped) && *skipped) continue;
    if (!strncasecmp(line, "FIELD ", 6) && !r->v->point) return read_field(r);
    if (done && !strncmp(line, "SCALARS ", 8)) return read_regions(r, line);
    if (done && !strncmp(line, "FIELD groups ", 13)) return read_groups(r, line);
    if (done) return TM_OK;
    if (!strncasecmp(line, "DATASET", 7)) return check_dataset(r, line);
    if (!strncasecmp(line, "POINTS ", 7)) return read_points(r, line);
    if (!strncasecmp(line, r->surface ? "POLYGONS " : "CELLS ", r->surface ? 9 : 6)) return read_cells(r, line);
    if (r->surface && !strncasecmp(line, "TRIANGLE_STRIPS ", 16))
        return bad(r, "triangle strips cannot be read; save triangles (ParaView: Triangulate)");
    return strncasecmp(line, "CELL_TYPES ", 11) ? TM_OK : read_types(r, line);
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
    if (!r->binary && strcasecmp(line, "ASCII")) return bad(r, "its third line is neither ASCII nor BINARY");
    while (!status && next_line(r, line, sizeof line)) status = read_section(r, line);
    if (status) return status;
    return r->v->point && (r->surface ? r->v->offset != NULL : r->v->cell_type != NULL) ? TM_OK : cut_short(r);
}

tm_status tm_io_vtk_read_legacy(tm_io_text *text, const char *dataset, tm_io_vtk *v) {
    reader r = {.at = text->at, .end = text->end, .dataset = dataset, .v = v};
    v->error = text->error;
    const tm_status status = read_sections(&r);
    if (!r.binary && status == TM_ERR_FILE && r.at > text->at) text->line = tm_io_line(text->at, r.at - 1);
    return status;
}
