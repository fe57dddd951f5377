/* Studies of one setting each ("knobs") on the same set of pressed blocks, compared with CalculiX's ten-node tetrahedra
 * (reference.json): mesh       error against the number of tetrahedra, and its two costs: more of them per step, more
 * steps per second precision  the same press with single and with double stored tensors, with the mesh's own error
 *   model      linear elasticity against large displacements (neo-Hookean, "neo"), pressed by 1 % to 40 % of the edge;
 *              our three models are linear and agree at rest, so one scaled solution serves all
 *   fibre      fibred tissue treated as isotropic, with Young's moduli from E_T to E_L, against the cost of fibres:
 *              set-up only; the measured step shows whether it costs nothing there */
#include <math.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"
#include "common/program_host.h"
#include "scene/sim.h"

/* --- cost of a frame of each model in the scenes of tm-evaluate, and their agreement at rest --- */

enum { FRAMES = 40, REST = 120 };

typedef struct cost {
    double seconds_per_frame, setup_s, force_N;
    int64_t bytes;
} cost;

/* Runs a scene of one model: presses 3 mm in FRAMES frames, waits REST frames, and measures what a frame costs. */
static bool measure(const char *scene_file, cost *out) {
    char rate[] = "time.frame_rate=30", sends[] = "haptics.sends=force", extrapolator[] = "haptics.extrapolator=hold";
    char *set[] = {rate, sends, extrapolator}, found[2048];
    app_scene *scene = NULL;
    sim *s = NULL;
    int64_t before = tm_memory_in_use();
    double start = app_seconds(), sample[FRAMES];
    app_shared_file(scene_file, found, sizeof found);
    if (sim_scene_load(found, set, 3, app_program_host(), &scene) || sim_create(scene, &s)) return false;
    out->setup_s = app_seconds() - start;
    double top = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) top = fmax(top, s->mesh->rest_m[3 * v + 2]);
    tm_tool_pose to = {.active = true};
    memcpy(to.tip_m, s->instrument_def[0].trocar_m, sizeof to.tip_m);
    bool good = true;
    for (int k = 0; k < FRAMES + REST; k++) {
        to.tip_m[2] = top + s->instrument_def[0].radius_m - 0.003 * fmin(1, (k + 1.0) / FRAMES);
        start = app_seconds();
        good = good && sim_frame(s, &to, s->substeps) == TM_OK;
        if (k >= REST) sample[k - REST] = app_seconds() - start;
    }
    out->seconds_per_frame = app_median(sample, FRAMES);
    out->force_N = s->reaction[0].force_N[2];
    out->bytes = tm_memory_in_use() - before;
    sim_destroy(s);
    return good;
}

/* Measures seconds per frame, set-up, bytes and force at rest of the three models. A model that this build lacks is
 * left out after a message. */
static void model_prices(cJSON *rows, void (*progress)(const char *, double)) {
    static const struct {
        const char *name, *scene, *cuttable;
    } models[] = {{"tensor/mass", "apps/scenes/evaluate-isotropic.yaml", "everywhere"},
                  {"hybrid", "apps/scenes/evaluate-hybrid.yaml", "its tensor/mass part"},
                  {"precomputed", "apps/scenes/evaluate-precomputed.yaml", "nowhere"}};
    double truth = 0;
    for (int m = 0; m < 3; m++) {
        cost p;
        progress("prices of the models", m / 3.0);
        if (!measure(models[m].scene, &p)) continue;
        if (m == 0) truth = p.force_N;
        app_json_add(rows, "model %s cuttable %s seconds_per_frame %g setup_s %g bytes %g force_N %g difference %g",
                     models[m].name, models[m].cuttable, p.seconds_per_frame, p.setup_s, (double)p.bytes, p.force_N,
                     fabs(p.force_N / truth - 1));
    }
}

/* --- knobs --- */

static const double along_x[3] = {1, 0, 0};

/* Measures error and cost of the block on ever finer meshes, isotropic or fibred. */
static tm_status one_law(const run *r, bool fibred, cJSON *rows, tm_error *error) {
    static const int cells[] = {3, 6, 9, 12, 15, 18, 24, 30};
    const int count = r->quick ? 3 : 8;
    solved s[MATRIX];
    problem_def def[MATRIX];
    measured truth;
    double depth;
    tm_status status = reference_take(r, fibred ? "fibre" : "iso", 0, &depth, &truth, error);
    if (status != TM_OK) return status;
    for (int i = 0; i < count; i++) {
        def[i] = problem_default(cells[i]);
        def[i].depth = depth;
        if (fibred) def[i].material = material_fibre(), def[i].fibre = along_x;
    }
    status = matrix_solve(r, fibred ? "mesh, fibred" : "mesh, isotropic", def, count, 1e-9, &truth, s, error);
    for (int i = 0; i < count && status == TM_OK; i++) {
        cJSON *row =
            app_json_add(rows, "law %s tets %d h_m %g step_s %g", fibred ? "fibred" : "isotropic",
                         s[i].p.mesh->tet_count, BLOCK_M / cells[i], tm_critical_step_guaranteed(s[i].p.tissue, NULL));
        cost_add(differences_add(row, &s[i].off), &s[i]);
    }
    matrix_free(s, count);
    return status;
}

tm_status knob_mesh(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    (void)out;
    const tm_status status = one_law(r, false, rows, error);
    return status ? status : one_law(r, true, rows, error);
}

tm_status knob_precision(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    (void)out;
    measured truth;
    double depth;
    tm_status status = reference_take(r, "iso", 0, &depth, &truth, error);
    for (int cells = 3; cells <= (r->quick ? 6 : 12) && status == TM_OK; cells += 3) {
        problem_def def[2] = {problem_default(cells), problem_default(cells)};
        solved s[2];
        def[0].depth = def[1].depth = depth, def[1].precision = TM_SINGLE;
        status = matrix_solve(r, "precision", def, 2, 1e-11, NULL, s, error);
        for (int i = 0; i < 2 && status == TM_OK; i++) {
            cJSON *row = app_json_add(rows, "precision %s tets %d mesh_displacement %g", i ? "single" : "double",
                                      s[i].p.mesh->tet_count, compare(&s[i].m, &truth).displacement);
            cost_add(differences_add(row, &s[i].off), &s[i]);
        }
        matrix_free(s, 2);
    }
    return status;
}

tm_status knob_model(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    const int cases = reference_cases(r->truth, "neo");
    problem_def def = problem_default(r->quick ? 6 : 30);
    solved s;
    measured truth;
    double depth;
    tm_status status = reference_take(r, "iso", 0, &depth, &truth, error);
    if (status == TM_OK) status = matrix_solve(r, "model", &def, 1, 1e-10, &truth, &s, error);
    for (int i = 0; i < cases && status == TM_OK; i++) {
        if (!reference_case(r->truth, "neo", i, &depth, &truth)) continue;
        const measured scaled = measured_scaled(&s.m, depth / def.depth);
        const differences off = compare(&scaled, &truth);
        differences_add(
            app_json_add(rows, "depth %g force_N %g true_force_N %g", depth, -scaled.force_z_N, -truth.force_z_N),
            &off);
        r->progress("model", (double)(i + 1) / cases);
    }
    if (status != TM_OK) return status;
    differences_add(cJSON_AddObjectToObject(out, "mesh_alone"), &s.off);
    matrix_free(&s, 1);
    model_prices(cJSON_AddArrayToObject(out, "prices"), r->progress);
    return TM_OK;
}

tm_status knob_fibre(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    enum { MODELS = 6 };
    static const double young_Pa[MODELS] = {0, 6e3, 8e3, 10e3, 15e3, 30e3}; /* 0: fibred */
    (void)out;
    solved s[MODELS];
    problem_def def[MODELS];
    measured truth;
    double depth;
    tm_status status = reference_take(r, "fibre", 0, &depth, &truth, error);
    for (int i = 0; i < MODELS && status == TM_OK; i++) {
        def[i] = problem_default(r->quick ? 6 : 24);
        def[i].depth = depth;
        if (i == 0)
            def[i].material = material_fibre(), def[i].fibre = along_x;
        else
            status = tm_material_young(young_Pa[i], 0.45, &def[i].material, error);
    }
    if (status != TM_OK) return status;
    status = matrix_solve(r, "fibres", def, MODELS, 1e-9, &truth, s, error);
    for (int i = 0; i < MODELS && status == TM_OK; i++) {
        cJSON *row = app_json_add(rows, "model %s young_Pa %g step_s %g", i ? "isotropic" : "fibred", young_Pa[i],
                                  tm_world_step_s(s[i].p.world));
        cost_add(differences_add(row, &s[i].off), &s[i]);
    }
    matrix_free(s, MODELS);
    return status;
}
