/* Nonlinear laws: verified against an independent solution on the same mesh and on a finer one
 * (reference/law_cases.py), error of each form of tissue by the depth of an indentation, and the price. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "app.h"
#include "law_block.h"

static const law_form LAW = {"law", true, false, false, 0};
/* The limit for tissue that is pressed deeper: fewer tetrahedra go on linearly, at a shorter step. */
static const law_form FAR = {"law, stretch 2", true, false, false, 2};

/* Forms of tissue that stand for one that follows a law. */
enum { FORMS = 5 };
static const law_form forms[FORMS] = {{"linear", false, false, false, 0},
                                      {"rotation", false, true, false, 0},
                                      {"rotation, strain_smoothing", false, true, true, 0},
                                      {"law", true, false, false, 0},
                                      {"law, strain_smoothing", true, false, true, 0}};

/* --- laws.json --- */

static const cJSON *truth_of(const cJSON *laws, law_case which, const char *law, const char *mesh) {
    const cJSON *row;
    cJSON_ArrayForEach(row, cJSON_GetObjectItem(laws, "rows")) {
        const char *c = cJSON_GetStringValue(cJSON_GetObjectItem(row, "case"));
        const char *l = cJSON_GetStringValue(cJSON_GetObjectItem(row, "law"));
        if (c && l && !strcmp(c, law_case_name(which)) && !strcmp(l, law)) return cJSON_GetObjectItem(row, mesh);
    }
    return NULL;
}

static double figure(const cJSON *level, const char *name) {
    return cJSON_GetNumberValue(cJSON_GetObjectItem(level, name));
}

/* Returns the largest distance of a probe from the fine mesh's, over its largest displacement. */
static double shape_off(const law_measured *m, const cJSON *fine) {
    const cJSON *u = cJSON_GetObjectItem(fine, "u_m");
    double worst = 0, largest = 0;
    for (int p = 0; p < LAW_PROBES; p++) {
        double d = 0, size = 0;
        for (int axis = 0; axis < 3; axis++) {
            const double t = cJSON_GetNumberValue(cJSON_GetArrayItem(cJSON_GetArrayItem(u, p), axis));
            d += pow(m->u_m[3 * p + axis] - t, 2), size += t * t;
        }
        worst = fmax(worst, d), largest = fmax(largest, size);
    }
    return sqrt(worst / largest);
}

/* Reads the levels of a case that every mesh has. */
static int levels_of(const cJSON *laws, law_case which, const char *law, double level[LAW_LEVELS]) {
    const cJSON *fine = truth_of(laws, which, law, "fine"), *ten = truth_of(laws, which, law, "ten");
    int count = 0;
    while (count < LAW_LEVELS && cJSON_GetArrayItem(fine, count) && cJSON_GetArrayItem(ten, count)) {
        level[count] = figure(cJSON_GetArrayItem(fine, count), "level");
        count++;
    }
    return count;
}

/* --- the parts --- */

/* Compares one law in one case with the reference on the same mesh, whose own error is that from the fine mesh.
 * `*limited`: whether tetrahedra are beyond a limit. */
static tm_status verify(const run *r, law_case which, const law_sample *s, const law_form *form, cJSON *rows,
                        bool *limited, tm_error *error) {
    double level[LAW_LEVELS];
    law_measured m[LAW_LEVELS];
    const int count = levels_of(r->laws, which, s->name, level);
    const cJSON *fine = truth_of(r->laws, which, s->name, "fine");
    const cJSON *mesh = truth_of(r->laws, which, s->name, r->quick ? "small" : "ten");
    const tm_status status = law_rest(which, s, form, r->quick, level, count, m, error);
    *limited = false;
    for (int i = 0; i < count && status == TM_OK; i++) {
        const cJSON *f = cJSON_GetArrayItem(fine, i), *same = cJSON_GetArrayItem(mesh, i);
        const double truth = figure(f, "force"), force = figure(same, "force");
        app_json_add(
            rows,
            "case %s law %s stretch %g level %g tets %d force %g force_off %g mesh_force_off %g fine_force_off %g energy_off "
            "%g shape_off %g mesh_shape_off %g limited_share %g",
            law_case_name(which), s->name, form->stretch_max > 0 ? form->stretch_max : TM_STRETCH_DEFAULT, level[i],
            m[i].tets, m[i].force, fabs(m[i].force / force - 1), fabs(force / truth - 1), fabs(m[i].force / truth - 1),
            fabs(m[i].energy_J / figure(same, "energy_J") - 1), shape_off(m + i, f), figure(same, "shape"),
            (double)m[i].limited / m[i].tets);
        *limited |= m[i].limited > 0;
    }
    return status;
}

/* Adds the error of each form of tissue where the truth is the law's fine mesh, and of its force where it is the
 * law on the form's own mesh: without the mesh's error. */
static tm_status by_depth(const run *r, const law_sample *s, cJSON *rows, tm_error *error) {
    double level[LAW_LEVELS];
    law_measured m[LAW_LEVELS];
    tm_status status = TM_OK;
    const int count = levels_of(r->laws, LAW_INDENT, s->name, level);
    const cJSON *fine = truth_of(r->laws, LAW_INDENT, s->name, "fine");
    const cJSON *mesh = truth_of(r->laws, LAW_INDENT, s->name, r->quick ? "small" : "ten");
    for (int f = 0; f < FORMS && status == TM_OK; f++) {
        status = law_rest(LAW_INDENT, s, forms + f, r->quick, level, count, m, error);
        for (int i = 0; i < count && status == TM_OK; i++) {
            const cJSON *truth = cJSON_GetArrayItem(fine, i);
            const double same = figure(cJSON_GetArrayItem(mesh, i), "force");
            app_json_add(rows, "truth %s form %s depth %g displacement %g reaction %g energy %g same_mesh_reaction %g",
                         s->name, forms[f].name, level[i], shape_off(m + i, truth),
                         fabs(m[i].force / figure(truth, "force") - 1),
                         fabs(m[i].energy_J / figure(truth, "energy_J") - 1), fabs(m[i].force / same - 1));
        }
    }
    return status;
}

/* --- the price --- */

enum { PRICED = LAW_SAMPLES + 3 };

/* Turns the free block by 0.5 rad, so that `rotation` corotates all of it. */
static void turn(const app_bench *b) {
    tm_state *s = tm_world_state(b->world);
    const double c = cos(0.5) - 1, q = sin(0.5);
    for (int32_t v = 0; v < 3 * b->mesh->vertex_count; v += 3) {
        const double *x = b->mesh->rest_m + v;
        s->u_m[v] = s->u_prev_m[v] = c * x[0] - q * x[1];
        s->u_m[v + 1] = s->u_prev_m[v + 1] = q * x[0] + c * x[1];
    }
}

/* Returns the step of a law under FAR. */
static double far_step_s(const law_sample *s, bool small) {
    const app_bench_def def = law_bench(LAW_INDENT, s, &FAR, small);
    app_bench b;
    tm_error ignored;
    if (app_bench_open(&def, &b, &ignored)) return NAN;
    const double step_s = tm_world_step_s(b.world);
    app_bench_close(&b);
    return step_s;
}

/* Measures seconds per step: the least of many samples of BATCH steps, each world in turn; the step before them loads
 * the caches. */
static void time_least(tm_world **world, int rounds, double seconds[PRICED]) {
    enum { BATCH = 8 };
    for (int i = 0; i < PRICED; i++) seconds[i] = HUGE_VAL;
    for (int k = 0; k < 6 * rounds; k++)
        for (int i = 0; i < PRICED; i++) {
            tm_world_step(world[i], 1);
            const double start_s = app_seconds();
            tm_world_step(world[i], BATCH);
            seconds[i] = fmin(seconds[i], (app_seconds() - start_s) / BATCH);
        }
}

/* Measures linear tissue, both forms with rotation, and each law, in turns. */
static tm_status price(const run *r, cJSON *rows, tm_error *error) {
    app_bench b[PRICED] = {{0}};
    tm_world *world[PRICED];
    double seconds[PRICED];
    tm_status status = TM_OK;
    for (int i = 0; i < PRICED && status == TM_OK; i++) {
        const law_sample *s = law_samples + (i < 3 ? 0 : i - 3);
        const app_bench_def def = law_bench(LAW_INDENT, s, i < 3 ? forms + i : &LAW, r->quick);
        status = app_bench_open(&def, b + i, error);
        if (status == TM_OK) world[i] = b[i].world;
        if (status == TM_OK && i) turn(b + i);
    }
    if (status == TM_OK) time_least(world, r->rounds, seconds);
    for (int i = 0; i < PRICED && status == TM_OK; i++)
        app_json_add(rows, "form %s ns_per_tet %g step_s %g step_ratio %g price_ratio %g far_step_ratio %f",
                     i < 3 ? forms[i].name : law_samples[i - 3].name, 1e9 * seconds[i] / b[i].mesh->tet_count,
                     tm_world_step_s(world[i]), tm_world_step_s(world[i]) / tm_world_step_s(world[0]),
                     seconds[i] / tm_world_step_s(world[i]) / (seconds[0] / tm_world_step_s(world[0])),
                     i < 3 ? NAN : far_step_s(law_samples + i - 3, r->quick) / tm_world_step_s(world[0]));
    for (int i = 0; i < PRICED; i++)
        if (b[i].world) app_bench_close(b + i);
    return status;
}

tm_status knob_law(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    if (!r->laws)
        return tm_fail(error, TM_ERR_FILE, -1,
                       "laws.json with the laws' references is missing; make it with law_cases.py, or install again");
    cJSON *checked = cJSON_AddArrayToObject(out, "verification");
    tm_status status = TM_OK;
    for (int c = 0; c < LAW_CASES; c++)
        for (int l = 0; l < LAW_SAMPLES && status == TM_OK; l++) {
            bool limited;
            status = verify(r, (law_case)c, law_samples + l, &LAW, checked, &limited, error);
            if (status == TM_OK && limited && !r->quick)
                status = verify(r, (law_case)c, law_samples + l, &FAR, checked, &limited, error);
            r->progress("law", (c * LAW_SAMPLES + l + 1.0) / (LAW_SAMPLES * (LAW_CASES + 3)));
        }
    for (int l = 0; l < LAW_SAMPLES && status == TM_OK; l += r->quick ? 3 : 1) {
        status = by_depth(r, law_samples + l, rows, error);
        r->progress("law", (LAW_SAMPLES * LAW_CASES + 3.0 * (l + 1)) / (LAW_SAMPLES * (LAW_CASES + 3)));
    }
    return status ? status : price(r, cJSON_AddArrayToObject(out, "price"), error);
}
