/* Tissue with the effect "rotation": crushed flat, inverted, spun fast. Each is left free and must recover, or
 * continue, with the guaranteed step. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"

static const double oblique[3] = {1.0 / 3, 2.0 / 3, 2.0 / 3};

enum { PLAIN, FIBRED, NEAR_INCOMPRESSIBLE }; /* the last one with the effect "strain_smoothing" */

static bool open_turning(int tissue, double damping, app_bench *b, outcome *o) {
    app_bench_def def = bench_default();
    tm_error error = {0};
    const bool fibred = tissue == FIBRED;
    if (fibred && tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &def.material[0], &error) != TM_OK) abort();
    if (tissue == NEAR_INCOMPRESSIBLE) {
        if (tm_material_young(5e3, 0.49, &def.material[0], &error) != TM_OK) abort();
        def.volume = true, def.smoothed_shear_share = 0;
    }
    def.fibre = fibred ? oblique : NULL;
    def.material[0].damping_1_s = damping;
    def.rotation = TM_ROTATION_THRESHOLD;
    def.held = 0;
    return bench_open(&def, b, o);
}

void turn_inside_out(app_bench *b) {
    tm_state *s = tm_world_state(b->world);
    uint64_t seed = 5;
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++)
        s->u_m[i] = s->u_prev_m[i] = 0.02 + 0.01 * random_unit(&seed) - b->mesh->rest_m[i];
}

static double stored(const app_bench *b) {
    const double *u = tm_world_state(b->world)->u_m;
    return tm_tissue_energy(b->tissue, u) + tm_rotation_energy(b->rotation, u);
}

void come_back(app_bench *b, double seconds, outcome *o) {
    const double start = stored(b);
    const int32_t piece = (int32_t)(seconds / 100 / tm_world_step_s(b->world));
    o->x_name = "simulated s", o->y_name = "energy / energy at the start";
    for (int i = 0; i < 100; i++) {
        if (tm_world_step(b->world, piece) != TM_OK) {
            broken(o, "displacements stopped being finite");
            return;
        }
        series_add(o, tm_world_state(b->world)->time_s, stored(b) / start);
    }
    stable(o, stored(b) / start, "after %.0f s %.1e of the energy is left: it has its shape again", seconds,
           stored(b) / start);
}

static void inside_out(bool quick, double tissue, outcome *o) {
    app_bench b;
    (void)quick;
    if (!open_turning((int)tissue, 30, &b, o)) return;
    turn_inside_out(&b);
    come_back(&b, 8, o);
    app_bench_close(&b);
}

/* Crushes the block to 1/50 of its height (argument 0.02), or through its floor (negative). */
static void crushed(bool quick, double height, outcome *o) {
    app_bench b;
    (void)quick;
    if (!open_turning(PLAIN, 30, &b, o)) return;
    tm_state *s = tm_world_state(b.world);
    uint64_t seed = 5;
    for (int32_t i = 0; i < 3 * b.mesh->vertex_count; i++)
        s->u_m[i] = s->u_prev_m[i] =
            (i % 3 == 2 ? (height - 1) * b.mesh->rest_m[i] : 0) + 1e-5 * random_unit(&seed); /* no perfect symmetry */
    come_back(&b, 8, o);
    app_bench_close(&b);
}

/* Spins free and undamped at `rate`, rad/s: the scheme's energy must be conserved. Below 0: nearly incompressible. */
static void spun(bool quick, double rate, outcome *o) {
    app_bench b;
    tm_error error = {0};
    tm_energy e;
    if (!open_turning(rate < 0 ? NEAR_INCOMPRESSIBLE : PLAIN, 0, &b, o)) return;
    rate = fabs(rate);
    if (tm_stage_energy(b.world, &error) != TM_OK) {
        refused(o, &error);
        app_bench_close(&b);
        return;
    }
    tm_state *s = tm_world_state(b.world);
    const double a = rate * tm_world_step_s(b.world);
    for (int32_t v = 0; v < b.mesh->vertex_count; v++) {
        const double x = b.mesh->rest_m[3 * v] - 0.02, y = b.mesh->rest_m[3 * v + 1] - 0.02;
        s->u_prev_m[3 * v] = x * (cos(a) - 1) + y * sin(a);
        s->u_prev_m[3 * v + 1] = -x * sin(a) + y * (cos(a) - 1);
    }
    double worst = 0;
    const int pieces = 200, steps = quick ? 50 : 1000;
    o->x_name = "simulated s", o->y_name = "energy / energy at the start";
    for (int i = 0; i < pieces; i++) {
        if (tm_world_step(b.world, steps) != TM_OK || tm_world_energy(b.world, &e, &error) != TM_OK) {
            broken(o, "displacements stopped being finite");
            app_bench_close(&b);
            return;
        }
        const double now = (e.kinetic_J + e.elastic_J) / e.start_J;
        worst = fmax(worst, fabs(now - 1));
        series_add(o, s->time_s, now);
    }
    stable(o, worst, "energy within %.1e over %d steps, %.0f turns", worst, pieces * steps,
           rate * s->time_s / (2 * M_PI));
    app_bench_close(&b);
}

#define ROTATION "rotation"
const hard_case cases_rotation[] = {
    {ROTATION, "inside-out", "every vertex anywhere in a box of half the size", STABLE, 1e-6, "energy left", inside_out,
     0},
    {ROTATION, "inside-out-fibred", "the same with fibres", STABLE, 1e-6, "energy left", inside_out, FIBRED},
    {ROTATION, "inside-out-volume", "the same with nu 0.49 and volume averaged", STABLE, 1e-6, "energy left",
     inside_out, NEAR_INCOMPRESSIBLE},
    {ROTATION, "crushed", "crushed to a fiftieth of its height", STABLE, 1e-6, "energy left", crushed, 0.02},
    {ROTATION, "mirrored", "pushed through its own floor, to a mirror image of half the height", STABLE, 1e-6,
     "energy left", crushed, -0.5},
    {ROTATION, "spun", "a free block, undamped, at 5 turns a second", STABLE, 0.02, "energy drift", spun, 31.4},
    {ROTATION, "spun-fast", "at 8 turns a second, which stretches it", STABLE, 0.05, "energy drift", spun, 50.3},
    {ROTATION, "spun-volume", "at 5 turns a second with nu 0.49 and volume averaged", STABLE, 0.02, "energy drift",
     spun, -31.4},
};
const int cases_rotation_count = sizeof cases_rotation / sizeof *cases_rotation;
