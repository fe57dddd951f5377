/* Cost of nonlinear laws: stress of a tetrahedron and gathering of its corner forces, by the timers of the stages,
 * and the complete step on one and several threads. The linear and the corotational law run in the same rounds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bandwidth.h"
#include "bench.h"
#include "material/hyperelastic_single.h"
#include "material/single_batches.h"
#include "tensormass/rotation.h"
#include "tissue/tissue_internal.h"

enum { LINEAR, TURNED, TURNED_SINGLE, FIRST_LAW, CASES = 15, FORMS = 3 };
static const char *const form_name[FORMS] = {"plain", "avx2", "avx512"};

static const struct subject {
    const char *name;
    tm_law_kind law;
    double constant[4];
    bool fibred;
    tm_precision precision;
} subject[CASES] = {{"linear", TM_LAW_LINEAR, {0}, false, TM_DOUBLE},
                    {"rotation", TM_LAW_LINEAR, {0}, false, TM_DOUBLE},
                    {"rotation, single", TM_LAW_LINEAR, {0}, false, TM_SINGLE},
                    {"neo-hooke", TM_LAW_NEO_HOOKE, {0}, false, TM_DOUBLE},
                    {"mooney-rivlin", TM_LAW_MOONEY_RIVLIN, {0.3}, false, TM_DOUBLE},
                    {"st-venant-kirchhoff", TM_LAW_ST_VENANT_KIRCHHOFF, {0.5}, false, TM_DOUBLE},
                    {"st-venant-kirchhoff, fibred", TM_LAW_ST_VENANT_KIRCHHOFF, {0.5}, true, TM_DOUBLE},
                    {"fung", TM_LAW_FUNG, {20e3}, false, TM_DOUBLE},
                    {"fung, fibred", TM_LAW_FUNG, {20e3}, true, TM_DOUBLE},
                    {"holzapfel", TM_LAW_HOLZAPFEL, {4e3, 0.8, 0.1}, true, TM_DOUBLE},
                    {"neo-hooke, single", TM_LAW_NEO_HOOKE, {0}, false, TM_SINGLE},
                    {"mooney-rivlin, single", TM_LAW_MOONEY_RIVLIN, {0.3}, false, TM_SINGLE},
                    {"st-venant-kirchhoff, single", TM_LAW_ST_VENANT_KIRCHHOFF, {0.5}, true, TM_SINGLE},
                    {"fung, fibred, single", TM_LAW_FUNG, {20e3}, true, TM_SINGLE},
                    {"holzapfel, single", TM_LAW_HOLZAPFEL, {4e3, 0.8, 0.1}, true, TM_SINGLE}};

static bool is_turned(int c) { return c == TURNED || c == TURNED_SINGLE; }

static tm_tissue *tissue_of(const tm_mesh *mesh, const struct subject *s, bool turned, const double *fibre) {
    tm_material material;
    tm_error error;
    if (s->fibred && s->law != TM_LAW_HOLZAPFEL)
        bench_must(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &material, &error), &error);
    else
        bench_must(tm_material_young(5e3, 0.45, &material, &error), &error);
    if (s->law != TM_LAW_LINEAR) bench_must(tm_material_set_law(&material, s->law, s->constant, 0, &error), &error);
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material, def.fibre = s->fibred ? fibre : NULL;
    def.precision = s->precision;
    def.rotation = turned ? TM_ROTATION_THRESHOLD_MIN : 0;
    tm_tissue *tissue = NULL;
    bench_must(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

/* --- the machine's limit of arithmetic --- */

/* Measures seconds of a multiplication and an addition of one double where four run at once and none waits for another:
 * the least of many passes. NAN without AVX2. */
#ifdef __x86_64__
typedef double four __attribute__((vector_size(32)));

__attribute__((target("avx2"))) static double arithmetic_s(void) {
    enum { CHAINS = 10, TURNS = 2000, PASSES = 300 };
    double least = HUGE_VAL;
    if (!__builtin_cpu_supports("avx2")) return NAN;
    for (int pass = 0; pass < PASSES; pass++) {
        four x[CHAINS];
        for (int c = 0; c < CHAINS; c++) x[c] = (four){1.0 + c, 2, 3, 4};
        const double begin = app_seconds();
        for (int turn = 0; turn < TURNS; turn++)
            for (int c = 0; c < CHAINS; c++) {
                x[c] = x[c] * 0.999 + 0.001;
                __asm__ volatile("" : "+x"(x[c]));
            }
        least = fmin(least, app_seconds() - begin);
    }
    return least / (4.0 * CHAINS * TURNS);
}
#else
static double arithmetic_s(void) { return NAN; }
#endif

/* Rotated by a tenth of a radian and bent, so that every tetrahedron is computed by its law. */
static void deform(tm_world *world) {
    const tm_mesh *mesh = tm_tissue_mesh(tm_world_tissue(world));
    tm_state *s = tm_world_state(world);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const double *r = mesh->rest_m + 3 * (int64_t)v;
        const double u[3] = {-0.1 * r[1], 0.1 * r[0], 0.5 * r[0] * r[0]};
        for (int i = 0; i < 3; i++) s->u_m[3 * v + i] = s->u_prev_m[3 * v + i] = u[i];
    }
}

typedef struct measured {
    tm_tissue *tissue;
    tm_world *world[2]; /* one thread, all cores */
    double step_s[2], law_s, force_s, form_s[FORMS];
    tm_hyperelastic hyper; /* times of the passes of each form */
    tm_single_law narrow;
    double *corner_N;
    float *single_N;       /* of a case in single precision */
    tm_rotation *rotation; /* of the cases with rotation, with the forces of its batches */
    double *force_N;
    tm_pool pool;
} measured;

static double stage_s(const tm_stage_report *report, int32_t count, const char *name) {
    double seconds = 0;
    for (int32_t i = 0; i < count; i++)
        if (!strcmp(report[i].name, name)) seconds += report[i].seconds;
    return seconds;
}

/* Runs one round: a few steps, then as many with timers on. */
static void round_of(measured *m, int32_t steps) {
    tm_stage_report before[TM_MAX_STAGES], after[TM_MAX_STAGES];
    for (int k = 0; k < 2; k++) {
        tm_world_step(m->world[k], steps / 4 + 1);
        const double begin = app_seconds();
        tm_world_step(m->world[k], steps);
        m->step_s[k] = fmin(m->step_s[k], (app_seconds() - begin) / steps);
    }
    tm_world_set_timing(m->world[0], true);
    const int32_t count = tm_world_stages(m->world[0], before);
    tm_world_step(m->world[0], steps);
    tm_world_stages(m->world[0], after);
    tm_world_set_timing(m->world[0], false);
    m->law_s = fmin(m->law_s, (stage_s(after, count, "law") - stage_s(before, count, "law")) / steps);
    m->force_s = fmin(m->force_s, (stage_s(after, count, "force") - stage_s(before, count, "force")) / steps);
}

/* Runs a pass of the law, or of the rotation's correction, in a form. Returns false if this processor does not support
 * it. */
static bool run_form(measured *m, int form) {
    const double *u_m = tm_world_state(m->world[0])->u_m;
    const tm_hyper_force pass = tm_hyper_force_form(form);
    const tm_single_force single = tm_single_force_form(form);
    const tm_rotation *r = m->rotation;
    if (r) {
        const tm_rotation_kernel kernel = r->batches.single ? tm_single_rotation_form(form) : tm_rotation_form(form);
        if (kernel) kernel(&r->batches, r->every, r->batches.count, u_m, m->force_N, r->conserving.batch_J);
        return kernel;
    }
    if (!m->corner_N || (m->single_N ? !single : !pass)) return false;
    if (m->single_N)
        single(&m->narrow, 0, m->hyper.packs.count, u_m, m->single_N);
    else
        pass(&m->hyper, 0, m->hyper.packs.count, u_m, m->corner_N);
    return true;
}

/* Measures the pass alone, in every form. */
static void forms_of(measured *m, int32_t passes) {
    for (int f = 0; f < FORMS; f++)
        for (int32_t i = 0; i < passes; i++) { /* each by itself: on a busy machine some pass undisturbed */
            const double begin = app_seconds();
            if (!run_form(m, f)) break;
            m->form_s[f] = fmin(m->form_s[f], app_seconds() - begin);
        }
}

static cJSON *row_of(const measured *m, const struct subject *s, int32_t tets, const measured *linear, double unit_s) {
    cJSON *row = cJSON_CreateObject();
    const double ns = 1e9 / tets;
    cJSON_AddNumberToObject(row, "tets", tets);
    cJSON_AddStringToObject(row, "law", s->name);
    cJSON_AddNumberToObject(row, "ns_per_tet_law", ns * m->law_s);
    cJSON_AddNumberToObject(row, "ns_per_tet_force", ns * m->force_s);
    for (int f = 0; f < FORMS; f++) {
        char key[32];
        snprintf(key, sizeof key, "ns_per_tet_%s", form_name[f]);
        if (isfinite(m->form_s[f])) cJSON_AddNumberToObject(row, key, ns * m->form_s[f]);
    }
    if (isfinite(m->form_s[1] / unit_s))
        cJSON_AddNumberToObject(row, "multiply_adds_avx2", m->form_s[1] / tets / unit_s);
    cJSON_AddNumberToObject(row, "ns_per_tet_step", ns * m->step_s[0]);
    cJSON_AddNumberToObject(row, "over_linear", m->step_s[0] / linear->step_s[0]);
    cJSON_AddNumberToObject(row, "threads", tm_world_partitions(m->world[1]));
    cJSON_AddNumberToObject(row, "speedup", m->step_s[0] / m->step_s[1]);
    printf(
        "law   %7d tets  %-27s  stress %5.1f (plain %5.1f, AVX2 %5.1f = %3.0f multiply-adds, AVX-512 %5.1f) + force %4.1f ns "
        "a tetrahedron, "
        "step %5.1f: %.2f of linear; %.2f times faster on %d threads\n",
        tets, s->name, ns * m->law_s, ns * m->form_s[0], ns * m->form_s[1], m->form_s[1] / tets / unit_s,
        ns * m->form_s[2], ns * m->force_s, ns * m->step_s[0], m->step_s[0] / linear->step_s[0],
        m->step_s[0] / m->step_s[1], tm_world_partitions(m->world[1]));
    return row;
}

static void one_size(const tm_mesh *mesh, bool quick, cJSON *rows) {
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    const int32_t tets = mesh->tet_count, steps = 1 + (quick ? 200000 : 1000000) / tets;
    double *fibre = malloc(sizeof(double) * 3 * (size_t)tets);
    for (int32_t i = 0; i < 3 * tets; i++) fibre[i] = i % 3 ? 2 / 3.0 : 1 / 3.0;
    measured m[CASES];
    tm_error error;
    for (int c = 0; c < CASES; c++) {
        m[c] = (measured){.tissue = tissue_of(mesh, subject + c, is_turned(c), fibre),
                          .step_s = {HUGE_VAL, HUGE_VAL},
                          .law_s = HUGE_VAL,
                          .force_s = HUGE_VAL,
                          .form_s = {HUGE_VAL, HUGE_VAL, HUGE_VAL}};
        const tm_material_field field = tm_tissue_field(m[c].tissue);
        if (c >= FIRST_LAW && tm_hyperelastic_take(&m[c].hyper, &m[c].pool, &field))
            m[c].corner_N = TM_ALLOC(&m[c].pool, double, 12 * TM_LANES * (int64_t)m[c].hyper.packs.count);
        if (c >= FIRST_LAW && subject[c].precision == TM_SINGLE &&
            tm_single_law_init(&m[c].narrow, &m[c].pool, &m[c].hyper))
            m[c].single_N = TM_ALLOC(&m[c].pool, float, 12 * TM_LANES * (int64_t)m[c].hyper.packs.count);
        for (int k = 0; k < 2; k++) {
            m[c].world[k] = bench_world(m[c].tissue, k ? (int)(cores < TM_MAX_THREADS ? cores : TM_MAX_THREADS) : 1);
            if (is_turned(c)) bench_must(tm_stage_rotation(m[c].world[k], &m[c].rotation, &error), &error);
        }
        if (is_turned(c)) m[c].force_N = TM_ALLOC(&m[c].pool, double, 3 * (int64_t)mesh->vertex_count);
    }
    double unit_s = HUGE_VAL; /* between the rounds, as the machine's clock changes */
    for (int round = 0; round < (quick ? 5 : 25); round++) {
        unit_s = fmin(unit_s, arithmetic_s());
        for (int c = 0; c < CASES; c++) {
            for (int k = 0; k < 2; k++) deform(m[c].world[k]);
            round_of(m + c, steps);
            for (int k = 0; k < 2; k++) deform(m[c].world[k]);
            forms_of(m + c, steps);
        }
    }
    for (int c = 0; c < CASES; c++) {
        cJSON_AddItemToArray(rows, row_of(m + c, subject + c, tets, m + LINEAR, unit_s));
        for (int k = 0; k < 2; k++) tm_world_destroy(m[c].world[k]);
        tm_pool_release(&m[c].pool);
        tm_tissue_destroy(m[c].tissue);
    }
    free(fibre);
}

cJSON *bench_law(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    for (int i = 0; i < run->size_count; i++) {
        if (run->cells[i] < 5) continue; /* two threads require 4,000 tetrahedra */
        tm_mesh *mesh = bench_block(run->cells[i]);
        one_size(mesh, run->quick, rows);
        tm_mesh_destroy(mesh);
    }
    return rows;
}
