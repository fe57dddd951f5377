/* Reads fibre directions from CSV: one line per tetrahedron, or per vertex. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/contract.h"
#include "mesh_format.h"
#include "place.h"

/* Meaning of a row's index. */
typedef struct rows {
    const char *word, *plural;
    int32_t count;
} rows;

/* Reads one "tet,ax,ay,az" line into fibre[3*expected]. Returns null, or the error. */
static const char *parse_row(const rows *kind, const char *text, int32_t expected, double *fibre) {
    const char *form = *kind->word == 'v' ? "a row is vertex,ax,ay,az" : "a row is tet,ax,ay,az";
    char *end;
    errno = 0;
    long long number = strtoll(text, &end, 10);
    if (end == text || *end != ',') return form;
    if (errno || number != expected)
        return *kind->word == 'v' ? "rows count vertices from 0 in file order, each once"
                                  : "rows count tetrahedra from 0 in file order, each once";
    double a[3];
    for (int i = 0; i < 3; i++) {
        const char *from = end + 1;
        a[i] = strtod(from, &end);
        if (end == from || (i < 2 && *end != ',')) return form;
    }
    end += strspn(end, " \t\r\n");
    if (*end) return "the row has more than four columns";
    double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    if (!isfinite(length)) return "a direction is not finite";
    if (length < 1e-6) return "a direction has no length";
    for (int i = 0; i < 3; i++) fibre[3 * (size_t)expected + (size_t)i] = a[i] / length;
    return NULL;
}

static bool is_header(const char *text, const char *word) {
    const size_t n = strlen(word);
    return strncmp(text, word, n) == 0 && strcmp(text + n, ",ax,ay,az") == 0;
}

/* Reads the header and returns which of `kind` [kinds] the rows have; -1 after an error message. */
static int read_header(FILE *file, const rows *kind, int kinds, tm_error *error) {
    char text[256];
    const char * or = kinds > 1 ? " or vertex,ax,ay,az" : "";
    if (!fgets(text, sizeof text, file)) {
        tm_fail(error, TM_ERR_FILE, -1, "the file is empty; its first line is tet,ax,ay,az%s", or);
        return -1;
    }
    text[strcspn(text, "\r\n")] = 0;
    for (int k = 0; k < kinds; k++)
        if (is_header(text, kind[k].word)) return k;
    tm_fail(error, TM_ERR_FILE, -1, "header '%.40s'; write tet,ax,ay,az%s", text, or);
    return -1;
}

static tm_status read_rows(FILE *file, const rows *kind, double *fibre, int *line, tm_error *error) {
    char text[256];
    int32_t row = 0;
    for (*line = 2; fgets(text, sizeof text, file); ++*line) {
        if (strspn(text, " \t\r\n") == strlen(text)) continue;
        if (row >= kind->count)
            return tm_fail(error, TM_ERR_FILE, -1,
                           "more rows than the mesh's %d %s; is it the fibre file of another mesh?", kind->count,
                           kind->plural);
        const char *wrong = parse_row(kind, text, row, fibre);
        if (wrong)
            return tm_fail(error, TM_ERR_FILE, row, "%s %d expected here: %s; correct the row",
                           kind->word[0] == 't' ? "tetrahedron" : kind->word, row, wrong);
        row++;
    }
    if (ferror(file)) return tm_fail(error, TM_ERR_FILE, -1, "%s; check the file", strerror(errno));
    if (row < kind->count)
        return tm_fail(error, TM_ERR_FILE, row,
                       "ends after %d rows, the mesh has %d %s; is it the fibre file of another mesh?", row,
                       kind->count, kind->plural);
    return TM_OK;
}

/* Averages the axes of a tetrahedron's vertices: aligns the signs, sums, normalises. */
static void average(const tm_mesh *mesh, const double *of_vertex, double *fibre) {
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double sum[3] = {0, 0, 0}, length = 0;
        for (int k = 0; k < 4; k++) {
            const int32_t v = tm_mesh_original_vertex(mesh, mesh->tet[4 * (size_t)t + (size_t)k]);
            const double *a = of_vertex + 3 * (size_t)v;
            const double sign = sum[0] * a[0] + sum[1] * a[1] + sum[2] * a[2] < 0 ? -1 : 1;
            for (int c = 0; c < 3; c++) sum[c] += sign * a[c];
        }
        for (int c = 0; c < 3; c++) length += sum[c] * sum[c];
        for (int c = 0; c < 3; c++) fibre[3 * (size_t)t + (size_t)c] = sum[c] / sqrt(length);
    }
}

/* Reads the file. `mesh` null: rows are tetrahedra. */
static tm_status read_file(const char *path, const tm_mesh *mesh, int32_t tet_count, double *fibre, int *line,
                           tm_error *error) {
    struct stat info;
    if (stat(path, &info) == 0 && S_ISDIR(info.st_mode))
        return tm_fail(error, TM_ERR_FILE, -1, "is a folder; name the CSV file in it");
    FILE *file = fopen(path, "r");
    if (!file) return tm_fail(error, TM_ERR_FILE, -1, "cannot open: %s; check the path", strerror(errno));
    const rows kind[2] = {{"tet", "tetrahedra", tet_count}, {"vertex", "vertices", mesh ? mesh->vertex_count : 0}};
    const tm_io_locale locale = tm_io_locale_enter();
    *line = 1;
    const int k = read_header(file, kind, mesh ? 2 : 1, error);
    double *of_vertex = k == 1 ? malloc(3 * (size_t)kind[1].count * sizeof *of_vertex) : NULL;
    tm_status status = k < 0 ? TM_ERR_FILE : TM_OK;
    if (k == 1 && !of_vertex) status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for fibres; use a coarser mesh");
    if (!status) status = read_rows(file, &kind[k], k == 1 ? of_vertex : fibre, line, error);
    if (!status && k == 1) average(mesh, of_vertex, fibre);
    tm_io_locale_leave(locale);
    free(of_vertex);
    fclose(file);
    return status;
}

tm_status tm_fibres_load(const char *path, int32_t tet_count, double *fibre, tm_error *error) {
    TM_REQUIRE(path && fibre, "path or fibre is null", TM_ERR_ARGUMENT);
    int line = 0;
    const tm_status status = read_file(path, NULL, tet_count, fibre, &line, error);
    return tm_io_place(path, line, status, error);
}

tm_status tm_fibres_load_on(const char *path, const tm_mesh *mesh, double *fibre, tm_error *error) {
    TM_REQUIRE(path && mesh && fibre, "path, mesh or fibre is null", TM_ERR_ARGUMENT);
    int line = 0;
    const tm_status status = read_file(path, mesh, mesh->tet_count, fibre, &line, error);
    return tm_io_place(path, line, status, error);
}
