/* A block of tissue in a world, ready to step, for studies and stability cases. */
#ifndef TM_BENCH_H
#define TM_BENCH_H

#include "tensormass.h"

typedef struct app_bench {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_rotation *rotation; /* or null */
} app_bench;

typedef struct app_bench_def {
    int32_t cells[3];
    double size_m[3];
    tm_material material[2];
    int material_count; /* 2: the second fills the upper half, or the region that `second` gives */
    bool (*second)(const double centre_m[3]);
    const double *fibre; /* one direction for all, or null */
    tm_precision precision;
    double dt_s; /* 0: step_fraction times the guaranteed step */
    double step_fraction;
    bool cuttable;
    double scaled_step_s, scaled_share; /* as tm_tissue_def has them */
    double rotation;                    /* |grad u| above which tetrahedra are corotated; 0: linear */
    bool volume;                        /* strain smoothing is on */
    double smoothed_shear_share;
    const tm_viscosity_def *viscosity; /* viscosity of the effect of that name; null: none */
    enum { APP_HELD_NOT, APP_HELD_ONCE, APP_HELD_BOTTOM, APP_HELD_ALL } held;
    /* Changes the vertex positions before the mesh is built; may be null. */
    void (*deform)(double *vertex_m, int32_t vertex_count, double argument);
    double argument;
} app_bench_def;

/* Returns the default: liver of 5 kPa, nu = 0.45, undamped, bottom fixed, 0.9 times the guaranteed step. */
app_bench_def app_bench_default(int32_t cells, double size_m);
tm_status app_bench_open(const app_bench_def *def, app_bench *b, tm_error *error);
/* Builds the same world on the mesh that `b` already has. Its lowest layer of vertices comes first. */
tm_status app_bench_start(const app_bench_def *def, app_bench *b, tm_error *error);
void app_bench_close(app_bench *b);

#endif
