/* Tissue in the closed loop: a model of the study on a coarse mesh, simulated between two samples. A factor on forces
 * makes it that many times as stiff and as dense, contact compliance included; its motion, being linear, is
 * unchanged. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "evaluate.h"
#include "sim/publish.h"

struct loop_tissue {
    sim *s;
    sim_publisher publisher;
    double factor, touch_m;
    bool placed;
};

loop_tissue *loop_tissue_open(model m, double rate_Hz, double factor) {
    char mesh[2048], of_mesh[2100];
    const char *const coarse[] = {of_mesh, NULL};
    loop_tissue *t = app_zeroed(1, sizeof *t);
    app_shared_file("meshes/block_1k.msh", mesh, sizeof mesh);
    snprintf(of_mesh, sizeof of_mesh, "tissue.mesh=%s", mesh);
    t->s = model_open(m, rate_Hz, coarse);
    if (!t->s) return free(t), NULL;
    const tm_instrument_def *def = &t->s->instrument_def[0];
    double top = -HUGE_VAL;
    for (int32_t v = 0; v < t->s->mesh->vertex_count; v++) top = fmax(top, t->s->mesh->rest_m[3 * v + 2]);
    t->touch_m = def->trocar_m[2] - top - def->radius_m;
    t->publisher.session = 1;
    t->factor = factor;
    t->s->wants[0] = t->s->can_send;
    return t;
}

void loop_tissue_close(loop_tissue *t) {
    if (t) sim_destroy(t->s);
    free(t);
}

double loop_tissue_touch_m(const loop_tissue *t) { return t->touch_m; }

hrt_pose loop_tissue_pose(const loop_tissue *t) {
    hrt_pose pose = {.axis = {0, 0, -1}, .up = {0, 1, 0}};
    memcpy(pose.trocar_m, t->s->instrument_def[0].trocar_m, sizeof pose.trocar_m);
    return pose;
}

bool loop_tissue_frame(loop_tissue *t, const tensormass_tool_state_t *tool, int64_t now_us,
                       tensormass_force_sample_t *out, tensormass_contact_patch_t *patch) {
    tm_tool_pose to[TM_MAX_INSTRUMENTS] = {{.active = true}};
    memcpy(to[0].tip_m, tool->tip_m, sizeof to[0].tip_m);
    if (!t->placed) tm_model_set_pose(t->s->model, 0, &to[0]);
    t->placed = true;
    const bool failed = sim_frame(t->s, to, t->s->substeps) != TM_OK;
    sim_force_sample(&t->publisher, t->s, 0, now_us, tool->session, tool->utime, failed ? SIM_FLAG_UNSTABLE : 0, out);
    const bool has = !failed && sim_contact_patch(&t->publisher, t->s, out, patch);
    for (int i = 0; i < 3; i++) out->force_N[i] *= t->factor;
    for (int i = 0; i < 9; i++) out->stiffness_N_m[i] *= t->factor;
    if (!has) return false;
    const int places = 3 * patch->vertex_count;
    for (int i = 0; i < places * (places + 1) / 2; i++) patch->compliance_m_N[i] /= (float)t->factor;
    patch->contact_compliance_m_N /= (float)t->factor;
    patch->radiation_N_s_m *= (float)t->factor;
    return true;
}
