/* The effect "viscosity": its cost relative to the same tissue without it; the error of the complex modulus of a
 * harmonic strain against the closed form, by steps per cycle (histories are linear between steps); a ramp and hold of
 * liver. */
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"

/* --- a ramp and a hold --- */

/* A ramp of strain, then a hold, of tissue with the constants of a liver, against the closed form. The block is
 * stretched along one axis and contracts by half of it across, so its volume stays. Every vertex is prescribed: the
 * test concerns the integration of the histories, not the lateral dynamics.
 *
 * The constants are those of a perfused liver under fast compression: Sato, Yamamoto, Ito, Antona-Makoshi, Ejima,
 * Kamiji and Yasuki, IRCOBI Conference 2013, "Hyper-viscoelastic response of perfused liver under dynamic compression
 * and estimation of tissue strain thresholds with a liver finite element model". They were read from the open human
 * body model VIVA+ of February 2021, material 505001 "TX-Abdominal-Cavity-Liver-Sato-et-al-2013"
 * (model/common/vivaplus-materials.k, commit 105ebe27; units mm, ms, kg, GPa), not from the paper. The relaxed shear
 * modulus is half the sum of the products of its Ogden terms, at small strains. */

enum { TERMS = 3, SAMPLES = 60, CELLS = 3 };
static const double RELAXED_PA = 867, POISSON = 0.499, SHARE_PA[TERMS] = {6970, 58327, 35291},
                    TIME_S[TERMS] = {0.1, 0.01, 0.001}; /* 1 over 0.01, 0.1 and 1 /ms */
static const double STRAIN = 0.1, RAMP_S = 0.01, FIRST_S = 2e-4, LAST_S = 0.5;

static double sudden_Pa(void) {
    double sum = RELAXED_PA;
    for (int i = 0; i < TERMS; i++) sum += SHARE_PA[i];
    return sum;
}

/* Returns the stress after a strain that rises linearly to STRAIN within RAMP_S and stays. At constant volume Young's
 * modulus is three times the shear modulus. */
static double closed_Pa(double t) {
    const double ramp = fmin(t, RAMP_S);
    double sum = RELAXED_PA * ramp;
    for (int i = 0; i < TERMS; i++)
        sum += SHARE_PA[i] * TIME_S[i] * -expm1(-ramp / TIME_S[i]) * exp(-(t - ramp) / TIME_S[i]);
    return 3 * STRAIN / RAMP_S * sum;
}

/* Prescribes every vertex. */
static tm_status lead_all(const problem *p, tm_error *error) {
    const int32_t n = 3 * p->mesh->vertex_count;
    int32_t *dof = app_zeroed((size_t)n, sizeof *dof);
    double *zero = app_zeroed((size_t)n, sizeof *zero);
    for (int32_t i = 0; i < n; i++) dof[i] = i;
    return problem_hold(p->world, n, dof, zero, error);
}

/* Chooses the longest step that divides the ramp. */
static tm_status create(problem *p, tm_error *error) {
    problem_def def = problem_default(CELLS);
    def.fixed = false;
    tm_status status = tm_material_young(2 * (1 + POISSON) * sudden_Pa(), POISSON, &def.material, error);
    if (status == TM_OK) status = problem_create(&def, p, error);
    if (status != TM_OK) return status;
    def.dt_s = RAMP_S / ceil(RAMP_S / tm_world_step_s(p->world));
    problem_destroy(p);
    status = problem_create(&def, p, error);
    if (status == TM_OK) status = lead_all(p, error);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = TERMS;
    for (int i = 0; i < TERMS; i++) viscosity.term[i] = (tm_viscosity_term){TIME_S[i], SHARE_PA[i] / sudden_Pa(), 0};
    return status == TM_OK ? tm_stage_viscosity(p->world, &viscosity, error) : status;
}

/* Returns the axial minus the lateral stress, from the forces on two faces: free of pressure. */
static double pulled_Pa(const problem *p) {
    const double *f = tm_world_state(p->world)->force_N;
    double sum = 0;
    for (int32_t v = 0; v < p->mesh->vertex_count; v++) {
        const double *x = p->mesh->rest_m + 3 * (int64_t)v;
        if (x[2] > BLOCK_M - 1e-9) sum -= f[3 * v + 2];
        if (x[0] > BLOCK_M - 1e-9) sum += f[3 * v];
    }
    return sum / (BLOCK_M * BLOCK_M);
}

/* Appends rows at geometrically spaced times; `worst`, as a share of the peak, covers every step. */
static tm_status pull(double end_s, cJSON *rows, double *worst, tm_error *error) {
    problem p = {0};
    int sample = 0;
    tm_status status = create(&p, error);
    const double dt = status == TM_OK ? tm_world_step_s(p.world) : 1, peak = closed_Pa(RAMP_S);
    const int32_t n = status == TM_OK ? 3 * p.mesh->vertex_count : 0;
    for (int64_t step = 0; status == TM_OK && (double)step * dt <= end_s; step++) {
        const double share = STRAIN * fmin(1, (double)(step + 1) * dt / RAMP_S), t = (double)step * dt;
        for (int32_t i = 0; i < n; i++)
            tm_support_move(p.world, i, share * ((i % 3 == 2 ? 1 : -0.5) * p.mesh->rest_m[i]));
        status = tm_world_step(p.world, 1);
        const double found = pulled_Pa(&p), truly = closed_Pa(t); /* forces are those at the step's beginning */
        *worst = fmax(*worst, fabs(found - truly) / peak);
        if (t < FIRST_S * pow(LAST_S / FIRST_S, (double)sample / (SAMPLES - 1))) continue;
        sample++;
        app_json_add(rows, "time_s %g stress_Pa %g closed_Pa %g", t, found, truly);
    }
    problem_destroy(&p);
    return status;
}

static tm_status viscosity_ramp(const run *r, cJSON *out, tm_error *error) {
    double worst = 0;
    app_json_add(out, "sudden_shear_Pa %g poisson %g strain %g ramp_s %g", sudden_Pa(), POISSON, STRAIN, RAMP_S);
    cJSON *terms = cJSON_AddArrayToObject(out, "terms");
    for (int i = 0; i < TERMS; i++) {
        app_json_add(terms, "time_s %g shear %g", TIME_S[i], SHARE_PA[i] / sudden_Pa());
    }
    const tm_status status = pull(r->quick ? 0.05 : 0.5, cJSON_AddArrayToObject(out, "rows"), &worst, error);
    app_json_add(out, "worst %g", worst);
    return status;
}

/* --- error --- */

/* Computes the modulus in a cycle of `steps`, as a share of the instantaneous one, from the force on one vertex; x
 * sin(wt) is prescribed along x. Uses the third cycle, in which the start's transient is below exp(-12). */
static tm_status swing(int steps, double complex *modulus, tm_error *error) {
    problem_def def = problem_default(3);
    problem p;
    def.fixed = false;
    tm_status status = problem_create(&def, &p, error);
    if (status != TM_OK) return status;
    const double period = steps * tm_world_step_s(p.world), angular = 2 * M_PI / period;
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 1;
    viscosity.term[0] = (tm_viscosity_term){1 / angular, 0.5, 0.5};
    status = lead_all(&p, error);
    if (status == TM_OK) status = tm_stage_viscosity(p.world, &viscosity, error);
    const tm_state *s = status == TM_OK ? tm_world_state(p.world) : NULL;
    const int32_t n = 3 * p.mesh->vertex_count, at = n - 3;
    double complex sum = 0;
    double *elastic = app_zeroed((size_t)n, sizeof *elastic), *u = app_zeroed((size_t)n, sizeof *u);
    for (int32_t i = 0; i < n; i += 3) u[i] = 0.01 * p.mesh->rest_m[i];
    if (status == TM_OK) tm_tissue_force(p.tissue, u, elastic);
    for (int step = 0; step < 3 * steps && status == TM_OK; step++) {
        for (int32_t i = 0; i < n; i++) tm_support_move(p.world, i, u[i] * sin(angular * (step + 1) * s->dt_s));
        status = tm_world_step(p.world, 1);
        /* force_N is that at the step's beginning. */
        if (step >= 2 * steps) sum += s->force_N[at] * cexp(-I * (2 * M_PI * step / steps));
    }
    if (status == TM_OK) *modulus = I * 2 * sum / steps / elastic[at]; /* sin wt = Re(-i exp(iwt)) */
    free(elastic);
    free(u);
    problem_destroy(&p);
    return status;
}

static tm_status errors(const run *r, cJSON *rows, tm_error *error) {
    static const int steps[] = {5, 10, 20, 50, 200, 1000};
    const double complex truth = 1 - 0.5 / (1 + I); /* 1 - g/(1 + iwt), wt = 1 */
    const int count = r->quick ? 5 : 6;
    for (int i = 0; i < count; i++) {
        double complex modulus = 0;
        const tm_status status = swing(steps[i], &modulus, error);
        if (status != TM_OK) return status;
        app_json_add(rows, "steps_a_cycle %d modulus %g", steps[i], cabs(modulus - truth) / cabs(truth));
        r->progress("viscosity", 0.5 * (i + 1) / count);
    }
    return TM_OK;
}

/* --- cost --- */

enum { FORMS = 5 };
static tm_status prices(const run *r, int cells, cJSON *out, tm_error *error) {
    static const struct {
        int terms;
        const char *shares;
    } form[FORMS] = {{0, "none"}, {1, "alike"}, {3, "alike"}, {1, "shear"}, {3, "shear"}};
    problem p[FORMS];
    tm_world *world[FORMS];
    double seconds[FORMS];
    tm_status status = TM_OK;
    memset(p, 0, sizeof p);
    for (int i = 0; i < FORMS && status == TM_OK; i++) {
        problem_def def = problem_default(cells);
        tm_viscosity_def viscosity = tm_viscosity_def_default();
        for (; viscosity.count < form[i].terms; viscosity.count++)
            viscosity.term[viscosity.count] =
                (tm_viscosity_term){0.1 * (1 + viscosity.count), 0.2, strcmp(form[i].shares, "shear") ? 0.2 : 0};
        def.pressed = false;
        def.viscosity = form[i].terms ? &viscosity : NULL;
        status = problem_create(&def, &p[i], error);
        world[i] = p[i].world;
    }
    if (status == TM_OK) time_steps(world, FORMS, r->rounds, seconds);
    for (int i = 0; i < FORMS && status == TM_OK; i++) {
        tm_stage_report stage[TM_MAX_STAGES];
        const int32_t stages = tm_world_stages(world[i], stage);
        int64_t bytes = 0;
        for (int32_t k = 0; k < stages; k++) bytes += strcmp(stage[k].name, "viscosity") ? 0 : stage[k].bytes;
        app_json_add(out, "terms %d shares %s seconds_per_step %g price %g bytes %g", form[i].terms, form[i].shares,
                     seconds[i], seconds[i] / seconds[0], (double)bytes);
    }
    for (int i = 0; i < FORMS; i++)
        if (p[i].world) problem_destroy(&p[i]);
    return status;
}

tm_status knob_viscosity(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    const int cells = r->quick ? 6 : 18;
    app_json_add(out, "tets %g", 6.0 * cells * cells * cells);
    tm_status status = errors(r, rows, error);
    if (status == TM_OK) status = viscosity_ramp(r, cJSON_AddObjectToObject(out, "ramp"), error);
    r->progress("viscosity", 0.75);
    if (status == TM_OK) status = prices(r, cells, cJSON_AddArrayToObject(out, "price"), error);
    r->progress("viscosity", 1);
    return status;
}
