/* The effect "rotation": the pressed block against CalculiX with large displacements, neo-Hookean ("neo") and of St.
 * Venant and Kirchhoff ("svk", as deep as that has a rest), with the linear model and the mesh's own error beside it; a
 * bar twisted by a right angle; and what it costs where every tetrahedron turns. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"
#include "block.h"

static const double LEAST_DEPTH = 0.045;

static tm_status press(const run *r, const char *law, int cells, cJSON *rows, tm_error *error) {
    problem p;
    measured m, truth, linear;
    double depth;
    problem_def straight = problem_default(cells);
    tm_status status = problem_create(&straight, &p, error);
    if (status == TM_OK) status = problem_settle(&p, 1e-9, &linear, error);
    if (p.world) problem_destroy(&p);
    for (int i = 0; i < reference_cases(r->truth, law) && status == TM_OK; i++) {
        problem_def def = problem_default(cells);
        if (!reference_case(r->truth, law, i, &depth, &truth) || depth < LEAST_DEPTH) continue;
        def.depth = depth, def.rotation = TM_ROTATION_THRESHOLD;
        status = problem_create(&def, &p, error);
        if (status == TM_OK) status = problem_settle(&p, 1e-8, &m, error);
        if (p.world) problem_destroy(&p);
        if (status != TM_OK) break;
        measured scaled = linear;
        const double scale = depth / straight.depth;
        for (int c = 0; c < 3 * PROBES; c++) scaled.probe_u_m[c] *= scale;
        scaled.force_z_N *= scale, scaled.energy_J *= scale * scale;
        const differences turned = compare(&m, &truth), flat = compare(&scaled, &truth);
        cJSON *row = json_row(rows);
        cJSON_AddStringToObject(row, "law", law);
        cJSON_AddNumberToObject(row, "depth", depth);
        cJSON_AddNumberToObject(row, "displacement", turned.displacement);
        cJSON_AddNumberToObject(row, "reaction", turned.reaction);
        cJSON_AddNumberToObject(row, "energy", turned.energy);
        cJSON_AddNumberToObject(row, "linear_displacement", flat.displacement);
        cJSON_AddNumberToObject(row, "linear_reaction", flat.reaction);
        r->progress("rotation", (double)(i + 1) / reference_cases(r->truth, law));
    }
    return status;
}

/* Nanoseconds a tetrahedron and step of the block turned by half a radian, with the effect and without. */
static tm_status price(int cells, cJSON *out, tm_error *error) {
    problem p[2] = {{0}, {0}};
    tm_world *world[2];
    double seconds[2];
    tm_status status = TM_OK;
    for (int i = 0; i < 2 && status == TM_OK; i++) {
        problem_def def = problem_default(cells);
        def.rotation = i ? TM_ROTATION_THRESHOLD : 0;
        def.held = false;
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
        cJSON_AddNumberToObject(out, "tets", tets);
        cJSON_AddNumberToObject(out, "linear_ns", 1e9 * seconds[0] / tets);
        cJSON_AddNumberToObject(out, "turning_ns", 1e9 * seconds[1] / tets);
        cJSON_AddNumberToObject(out, "step_ratio", tm_world_step_s(world[1]) / tm_world_step_s(world[0]));
    }
    for (int i = 0; i < 2; i++)
        if (p[i].world) problem_destroy(&p[i]);
    return status;
}

cJSON *knob_rotation(const run *r, tm_error *error) {
    const int cells = r->quick ? 6 : 18;
    cJSON *out = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(out, "rows");
    measured m, truth;
    double depth;
    problem p = {0};
    problem_def def = problem_default(cells);
    tm_status status = problem_create(&def, &p, error);
    if (status == TM_OK) status = problem_settle(&p, 1e-9, &m, error);
    if (status == TM_OK && reference_case(r->truth, "iso", 0, &depth, &truth))
        cJSON_AddNumberToObject(out, "mesh_alone", compare(&m, &truth).displacement);
    cJSON_AddNumberToObject(out, "tets", p.mesh ? p.mesh->tet_count : 0);
    if (p.world) problem_destroy(&p);
    if (status == TM_OK) status = press(r, "neo", cells, rows, error);
    if (status == TM_OK) status = press(r, "svk", cells, rows, error);
    if (status == TM_OK) status = price(r->quick ? 6 : 26, cJSON_AddObjectToObject(out, "price"), error);
    if (status == TM_OK) return out;
    cJSON_Delete(out);
    return NULL;
}
