/* Reads triangles from STL, text or binary. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "signed_distance.h"

typedef struct stl {
    int triangle_count;
    double *corner; /* [9*triangle_count] m */
} stl;

static tm_status add_triangle(stl *s, const double p[9], double scale, int *room, tm_error *error) {
    if (s->triangle_count == *room) {
        *room = *room ? 2 * *room : 1024;
        double *grown = realloc(s->corner, 9 * (size_t)*room * sizeof *grown);
        if (!grown) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
        s->corner = grown;
    }
    for (int i = 0; i < 9; i++) {
        if (!isfinite(p[i]))
            return tm_fail(error, TM_ERR_MESH, s->triangle_count,
                           "triangle %d has a coordinate that is nan or infinite; save the surface again",
                           s->triangle_count + 1);
        s->corner[9 * (size_t)s->triangle_count + (size_t)i] = scale * p[i];
    }
    s->triangle_count++;
    return TM_OK;
}

static tm_status read_binary(stl *s, const unsigned char *bytes, uint32_t triangles, double scale, tm_error *error) {
    int room = 0;
    for (uint32_t t = 0; t < triangles; t++) {
        float f[12];
        double p[9];
        memcpy(f, bytes + 84 + 50 * (size_t)t, sizeof f);
        for (int i = 0; i < 9; i++) p[i] = f[3 + i];
        tm_status status = add_triangle(s, p, scale, &room, error);
        if (status) return status;
    }
    return TM_OK;
}

static tm_status read_text(stl *s, char *text, double scale, tm_error *error) {
    int room = 0, line = 0, corner = 0;
    double p[9];
    for (char *row; (row = strsep(&text, "\n"));) {
        line++;
        row += strspn(row, " \t");
        if (strncmp(row, "vertex", 6) != 0) continue;
        if (sscanf(row + 6, "%lf %lf %lf", &p[3 * corner], &p[3 * corner + 1], &p[3 * corner + 2]) != 3)
            return tm_fail(error, TM_ERR_FILE, -1,
                           "line %d: 'vertex' and three numbers are expected; save the surface again", line);
        if (++corner < 3) continue;
        corner = 0;
        tm_status status = add_triangle(s, p, scale, &room, error);
        if (status) return status;
    }
    return TM_OK;
}

tm_status shell_read_stl(const char *path, double scale, double **corner_m, int *triangles_read, tm_error *error) {
    stl found = {0}, *s = &found;
    FILE *file = fopen(path, "rb");
    if (!file) return tm_fail(error, TM_ERR_FILE, -1, "cannot open: %s; check the path", strerror(errno));
    char *bytes = NULL;
    size_t size = 0;
    bool whole = fseek(file, 0, SEEK_END) == 0 && (long)(size = (size_t)ftell(file)) >= 0 &&
                 fseek(file, 0, SEEK_SET) == 0 && size < ((size_t)1 << 40);
    bytes = whole ? malloc(size + 1) : NULL;
    whole = bytes && fread(bytes, 1, size, file) == size;
    fclose(file);
    tm_status status;
    uint32_t triangles = 0;
    if (whole) bytes[size] = 0;
    if (whole && size >= 84) memcpy(&triangles, bytes + 80, 4);
    if (!whole)
        status = tm_fail(error, TM_ERR_FILE, -1, "cannot be read; check the disk");
    else if (size >= 84 && size == 84 + 50 * (size_t)triangles && triangles > 0)
        status = read_binary(s, (unsigned char *)bytes, triangles, scale, error);
    else if (strncmp(bytes + strspn(bytes, " \t\r\n"), "solid", 5) == 0)
        status = read_text(s, bytes, scale, error);
    else
        status =
            tm_fail(error, TM_ERR_FILE, -1,
                    "it is neither text nor binary STL, or truncated; save the surface again, or correct its file name "
                    "extension");
    free(bytes);
    if (!status && s->triangle_count == 0)
        status = tm_fail(error, TM_ERR_MESH, -1, "it has no triangles; save the surface again");
    *corner_m = s->corner;
    *triangles_read = s->triangle_count;
    return status;
}
