/* Mesh: error of displacement, reaction and energy against the number of tetrahedra, and its two prices: more
 * tetrahedra a step, and more steps a second. Truth: CalculiX, ten-node tetrahedra (reference.json, "iso" and "fibre").
 */
#include <math.h>
#include <stdio.h>

#include "accuracy.h"

enum { MOST = 8 };

static tm_status one_law(const run *r, const char *law, const int *cells, int count, cJSON *rows, tm_error *error) {
    static const double along_x[3] = {1, 0, 0};
    bool fibred = law[0] == 'f';
    problem p[MOST] = {{0}};
    tm_world *world[MOST];
    measured truth, m[MOST];
    double depth, seconds[MOST];
    tm_status status = TM_OK;
    if (!reference_case(r->truth, law, 0, &depth, &truth))
        return tm_fail(error, TM_ERR_FILE, -1, "the references hold no case '%s'; make them again", law);
    for (int i = 0; i < count && status == TM_OK; i++) {
        problem_def def = problem_default(cells[i]);
        def.depth = depth;
        if (fibred) def.material = material_fibre(), def.fibre = along_x;
        status = problem_create(&def, &p[i], error);
        if (status == TM_OK) status = problem_settle(&p[i], 1e-9, &m[i], error);
        world[i] = p[i].world;
        r->progress(fibred ? "mesh, fibred" : "mesh, isotropic", (double)(i + 1) / count);
    }
    if (status == TM_OK) {
        time_steps(world, count, r->rounds, seconds);
        for (int i = 0; i < count; i++) {
            differences d = compare(&m[i], &truth);
            cJSON *row = json_row(rows);
            cJSON_AddStringToObject(row, "law", fibred ? "fibred" : "isotropic");
            cJSON_AddNumberToObject(row, "tets", p[i].mesh->tet_count);
            cJSON_AddNumberToObject(row, "h_m", BLOCK_M / cells[i]);
            cJSON_AddNumberToObject(row, "displacement", d.displacement);
            cJSON_AddNumberToObject(row, "reaction", d.reaction);
            cJSON_AddNumberToObject(row, "energy", d.energy);
            cJSON_AddNumberToObject(row, "step_s", tm_critical_step_guaranteed(p[i].tissue, NULL));
            cJSON_AddNumberToObject(row, "seconds_per_step", seconds[i]);
            cJSON_AddNumberToObject(row, "wall_per_simulated", seconds[i] / tm_world_step_s(world[i]));
            cJSON_AddNumberToObject(row, "bytes", (double)tm_tissue_bytes(p[i].tissue));
        }
    }
    for (int i = 0; i < count; i++) problem_destroy(&p[i]);
    return status;
}

cJSON *knob_mesh(const run *r, tm_error *error) {
    static const int quick[] = {3, 6, 9}, whole[] = {3, 6, 9, 12, 15, 18, 24, 30};
    const int *cells = r->quick ? quick : whole;
    int count = r->quick ? 3 : MOST;
    cJSON *out = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(out, "rows");
    if (one_law(r, "iso", cells, count, rows, error) == TM_OK &&
        one_law(r, "fibre", cells, count, rows, error) == TM_OK)
        return out;
    cJSON_Delete(out);
    return NULL;
}
