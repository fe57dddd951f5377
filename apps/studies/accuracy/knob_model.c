/* Model: linear elasticity against large displacements, pressed from 1 % to 40 % of the block's edge. Truth: CalculiX,
 * neo-Hookean, ten-node tetrahedra, large displacements ("neo"). All three of our models are linear and agree at rest,
 * so one solution serves them all (scaled by the depth, exact for a linear model); their prices differ. The mesh's
 * share of the error stands beside it: the same mesh against linear CalculiX ("iso"). */
#include "accuracy.h"

static void add_differences(cJSON *row, differences d) {
    cJSON_AddNumberToObject(row, "displacement", d.displacement);
    cJSON_AddNumberToObject(row, "reaction", d.reaction);
    cJSON_AddNumberToObject(row, "energy", d.energy);
}

cJSON *knob_model(const run *r, tm_error *error) {
    problem p;
    problem_def def = problem_default(r->quick ? 6 : 30);
    measured m, truth;
    double depth;
    tm_status status = problem_create(&def, &p, error);
    if (status == TM_OK) status = problem_settle(&p, 1e-10, &m, error);
    cJSON *out = cJSON_CreateObject(), *rows = cJSON_AddArrayToObject(out, "rows");
    for (int i = 0; i < reference_cases(r->truth, "neo") && status == TM_OK; i++) {
        if (!reference_case(r->truth, "neo", i, &depth, &truth)) continue;
        double scale = depth / def.depth;
        measured scaled = m;
        for (int c = 0; c < 3 * PROBES; c++) scaled.probe_u_m[c] *= scale;
        scaled.force_z_N *= scale, scaled.energy_J *= scale * scale;
        cJSON *row = json_row(rows);
        cJSON_AddNumberToObject(row, "depth", depth);
        add_differences(row, compare(&scaled, &truth));
        cJSON_AddNumberToObject(row, "force_N", -scaled.force_z_N);
        cJSON_AddNumberToObject(row, "true_force_N", -truth.force_z_N);
        r->progress("model", (double)(i + 1) / reference_cases(r->truth, "neo"));
    }
    if (status == TM_OK && reference_case(r->truth, "iso", 0, &depth, &truth))
        add_differences(cJSON_AddObjectToObject(out, "mesh_alone"), compare(&m, &truth));
    problem_destroy(&p);
    if (status == TM_OK) model_prices(cJSON_AddArrayToObject(out, "prices"), r->progress);
    if (status == TM_OK) return out;
    cJSON_Delete(out);
    return NULL;
}
