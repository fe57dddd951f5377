/* Fibre directions from CSV: one line a tetrahedron. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "mesh_format.h"

/* One "tet,ax,ay,az" line into fibre[3*tet]. Null, or what is wrong. */
static const char *parse_row(const char *text, int32_t expected, double *fibre) {
    char *end;
    errno = 0;
    long long tet = strtoll(text, &end, 10);
    if (end == text || *end != ',') return "a row is tet,ax,ay,az";
    if (errno || tet != expected) return "rows count tetrahedra from 0 in file order, each once";
    double a[3];
    for (int i = 0; i < 3; i++) {
        const char *from = end + 1;
        a[i] = strtod(from, &end);
        if (end == from || (i < 2 && *end != ',')) return "a row is tet,ax,ay,az";
    }
    end += strspn(end, " \t\r\n");
    if (*end) return "something follows the fourth column";
    double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    if (!isfinite(length)) return "a direction is not finite";
    if (length < 1e-6) return "a direction has no length";
    for (int i = 0; i < 3; i++) fibre[3 * (size_t)expected + (size_t)i] = a[i] / length;
    return NULL;
}

static tm_status read_rows(FILE *file, int32_t tet_count, double *fibre, int *line, tm_error *error) {
    char text[256];
    int32_t row = 0;
    *line = 1;
    if (!fgets(text, sizeof text, file))
        return app_mesh_fail(error, TM_ERR_FILE, -1, "the file is empty; its first line is tet,ax,ay,az");
    text[strcspn(text, "\r\n")] = 0;
    if (strcmp(text, "tet,ax,ay,az") != 0)
        return app_mesh_fail(error, TM_ERR_FILE, -1, "header '%.40s'; write tet,ax,ay,az", text);
    for (*line = 2; fgets(text, sizeof text, file); ++*line) {
        if (strspn(text, " \t\r\n") == strlen(text)) continue;
        if (row >= tet_count)
            return app_mesh_fail(error, TM_ERR_FILE, -1,
                                 "more rows than the mesh's %d tetrahedra; is it the fibre file of another mesh?",
                                 tet_count);
        const char *wrong = parse_row(text, row, fibre);
        if (wrong)
            return app_mesh_fail(error, TM_ERR_FILE, row, "tetrahedron %d expected here: %s; correct the row", row,
                                 wrong);
        row++;
    }
    if (ferror(file)) return app_mesh_fail(error, TM_ERR_FILE, -1, "%s; check the file", strerror(errno));
    if (row < tet_count)
        return app_mesh_fail(error, TM_ERR_FILE, row,
                             "ends after %d rows, the mesh has %d tetrahedra; is it the fibre file of another mesh?",
                             row, tet_count);
    return TM_OK;
}

tm_status app_fibres_load(const char *path, int32_t tet_count, double *fibre, int *line, tm_error *error) {
    int here = 0;
    if (!line) line = &here;
    *line = 0;
    struct stat info;
    if (stat(path, &info) == 0 && S_ISDIR(info.st_mode))
        return app_mesh_fail(error, TM_ERR_FILE, -1, "is a folder; name the CSV file in it");
    FILE *file = fopen(path, "r");
    if (!file) return app_mesh_fail(error, TM_ERR_FILE, -1, "cannot open: %s; check the path", strerror(errno));
    tm_status status = read_rows(file, tet_count, fibre, line, error);
    fclose(file);
    return status;
}
