/* The effect "rotation", with and without the effect "strain_smoothing". Compares the pressed block with CalculiX at
 * large displacements, neo-Hookean ("neo") and St. Venant-Kirchhoff ("svk", as deep as it has an equilibrium). The
 * linear model and the mesh's own error are given too, and the cost if every tetrahedron is corotated. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"

static const double MIN_DEPTH = 0.045;

/* Computes the equilibrium of the block pressed by `def`. */
static tm_status rest(const problem_def *def, double tolerance, measured *m, tm_error *error) {
    problem p;
    tm_status status = problem_create(def, &p, error);
    if (status == TM_OK) status = problem_settle(&p, tolerance, m, error);
    if (p.world) problem_destroy(&p);
    return status;
}

static void tell(cJSON *rows, const char *law, bool volume, double depth, const differences *turned,
                 const differences *flat) {
    app_json_add(
        rows,
        "law %s volume %hhd depth %g displacement %g reaction %g energy %g linear_displacement %g linear_reaction %g",
        law, volume, depth, turned->displacement, turned->reaction, turned->energy, flat->displacement, flat->reaction);
}

/* Solves linear tissue once and scales it. */
static tm_status press(const run *r, const char *law, bool volume, int cells, cJSON *rows, tm_error *error) {
    measured m, truth, linear;
    double depth;
    problem_def straight = problem_default(cells);
    straight.volume = volume, straight.smoothed_shear_share = 0; /* as `rotation` requires */
    tm_status status = rest(&straight, 1e-9, &linear, error);
    for (int i = 0; i < reference_cases(r->truth, law) && status == TM_OK; i++) {
        problem_def def = straight;
        if (!reference_case(r->truth, law, i, &depth, &truth) || depth < MIN_DEPTH) continue;
        def.depth = depth, def.rotation = TM_ROTATION_THRESHOLD;
        status = rest(&def, 1e-8, &m, error);
        if (status != TM_OK) break;
        const measured scaled = measured_scaled(&linear, depth / straight.depth);
        const differences turned = compare(&m, &truth), flat = compare(&scaled, &truth);
        tell(rows, law, volume, depth, &turned, &flat);
        r->progress("rotation", (double)(i + 1) / reference_cases(r->truth, law));
    }
    return status;
}

/* Compares linear tissue with linear CalculiX. */
static tm_status mesh_alone(const run *r, bool volume, int cells, const char *name, cJSON *out, tm_error *error) {
    measured m, truth;
    double depth;
    problem_def def = problem_default(cells);
    def.volume = volume, def.smoothed_shear_share = 0;
    const tm_status status = rest(&def, 1e-9, &m, error);
    if (status == TM_OK && reference_case(r->truth, "iso", 0, &depth, &truth))
        cJSON_AddNumberToObject(out, name, compare(&m, &truth).displacement);
    return status;
}

/* Measures nanoseconds per tetrahedron and step of the block rotated by 0.5 rad, with and without the effect. */
static tm_status cost(int cells, cJSON *out, tm_error *error) {
    problem p[2] = {{0}, {0}};
    tm_world *world[2];
    double seconds[2];
    tm_status status = TM_OK;
    for (int i = 0; i < 2 && status == TM_OK; i++) {
        problem_def def = problem_default(cells);
        def.rotation = i ? TM_ROTATION_THRESHOLD : 0;
        def.fixed = false;
        status = problem_create(&def, &p[i], error);
        if (status != TM_OK) break;
        world[i] = p[i].world;
        tm_state *s = tm_world_state(world[i]);
        for (int32_t v = 0; i && v < p[i].mesh->vertex_count; v++) {
            const double *x = p[i].mesh->rest_m + 3 * v, c = cos(0.5), q = sin(0.5);
            s->u_m[3 * v] = s->u_prev_m[3 * v] = x[0] * (c - 1) - x[1] * q;
            s->u_m[3 * v + 1] = s->u_prev_m[3 * v + 1] = x[0] * q + x[1] * (c - 1);
        }
    }
    if (status == TM_OK) {
        time_steps(world, 2, 15, seconds);
        const int32_t tets = p[0].mesh->tet_count;
        app_json_add(out, "tets %d linear_ns %g turning_ns %g step_ratio %g", tets, 1e9 * seconds[0] / tets,
                     1e9 * seconds[1] / tets, tm_world_step_s(world[1]) / tm_world_step_s(world[0]));
    }
    for (int i = 0; i < 2; i++)
        if (p[i].world) problem_destroy(&p[i]);
    return status;
}

tm_status knob_rotation(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    const int cells = r->quick ? 6 : 18;
    app_json_add(out, "tets %g", 6.0 * cells * cells * cells);
    tm_status status = mesh_alone(r, false, cells, "mesh_alone", out, error);
    if (status == TM_OK) status = mesh_alone(r, true, cells, "mesh_alone_volume", out, error);
    for (int volume = 0; volume < 2 && status == TM_OK; volume++) {
        status = press(r, "neo", volume, cells, rows, error);
        if (status == TM_OK) status = press(r, "svk", volume, cells, rows, error);
    }
    if (status == TM_OK) status = cost(r->quick ? 6 : 26, cJSON_AddObjectToObject(out, "price"), error);
    return status;
}
