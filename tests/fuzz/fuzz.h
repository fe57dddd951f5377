/* Shared by the fuzz targets. A violated property is a trap, which libFuzzer reports with the input. */
#ifndef TM_FUZZ_H
#define TM_FUZZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tensormass.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerInitialize(int *argc, char ***argv);

#define PROMISE(what)                                                                                                  \
    do                                                                                                                 \
        if (!(what)) {                                                                                                 \
            fprintf(stderr, "%s:%d: promise broken: %s\n", __FILE__, __LINE__, #what);                                 \
            __builtin_trap();                                                                                          \
        }                                                                                                              \
    while (0)

typedef struct fuzz_bytes {
    const uint8_t *at;
    size_t left;
} fuzz_bytes;

/* Reads from the input; zeros after its end. */
static inline void fuzz_take(fuzz_bytes *b, void *out, size_t count) {
    size_t n = count < b->left ? count : b->left;
    memset(out, 0, count);
    if (n) memcpy(out, b->at, n);
    b->at += n;
    b->left -= n;
}
static inline uint8_t fuzz_u8(fuzz_bytes *b) {
    uint8_t x;
    fuzz_take(b, &x, 1);
    return x;
}

/* Returns a copy of exactly this size, so that a read beyond its end is detected. */
static inline void *fuzz_copy(const void *data, size_t size) {
    void *copy = malloc(size + !size);
    if (size) memcpy(copy, data, size);
    return copy;
}

/* Returns the folder for a target's files: run.py gives each run its own and removes it. */
static inline const char *fuzz_folder(void) {
    const char *folder = getenv("TM_FUZZ_DIR");
    return folder ? folder : "/dev/shm";
}

/* Writes the input to a file that is deleted with the process; the name is valid until the next call. */
static inline const char *fuzz_file(const void *data, size_t size, const char *ending) {
    static char path[200], before[200];
    if (before[0]) unlink(before);
    snprintf(path, sizeof path, "%s/tm-fuzz-%ld%s", fuzz_folder(), (long)getpid(), ending);
    FILE *file = fopen(path, "wb");
    PROMISE(file && (!size || fwrite(data, 1, size, file) == size) && fclose(file) == 0);
    memcpy(before, path, sizeof before);
    return path;
}

/* Makes n x n x n boxes of 10 mm / n, six tetrahedra each, in the caller's arrays. Shared by targets that need a
 * body. */
typedef struct fuzz_body {
    tm_mesh *mesh;
    tm_tissue *tissue;
    uint8_t *fixed; /* [3*vertex_count] fixed where z = 0 */
} fuzz_body;

static inline fuzz_body fuzz_block(int n, bool cuttable) {
    static const int path[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
    int side = n + 1, vertices = side * side * side, tets = 6 * n * n * n, step[3] = {1, side, side * side}, t = 0;
    double *p = malloc(3 * (size_t)vertices * sizeof *p);
    int32_t *tet = malloc(4 * (size_t)tets * sizeof *tet);
    for (int v = 0; v < vertices; v++)
        for (int k = 0; k < 3; k++) p[3 * v + k] = 0.01 * (v / step[k] % side) / n;
    for (int v = 0; v < vertices; v++) {
        if (v % side == n || v / side % side == n || v / side / side == n) continue;
        for (int o = 0; o < 6; o++, t++) {
            int32_t *c = tet + 4 * t;
            c[0] = v;
            for (int k = 0; k < 3; k++) c[k + 1] = c[k] + step[path[o][k]];
            if (o >= 3) {
                int32_t spare = c[1];
                c[1] = c[2];
                c[2] = spare;
            }
        }
    }
    fuzz_body b = {0};
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = vertices;
    def.vertex_m = p;
    def.tet_count = tets;
    def.tet = tet;
    PROMISE(tm_mesh_create(&def, &b.mesh, NULL) == TM_OK);
    tm_material material;
    PROMISE(tm_material_young(5000, 0.4, &material, NULL) == TM_OK);
    material.damping_1_s = 20;
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = b.mesh;
    tissue.material_count = 1;
    tissue.material = &material;
    tissue.form = TM_FORCE_PLAIN;
    tissue.cuttable = cuttable;
    PROMISE(tm_tissue_create(&tissue, &b.tissue, NULL) == TM_OK);
    b.fixed = calloc(3 * (size_t)vertices, 1);
    for (int i = 0; i < 3 * vertices; i++) b.fixed[i] = p[i / 3 * 3 + 2] < 1e-9;
    free(p);
    free(tet);
    return b;
}

#endif
