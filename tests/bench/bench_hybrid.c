/* Cost of a frame of the hybrid and the dynamic model: the same block, with a probe pressed into either part and
 * slid along it. Processor time of one thread. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench.h"
#include "clock.h"
#include "tensormass_solve.h"

enum { DYNAMIC, HYBRID, MODELS, PROBES = 2 };
static const double SIDE_M = 0.1, RADIUS_M = 0.004;

static double processor_s(void) { return app_clock_s(CLOCK_THREAD_CPUTIME_ID); }

typedef struct organ {
    tm_mesh *mesh;
    tm_material material;
    uint8_t *dynamic; /* [tet_count] a box in the middle of the top, half as deep as wide */
    int32_t dynamic_count, *dof;
    double *zero;
    tm_instrument_def probe[PROBES];
    tm_contact_def contact;
    tm_model_def def;
} organ;

static void place_probes(organ *o, double wide) {
    o->contact = tm_contact_def_default();
    for (int i = 0; i < PROBES; i++) {
        const double x = i ? 0.5 * SIDE_M + 0.25 * (wide + SIDE_M) : 0.5 * SIDE_M;
        o->probe[i] = (tm_instrument_def){.mode = TM_TOOL_PROBE, .radius_m = RADIUS_M, .contact_length_m = 0.02};
        memcpy(o->probe[i].trocar_m, (double[3]){x, 0.5 * SIDE_M, SIDE_M + 0.15}, sizeof o->probe[i].trocar_m);
        o->probe[i].pose = (tm_tool_pose){.tip_m = {x, 0.5 * SIDE_M, SIDE_M + 0.006}, .active = true};
    }
    o->contact.instrument_count = PROBES;
    o->contact.instrument = o->probe;
}

static void make_organ(organ *o, int cells, double share) {
    tm_error error;
    const double wide = cbrt(2 * share) * SIDE_M;
    *o = (organ){.mesh = bench_block_of(cells, SIDE_M), .def = tm_model_def_default()};
    const tm_mesh *mesh = o->mesh;
    bench_must(tm_material_young(5e3, 0.45, &o->material, &error), &error);
    o->material.damping_1_s = 50;
    o->dynamic = malloc((size_t)mesh->tet_count);
    o->dof = malloc(sizeof *o->dof * 3 * (size_t)mesh->vertex_count);
    o->zero = calloc(3 * (size_t)mesh->vertex_count, sizeof *o->zero);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x[3] = {0};
        for (int i = 0; i < 12; i++) x[i % 3] += mesh->rest_m[3 * mesh->tet[4 * t + i / 3] + i % 3] / 4;
        o->dynamic[t] =
            fabs(x[0] - 0.5 * SIDE_M) < wide / 2 && fabs(x[1] - 0.5 * SIDE_M) < wide / 2 && x[2] > SIDE_M - wide / 2;
        o->dynamic_count += o->dynamic[t];
    }
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++)
        if (mesh->rest_m[i / 3 * 3 + 2] < 1e-9) o->dof[o->def.support_count++] = i;
    place_probes(o, wide);
    o->def.tissue.mesh = mesh;
    o->def.tissue.material_count = 1;
    o->def.tissue.material = &o->material;
    o->def.support_dof = o->dof;
    o->def.support_m = o->zero;
    o->def.contact = &o->contact;
    o->def.frame_s = 1.0 / 25;
}

static tm_model *make_model(organ *o, int which, tm_solve_report *report) {
    tm_model *model;
    tm_error error;
    tm_hybrid_def hybrid = tm_hybrid_def_default();
    hybrid.dynamic = o->dynamic;
    bench_must(which == DYNAMIC ? tm_model_dynamic(&o->def, &model, &error)
                                : tm_model_hybrid(&o->def, &hybrid, &model, report, &error),
               &error);
    return model;
}

static cJSON *one_share(int cells, double share, int frames) {
    organ o;
    make_organ(&o, cells, share);
    tm_solve_report report = {0};
    tm_model *model[MODELS];
    tm_tool_pose to[PROBES];
    double *ms[MODELS], mean[MODELS] = {0};
    tm_error error = {.message = "a frame failed"};
    for (int m = 0; m < MODELS; m++)
        model[m] = make_model(&o, m, &report), ms[m] = malloc(sizeof(double) * (size_t)frames);
    for (int f = -8; f < frames; f++) /* eight frames to come down */
        for (int m = 0; m < MODELS; m++) {
            for (int i = 0; i < PROBES; i++) {
                to[i] = o.probe[i].pose;
                to[i].tip_m[0] += f > 0 ? 0.004 * sin(0.3 * f) : 0;
                to[i].tip_m[2] -= 0.001 * (f < 0 ? f + 9 : 9);
            }
            const double begin = processor_s();
            bench_must(tm_model_frame(model[m], to), &error);
            if (f >= 0) mean[m] += (ms[m][f] = 1e3 * (processor_s() - begin)) / frames;
        }
    cJSON *row = cJSON_CreateObject();
    cJSON_AddNumberToObject(row, "tets", o.mesh->tet_count);
    cJSON_AddNumberToObject(row, "share", (double)o.dynamic_count / o.mesh->tet_count);
    cJSON_AddNumberToObject(row, "border", report.interface_dofs);
    cJSON_AddNumberToObject(row, "hybrid_over_dynamic", mean[HYBRID] / mean[DYNAMIC]);
    cJSON_AddItemToObject(row, "ms_per_dynamic_frame", bench_quantiles(ms[DYNAMIC], frames));
    cJSON_AddItemToObject(row, "ms_per_hybrid_frame", bench_quantiles(ms[HYBRID], frames));
    printf("hybrid%7d tets, %4.1f %% tensor/mass, border of %d components: %.2f of a dynamic frame\n",
           o.mesh->tet_count, 100.0 * o.dynamic_count / o.mesh->tet_count, report.interface_dofs,
           mean[HYBRID] / mean[DYNAMIC]);
    for (int m = 0; m < MODELS; m++) tm_model_destroy(model[m]), free(ms[m]);
    tm_mesh_destroy(o.mesh);
    free(o.dynamic), free(o.dof), free(o.zero);
    return row;
}

cJSON *bench_hybrid(const bench_run *run) {
    static const int all[] = {12, 18, 26}, few[] = {6};
    cJSON *rows = cJSON_CreateArray();
    for (int s = 0; s < (run->quick ? 1 : 3); s++)
        for (int k = 0; k < 2; k++)
            cJSON_AddItemToArray(rows, one_share(run->quick ? few[s] : all[s], k ? 0.15 : 0.05, run->quick ? 3 : 20));
    return rows;
}
