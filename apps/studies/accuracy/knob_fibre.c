/* Fibres: the error of taking fibred tissue for isotropic, with Young's moduli from E_T to E_L, against what the fibre
 * costs. The cost is in set-up alone; in the step it should be nothing, and the figure says whether it is. Truth:
 * CalculiX, "fibre". */
#include "accuracy.h"

cJSON *knob_fibre(const run *r, tm_error *error) {
    enum { MODELS = 6 };
    static const double along_x[3] = {1, 0, 0}, young_Pa[MODELS - 1] = {6e3, 8e3, 10e3, 15e3, 30e3};
    cJSON *out = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(out, "rows");
    problem p[MODELS] = {{0}};
    tm_world *world[MODELS];
    measured truth, m[MODELS];
    double depth = 0.05, seconds[MODELS];
    tm_status status = reference_case(r->truth, "fibre", 0, &depth, &truth) ? TM_OK : TM_ERR_FILE;
    for (int i = 0; i < MODELS && status == TM_OK; i++) {
        problem_def def = problem_default(r->quick ? 6 : 24);
        def.depth = depth;
        if (i == 0)
            def.material = material_fibre(), def.fibre = along_x;
        else
            status = tm_material_young(young_Pa[i - 1], 0.45, &def.material, error);
        if (status == TM_OK) status = problem_create(&def, &p[i], error);
        if (status == TM_OK) status = problem_settle(&p[i], 1e-9, &m[i], error);
        world[i] = p[i].world;
        r->progress("fibres", (double)(i + 1) / MODELS);
    }
    if (status == TM_OK) {
        time_steps(world, MODELS, r->rounds, seconds);
        for (int i = 0; i < MODELS; i++) {
            differences d = compare(&m[i], &truth);
            cJSON *row = json_row(rows);
            cJSON_AddStringToObject(row, "model", i ? "isotropic" : "fibred");
            cJSON_AddNumberToObject(row, "young_Pa", i ? young_Pa[i - 1] : 0);
            cJSON_AddNumberToObject(row, "displacement", d.displacement);
            cJSON_AddNumberToObject(row, "reaction", d.reaction);
            cJSON_AddNumberToObject(row, "energy", d.energy);
            cJSON_AddNumberToObject(row, "seconds_per_step", seconds[i]);
            cJSON_AddNumberToObject(row, "step_s", tm_world_step_s(world[i]));
            cJSON_AddNumberToObject(row, "bytes", (double)tm_tissue_bytes(p[i].tissue));
        }
    }
    for (int i = 0; i < MODELS; i++) problem_destroy(&p[i]);
    if (status == TM_OK) return out;
    cJSON_Delete(out);
    return NULL;
}
