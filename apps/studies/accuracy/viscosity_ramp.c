/* A ramp of strain, then a hold, of tissue with the constants of a liver, against the closed form. It is pulled along
 * and shrinks by half of it across, so that its volume stays; every vertex is led, for what is asked is how the
 * histories integrate, not how fast a specimen's sides follow.
 *
 * The constants are those of a perfused liver under fast compression: Sato, Yamamoto, Ito, Antona-Makoshi, Ejima,
 * Kamiji and Yasuki, IRCOBI Conference 2013, "Hyper-viscoelastic response of perfused liver under dynamic compression
 * and estimation of tissue strain thresholds with a liver finite element model". Read not there but in the open human
 * body model VIVA+ of February 2021, material 505001 "TX-Abdominal-Cavity-Liver-Sato-et-al-2013"
 * (model/common/vivaplus-materials.k, commit 105ebe27; units mm, ms, kg, GPa). Its shear modulus when all has relaxed
 * is half the sum of its Ogden terms' products: small strains. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"

enum { TERMS = 3, SAMPLES = 60, CELLS = 3 };
static const double RELAXED_PA = 867, POISSON = 0.499, SHARE_PA[TERMS] = {6970, 58327, 35291},
                    TIME_S[TERMS] = {0.1, 0.01, 0.001}; /* 1 over 0.01, 0.1 and 1 /ms */
static const double STRAIN = 0.1, RAMP_S = 0.01, FIRST_S = 2e-4, LAST_S = 0.5;

/* --- closed form --- */

static double sudden_Pa(void) {
    double sum = RELAXED_PA;
    for (int i = 0; i < TERMS; i++) sum += SHARE_PA[i];
    return sum;
}

/* Three times the shear modulus is Young's where no volume changes; after a strain that rises evenly to STRAIN in
 * RAMP_S and stays. */
static double closed_Pa(double t) {
    const double ramp = fmin(t, RAMP_S);
    double sum = RELAXED_PA * ramp;
    for (int i = 0; i < TERMS; i++)
        sum += SHARE_PA[i] * TIME_S[i] * -expm1(-ramp / TIME_S[i]) * exp(-(t - ramp) / TIME_S[i]);
    return 3 * STRAIN / RAMP_S * sum;
}

/* --- tissue --- */

/* Holds all; `unit_m`: the displacement of each component at a strain of 1. */
static tm_status lead(problem *p, double **unit_m, tm_error *error) {
    const int32_t n = 3 * p->mesh->vertex_count;
    int32_t *dof = malloc(sizeof *dof * (size_t)n);
    double *zero = calloc((size_t)n, sizeof *zero);
    *unit_m = malloc(sizeof **unit_m * (size_t)n);
    for (int32_t d = 0; dof && *unit_m && d < n; d++) {
        dof[d] = d;
        (*unit_m)[d] = (d % 3 == 2 ? 1 : -0.5) * p->mesh->rest_m[d];
    }
    if (*unit_m) return problem_hold(p->world, n, dof, zero, error);
    free(dof);
    free(zero);
    return problem_no_memory(error);
}

/* As long a step as divides the ramp. */
static tm_status create(problem *p, double **unit_m, tm_error *error) {
    problem_def def = problem_default(CELLS);
    def.held = false;
    tm_status status = tm_material_young(2 * (1 + POISSON) * sudden_Pa(), POISSON, &def.material, error);
    if (status == TM_OK) status = problem_create(&def, p, error);
    if (status != TM_OK) return status;
    def.dt_s = RAMP_S / ceil(RAMP_S / tm_world_step_s(p->world));
    problem_destroy(p);
    status = problem_create(&def, p, error);
    if (status == TM_OK) status = lead(p, unit_m, error);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = TERMS;
    for (int i = 0; i < TERMS; i++) viscosity.term[i] = (tm_viscosity_term){TIME_S[i], SHARE_PA[i] / sudden_Pa(), 0};
    return status == TM_OK ? tm_stage_viscosity(p->world, &viscosity, error) : status;
}

/* Along less across, from the forces on two faces: no pressure is in it. */
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

/* Rows at times that grow evenly by a factor; `worst`, as a share of the peak, is of every step. */
static tm_status pull(double end_s, cJSON *rows, double *worst, tm_error *error) {
    problem p = {0};
    double *unit_m = NULL;
    int sample = 0;
    tm_status status = create(&p, &unit_m, error);
    const double dt = status == TM_OK ? tm_world_step_s(p.world) : 1, peak = closed_Pa(RAMP_S);
    const int32_t n = status == TM_OK ? 3 * p.mesh->vertex_count : 0;
    for (int64_t step = 0; status == TM_OK && (double)step * dt <= end_s; step++) {
        const double share = STRAIN * fmin(1, (double)(step + 1) * dt / RAMP_S), t = (double)step * dt;
        for (int32_t i = 0; i < n; i++) tm_support_move(p.world, i, share * unit_m[i]);
        status = tm_world_step(p.world, 1);
        const double found = pulled_Pa(&p), truly = closed_Pa(t); /* forces are of the step's beginning */
        *worst = fmax(*worst, fabs(found - truly) / peak);
        if (t < FIRST_S * pow(LAST_S / FIRST_S, (double)sample / (SAMPLES - 1))) continue;
        sample++;
        app_json_add(rows, "time_s %g stress_Pa %g closed_Pa %g", t, found, truly);
    }
    free(unit_m);
    problem_destroy(&p);
    return status;
}

tm_status viscosity_ramp(const run *r, cJSON *out, tm_error *error) {
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
