/* Shared by the parts of the benchmark. Every part warms up, interleaves the compared cases, and reports quantiles. */
#ifndef TM_BENCH_H
#define TM_BENCH_H

#include <cjson/cJSON.h>

#include "tensormass.h"

typedef struct bench_run {
    bool quick;
    int size_count;
    const int *cells; /* [size_count] cubes along each edge of the block, six tetrahedra each */
} bench_run;

/* Writes min, p50, p99, max (and mean) of `count` values as an object; sorts them. */
cJSON *bench_quantiles(double *value, int count);
/* Makes a block of cells^3 cubes; stops the program if memory is exhausted. */
tm_mesh *bench_block(int cells);
tm_mesh *bench_block_of(int cells, double side_m); /* bench_block: 0.1 m */
tm_tissue *bench_tissue(const tm_mesh *mesh, tm_precision precision, tm_force_form form, bool cuttable);
/* Makes a world with what every plain scene has: force, gravity, damping, the lowest vertices fixed. */
tm_world *bench_world(tm_tissue *tissue, int threads);
void bench_must(tm_status status, const tm_error *error);

cJSON *bench_force(const bench_run *run);
cJSON *bench_numbering(const bench_run *run);
cJSON *bench_step(const bench_run *run);
cJSON *bench_law(const bench_run *run);
cJSON *bench_effects(const bench_run *run);
cJSON *bench_touch(const bench_run *run);
cJSON *bench_hybrid(const bench_run *run);
cJSON *bench_cut(const bench_run *run);
cJSON *bench_capacity(const bench_run *run);

#endif
