/* Tissue with the effect "strain_smoothing": nearly incompressible, stiff next to soft, a sliver, rotated fibres. The
 * step is the guaranteed one, whose bound covers the averaged strains. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "stability.h"

/* Runs undamped from random velocities at 0.95 times the guaranteed step. Reports the scheme's energy, and the step
 * relative to linear tetrahedra. */
static void swing(app_bench_def *def, bool quick, outcome *o) {
    app_bench b, linear;
    outcome ignored = {0};
    def->volume = true;
    if (!bench_open(def, &b, o)) return;
    const int64_t steps = quick ? 20000 : 200000;
    const double dt = tm_world_step_s(b.world), drift = energy_drift(&b, steps, o);
    double gain = 0;
    def->volume = false;
    if (bench_open(def, &linear, &ignored)) {
        gain = dt / tm_world_step_s(linear.world);
        app_bench_close(&linear);
    }
    if (drift < 0)
        broken(o, "displacements stopped being finite");
    else
        stable(o, drift, "energy within %.1e over %lld steps of %.3g us, %.2f times those of linear tetrahedra", drift,
               (long long)steps, 1e6 * dt, gain);
    app_bench_close(&b);
}

static void poisson(bool quick, double nu, outcome *o) {
    app_bench_def def = bench_default();
    if (tm_material_young(5e3, nu, &def.material[0], NULL) != TM_OK) abort();
    swing(&def, quick, o);
}

static void contrast(bool quick, double ratio, outcome *o) {
    app_bench_def def = bench_default();
    def.material_count = 2;
    if (tm_material_young(5e3 * ratio, 0.49, &def.material[1], NULL) != TM_OK) abort();
    swing(&def, quick, o);
}

static void squash(double *v, int32_t count, double aspect) {
    (void)count;
    double *inner = v + 3 * (2 + 5 * (2 + 5 * 2)), *base = v + 3 * (1 + 5 * (2 + 5 * 2));
    inner[0] = base[0] + 0.01 / aspect;
}

static void sliver(bool quick, double aspect, outcome *o) {
    app_bench_def def = bench_default();
    def.deform = squash, def.argument = aspect;
    swing(&def, quick, o);
}

static void fibred(bool quick, double shear, outcome *o) {
    static const double oblique[3] = {1.0 / 3, 2.0 / 3, 2.0 / 3};
    app_bench_def def = bench_default();
    def.fibre = oblique, def.smoothed_shear_share = shear;
    if (tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &def.material[0], NULL) != TM_OK) abort();
    swing(&def, quick, o);
}

#define VOLUME "tissue"
const hard_case cases_volume[] = {
    {VOLUME, "volume-0.45", "volume, nu = 0.45", STABLE, 1e-9, "energy drift", poisson, 0.45},
    {VOLUME, "volume-0.4999", "volume, nu = 0.4999, nearly incompressible", STABLE, 1e-9, "energy drift", poisson,
     0.4999},
    {VOLUME, "volume-contrast-1e4", "volume, soft below, 1e4 times stiffer above", STABLE, 1e-7, "energy drift",
     contrast, 1e4},
    {VOLUME, "volume-sliver-1e3", "volume, a sliver of aspect 1e3", STABLE, 1e-7, "energy drift", sliver, 1e3},
    {VOLUME, "volume-fibred", "volume, fibred, all shears averaged over edges", STABLE, 1e-9, "energy drift", fibred,
     1},
};
const int cases_volume_count = sizeof cases_volume / sizeof *cases_volume;
