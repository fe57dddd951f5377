/* Precision of the stored tensors: the same press with single and with double ones. The mesh's own error stands beside
 * it. */
#include "accuracy.h"

cJSON *knob_precision(const run *r, tm_error *error) {
    static const int quick[] = {3, 6}, whole[] = {3, 6, 9, 12};
    const int *cells = r->quick ? quick : whole, count = r->quick ? 2 : 4;
    cJSON *out = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(out, "rows");
    measured truth;
    double depth;
    if (!reference_case(r->truth, "iso", 0, &depth, &truth)) depth = 0.05;
    for (int i = 0; i < count; i++) {
        problem p[2] = {{0}};
        measured m[2];
        double seconds[2];
        tm_status status = TM_OK;
        for (int s = 0; s < 2 && status == TM_OK; s++) {
            problem_def def = problem_default(cells[i]);
            def.depth = depth, def.precision = s ? TM_SINGLE : TM_DOUBLE;
            status = problem_create(&def, &p[s], error);
            if (status == TM_OK) status = problem_settle(&p[s], 1e-11, &m[s], error);
        }
        if (status == TM_OK) {
            tm_world *world[2] = {p[0].world, p[1].world};
            time_steps(world, 2, r->rounds, seconds);
            for (int s = 0; s < 2; s++) {
                differences rounding = compare(&m[s], &m[0]), mesh = compare(&m[s], &truth);
                cJSON *row = json_row(rows);
                cJSON_AddStringToObject(row, "precision", s ? "single" : "double");
                cJSON_AddNumberToObject(row, "tets", p[s].mesh->tet_count);
                cJSON_AddNumberToObject(row, "displacement", rounding.displacement);
                cJSON_AddNumberToObject(row, "reaction", rounding.reaction);
                cJSON_AddNumberToObject(row, "energy", rounding.energy);
                cJSON_AddNumberToObject(row, "mesh_displacement", mesh.displacement);
                cJSON_AddNumberToObject(row, "bytes", (double)tm_tissue_bytes(p[s].tissue));
                cJSON_AddNumberToObject(row, "seconds_per_step", seconds[s]);
            }
        }
        problem_destroy(&p[0]), problem_destroy(&p[1]);
        r->progress("precision", (double)(i + 1) / count);
        if (status != TM_OK) {
            cJSON_Delete(out);
            return NULL;
        }
    }
    return out;
}
