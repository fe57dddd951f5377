/* Rows of tissue that is cut or held while it is felt. Cuts are the truth's: the simulation of 20 Hz removes the same
 * tetrahedra at the same simulated times, so that what differs is the extrapolation. A cautery that cuts for itself at
 * 20 Hz cuts a little otherwise, and its row says how many it shares with the truth. */
#include <stdio.h>
#include <string.h>

#include "evaluate.h"
#include "json_file.h"

static const double SPEED_M_S = 0.01, TREMOR_M = 40e-6, RATE_HZ = 20;

static int sampled_rows(model m, const path *p, const recording *truth, bool own_cuts, cJSON *rows) {
    recording r = {.replay = own_cuts || !truth->cuts.count ? NULL : &truth->cuts};
    char name[64];
    snprintf(name, sizeof name, "%s%s", path_name[p->kind], own_cuts ? ", own cuts" : "");
    const setting s = {.model = model_name[m],
                       .path = name,
                       .rate = RATE_HZ,
                       .speed = p->speed_m_s,
                       .tremor = p->tremor_m,
                       .encoders = true};
    int rc = record(m, p, RATE_HZ, true, true, &r);
    if (!rc) copy_truth(truth, &r);
    for (int late = 0; late <= 2 && !rc; late++) {
        int before = cJSON_GetArraySize(rows);
        const conditions c = {.latency_frames = late, .seed = 1};
        add_errors(rows, &r, &s, &c, "model");
        const float blend_us = r.params.blend_us;
        r.params.blend_us = 0; /* what the bridge from one cut state to the next costs */
        if (truth->cuts.count) add_error(rows, &r, &s, &c, "model", HRT_CONTACT, "contact-unbridged");
        r.params.blend_us = blend_us;
        for (int i = before; i < cJSON_GetArraySize(rows); i++) {
            cJSON *row = cJSON_GetArrayItem(rows, i);
            app_json_add(row, "cut_true %d cut_shared %d", truth->cuts.count,
                         own_cuts ? cut_list_shared(&truth->cuts, &r.cuts) : truth->cuts.count);
        }
    }
    recording_free(&r);
    return rc;
}

static int one(model m, path_kind kind, cJSON *rows) {
    path p = path_make(kind, SPEED_M_S, TREMOR_M);
    recording truth = {0};
    int rc = record_truth(m, &p, true, &truth);
    if (!rc) rc = sampled_rows(m, &p, &truth, false, rows);
    if (!rc && kind != PATH_GRASPED) rc = sampled_rows(m, &p, &truth, true, rows);
    recording_free(&truth);
    return rc;
}

/* Of isotropic tissue; cutting where it can be cut. */
static bool can(int m, path_kind kind) {
    return m == MODEL_ISOTROPIC || m == MODEL_HYBRID || (m == MODEL_PRECOMPUTED && kind == PATH_GRASPED);
}

int study_hands(const study_run *run, cJSON *rows) {
    int rc = 0;
    for (int kind = PATH_OTHER_HAND_CUTS; kind < PATH_NAMED; kind++) {
        if (!run->path[kind]) continue;
        progress(path_name[kind], (double)(kind - PATH_OTHER_HAND_CUTS) / (PATH_NAMED - PATH_OTHER_HAND_CUTS));
        for (int m = 0; m < MODEL_COUNT && !rc; m++)
            if (run->model[m] && can(m, (path_kind)kind)) rc = one((model)m, (path_kind)kind, rows);
    }
    return rc;
}
