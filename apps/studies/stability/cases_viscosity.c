/* Tissue with the effect "viscosity": relaxation times far below a step and far above any session, shares that leave
 * almost no stiffness, and tetrahedra removed during relaxation. The step is that of the tissue without it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "stability.h"

/* Computes the mean square speed at the end of the run over that at its beginning: undamped, from random velocities. */
static void swing(app_bench *b, int64_t steps, outcome *o) {
    const tm_state *s = tm_world_state(b->world);
    const int32_t n = 3 * b->mesh->vertex_count;
    double first = 0, last = 0;
    random_velocities(b, 12345, 0.1);
    o->x_name = "simulated s", o->y_name = "speed, m/s (root mean square)";
    for (int i = 0; i < 200; i++) {
        if (tm_world_step(b->world, (int32_t)(steps / 200)) != TM_OK) {
            broken(o, "displacements stopped being finite");
            return;
        }
        double speed = 0;
        for (int32_t c = 0; c < n; c++) speed += (s->u_m[c] - s->u_prev_m[c]) * (s->u_m[c] - s->u_prev_m[c]);
        if (i < 40) first += speed;
        if (i >= 160) last += speed;
        series_add(o, s->time_s, sqrt(speed / n) / s->dt_s);
    }
    stable(o, last / first, "of the squares of speeds at the start %.2g are left after %lld steps of %.3g us",
           last / first, (long long)steps, 1e6 * s->dt_s);
}

static void relaxing(bool quick, const tm_viscosity_term *term, int32_t count, bool volume, outcome *o) {
    app_bench b;
    app_bench_def def = bench_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = count;
    memcpy(viscosity.term, term, sizeof *term * (size_t)count);
    def.viscosity = &viscosity, def.volume = volume;
    if (!bench_open(&def, &b, o)) return;
    swing(&b, quick ? 4000 : 200000, o);
    app_bench_close(&b);
}

static void alone(bool quick, double time_s, outcome *o) {
    relaxing(quick, &(tm_viscosity_term){time_s, 0.9999, 0.9999}, 1, false, o);
}

static void shear_alone(bool quick, double time_s, outcome *o) {
    relaxing(quick, &(tm_viscosity_term){time_s, 0.9999, 0}, 1, false, o);
}

static void three(bool quick, double unused, outcome *o) {
    static const tm_viscosity_term term[3] = {{1e-5, 0.5, 0.1}, {2e-3, 0.3, 0.8}, {10, 0.1999, 0}};
    (void)unused;
    relaxing(quick, term, 3, true, o);
}

/* Perfused liver under fast compression (source: apps/studies/accuracy/knob_viscosity.c): 99 % of the shear relaxes
 * within 0.1 s; the bulk does not and is nearly incompressible. */
static void liver(bool quick, double poisson, outcome *o) {
    app_bench b;
    app_bench_def def = bench_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 3;
    viscosity.term[0] = (tm_viscosity_term){1e-3, 0.3479, 0};
    viscosity.term[1] = (tm_viscosity_term){1e-2, 0.5749, 0};
    viscosity.term[2] = (tm_viscosity_term){0.1, 0.0687, 0};
    if (tm_material_young(2 * (1 + poisson) * 101455, poisson, &def.material[0], NULL) != TM_OK) abort();
    def.viscosity = &viscosity, def.volume = true;
    if (!bench_open(&def, &b, o)) return;
    swing(&b, quick ? 4000 : 200000, o);
    app_bench_close(&b);
}

/* With `rotation`: places every vertex at random in a box of half the size and leaves it free. Reports the remaining
 * energy after 8 s. */
static void inside_out(bool quick, double fibred, outcome *o) {
    static const double oblique[3] = {1.0 / 3, 2.0 / 3, 2.0 / 3};
    app_bench b;
    app_bench_def def = bench_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    (void)quick;
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.4, 0.2}, viscosity.term[1] = (tm_viscosity_term){0.2, 0.4, 0.6};
    if (fibred > 0 && tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &def.material[0], NULL) != TM_OK) abort();
    def.fibre = fibred > 0 ? oblique : NULL;
    def.viscosity = &viscosity, def.material[0].damping_1_s = 30, def.rotation = TM_ROTATION_THRESHOLD, def.held = 0;
    if (!bench_open(&def, &b, o)) return;
    turn_inside_out(&b);
    come_back(&b, 8, o);
    app_bench_close(&b);
}

static double difference(const app_bench *b, const double *truth) {
    const double *u = tm_world_state(b->world)->u_m;
    double off = 0, most = 0;
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++)
        off = fmax(off, fabs(u[i] - truth[i])), most = fmax(most, fabs(truth[i]));
    return off / most;
}

/* Removes a fifth of the tetrahedra one by one while the block relaxes under its own weight. Its final shape must be
 * the settled one. */
static void cut(bool quick, double unused, outcome *o) {
    app_bench b;
    app_bench_def def = bench_default();
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    tm_error error = {0};
    (void)quick, (void)unused;
    viscosity.count = 2;
    viscosity.term[0] = (tm_viscosity_term){0.02, 0.4, 0.1}, viscosity.term[1] = (tm_viscosity_term){0.2, 0.3, 0.2};
    def.viscosity = &viscosity, def.cuttable = true, def.material[0].damping_1_s = 30;
    if (!bench_open(&def, &b, o)) return;
    const double g[3] = {0, 0, -9.81};
    const tm_settle_def settle = tm_settle_def_default();
    double *truth = app_zeroed(3 * (size_t)b.mesh->vertex_count, sizeof *truth);
    tm_status status = tm_stage_gravity(b.world, g, &error);
    for (int32_t t = b.mesh->tet_count - 1; t > b.mesh->tet_count * 4 / 5 && status == TM_OK; t--) {
        tm_cut_remove(b.tissue, &t, 1, NULL, 0);
        status = tm_world_step(b.world, 3);
    }
    const int32_t piece = (int32_t)(0.04 / tm_world_step_s(b.world));
    for (int i = 0; i < 100 && status == TM_OK; i++) status = tm_world_step(b.world, piece);
    if (status == TM_OK) {
        memcpy(truth, tm_world_state(b.world)->u_m, sizeof *truth * 3 * (size_t)b.mesh->vertex_count);
        status = tm_world_settle(b.world, &settle, NULL, &error);
    }
    if (status == TM_OK)
        accurate(o, difference(&b, truth), "after 4 s it lies within %.1e of its displacement from where it settles",
                 difference(&b, truth));
    else
        broken(o, "%s: %s", tm_status_name(status), error.message);
    free(truth);
    app_bench_close(&b);
}

#define VISCOSITY "viscosity"
const hard_case cases_viscosity[] = {
    {VISCOSITY, "viscosity-1us", "all but 1e-4 of it relaxes in a microsecond", STABLE, 1.1, "squared speed left",
     alone, 1e-6},
    {VISCOSITY, "viscosity-step", "the same in about a step", STABLE, 1.1, "squared speed left", alone, 5e-4},
    {VISCOSITY, "viscosity-1e6s", "the same in a million seconds", STABLE, 1.1, "squared speed left", alone, 1e6},
    {VISCOSITY, "viscosity-shear", "all but 1e-4 of the shear in about a step, of the volume nothing", STABLE, 1.1,
     "squared speed left", shear_alone, 5e-4},
    {VISCOSITY, "viscosity-three", "three terms from 10 us to 10 s, with volume", STABLE, 1.1, "squared speed left",
     three, 0},
    {VISCOSITY, "viscosity-liver", "a liver's shear relaxing by 99 % at nu = 0.499, with volume", STABLE, 1.1,
     "squared speed left", liver, 0.499},
    {VISCOSITY, "viscosity-inside-out", "with rotation, every vertex anywhere in a box of half the size", STABLE, 1e-5,
     "energy left", inside_out, 0},
    {VISCOSITY, "viscosity-inside-out-fibred", "the same with fibres", STABLE, 1e-5, "energy left", inside_out, 1},
    {VISCOSITY, "viscosity-cut", "a fifth of its tetrahedra removed while it relaxes under its weight", ACCURATE, 1e-4,
     "displacement", cut, 0},
};
const int cases_viscosity_count = sizeof cases_viscosity / sizeof *cases_viscosity;
