#include "publish.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* --- tissue --- */

static void free_tissue(sim_publisher *p) {
    if (p->tissue.vertex_m) free(p->tissue.vertex_m[0]);
    if (p->tissue.triangle) free(p->tissue.triangle[0]);
    free(p->tissue.vertex_m);
    free(p->tissue.triangle);
    free(p->tissue.vertex_id);
    free(p->tissue.triangle_kind);
    free(p->slot_of);
}

/* Room for any surface that cutting could leave: every vertex; four faces a tetrahedron would be it, but half of them always pair up. */
static bool take_tissue(sim_publisher *p, const sim *s) {
    size_t n = (size_t)s->mesh->vertex_count, t = s->tissue_def.cuttable ? 4 * (size_t)s->mesh->tet_count : (size_t)s->mesh->surface_count;
    p->tissue.vertex_m = calloc(n, sizeof *p->tissue.vertex_m);
    p->tissue.triangle = calloc(t, sizeof *p->tissue.triangle);
    p->tissue.vertex_id = calloc(n, sizeof *p->tissue.vertex_id);
    p->tissue.triangle_kind = calloc(t, 1);
    p->slot_of = calloc(n, sizeof *p->slot_of);
    float *xyz = calloc(3 * n, sizeof *xyz);
    int32_t *corner = calloc(3 * t, sizeof *corner);
    if (!p->tissue.vertex_m || !p->tissue.triangle || !p->tissue.vertex_id || !p->tissue.triangle_kind || !p->slot_of || !xyz || !corner) {
        free(xyz);
        free(corner);
        return false;
    }
    for (size_t i = 0; i < n; ++i) p->tissue.vertex_m[i] = xyz + 3 * i;
    for (size_t i = 0; i < t; ++i) p->tissue.triangle[i] = corner + 3 * i;
    p->tissue_revision = -1;
    return true;
}

static bool was_outside(const tm_mesh *mesh, int32_t face) {
    int32_t low = 0, high = mesh->surface_count;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (mesh->surface_face[middle] < face) low = middle + 1;
        else high = middle;
    }
    return low < mesh->surface_count && mesh->surface_face[low] == face;
}

static void renumber(sim_publisher *p, const sim *s, const tm_surface_view *surface) {
    tensormass_tissue_t *m = &p->tissue;
    m->vertex_count = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; ++v) p->slot_of[v] = -1;
    for (int32_t i = 0; i < 3 * surface->count; ++i) p->slot_of[surface->triangle[i]] = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; ++v)
        if (!p->slot_of[v]) {
            p->slot_of[v] = m->vertex_count;
            m->vertex_id[m->vertex_count++] = v;
        }
    m->triangle_count = surface->count;
    for (int32_t t = 0; t < surface->count; ++t) {
        for (int c = 0; c < 3; ++c) m->triangle[t][c] = p->slot_of[surface->triangle[3 * t + c]];
        m->triangle_kind[t] = !was_outside(s->mesh, surface->face[t]);
    }
    m->topology_revision = p->tissue_revision = surface->revision;
}

static void send_tissue(sim_publisher *p, sim *s, int64_t utime) {
    tm_surface_view surface = sim_surface(s);
    if (surface.revision != p->tissue_revision) renumber(p, s, &surface);
    const double *u = sim_displacement(s);
    for (int32_t i = 0; i < p->tissue.vertex_count; ++i)
        for (int a = 0; a < 3; ++a) {
            int32_t d = 3 * p->tissue.vertex_id[i] + a;
            p->tissue.vertex_m[i][a] = (float)(s->mesh->rest_m[d] + u[d]);
        }
    p->tissue.utime = utime;
    p->tissue.seq = p->tissue_seq++;
    p->tissue.session = p->session;
    p->tissue.sim_utime = llround(sim_time_s(s) * 1e6);
    p->api->send(p->link, SIM_TISSUE, "TISSUE", utime, &p->tissue);
}

/* --- the rest --- */

int sim_publisher_open(sim_publisher *p, const sim *s, const char *url, const char *log, int64_t session) {
    tm_error error = {0};
    *p = (sim_publisher){.session = session};
    if (!url && !log) return 0;
    p->api = sim_lcm_module(&error);
    if (p->api) p->link = p->api->open(url, log, &error);
    if (!p->link) {
        p->api = NULL;
        fprintf(stderr, "tm-sim: %s\n", error.message);
        return APP_BAD_INPUT;
    }
    p->rendering = sim_options(s->scene, "rendering");
    if (p->rendering && !take_tissue(p, s)) {
        sim_publisher_close(p);
        fputs("tm-sim: out of memory for the tissue's picture; use a smaller mesh\n", stderr);
        return APP_FAILED;
    }
    return 0;
}

bool sim_publisher_close(sim_publisher *p) {
    if (!p->api) return true;
    bool good = p->api->close(p->link);
    free_tissue(p);
    p->api = NULL;
    return good;
}

void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session, int64_t tool_utime, bool stiffness,
                      int32_t flags, tensormass_force_sample_t *out) {
    const tm_tool_reaction *r = &s->reaction[instrument];
    *out = (tensormass_force_sample_t){.utime = utime, .seq = p->seq[instrument]++, .session = p->session, .instrument = (int8_t)instrument,
                                       .tool_session = tool_session, .tool_utime = tool_utime};
    memcpy(out->tip_m, r->row_count || s->contact ? r->tip_m : s->pose[instrument].tip_m, sizeof out->tip_m);
    memcpy(out->force_N, r->force_N, sizeof out->force_N);
    if (stiffness && r->stiffness_kind) {
        out->stiffness_kind = (int8_t)r->stiffness_kind;
        memcpy(out->stiffness_N_m, r->stiffness_N_m, sizeof out->stiffness_N_m);
    }
    out->flags = flags | (r->capped ? SIM_FLAG_CAPPED : 0) | (r->overflowed ? SIM_FLAG_OVERFLOWED : 0);
    out->topology_revision = sim_surface(s).revision;
}

void sim_publish_force(sim_publisher *p, int64_t utime, const tensormass_force_sample_t *sample) {
    char channel[16];
    if (!p->api) return;
    snprintf(channel, sizeof channel, "FORCE_%d", sample->instrument);
    p->api->send(p->link, SIM_FORCE, channel, utime, sample);
}

void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed) {
    static char models[][12] = {"dynamic", "precomputed", "hybrid"};
    if (!p->api) return;
    tensormass_sim_status_t m = {.utime = utime, .seq = p->status_seq++, .session = p->session, .scene = (char *)(uintptr_t)s->scene->file,
                                 .model = models[s->scene->model.index], .tets_alive = tm_tissue_alive_count(s->tissue), .substeps = s->substeps,
                                 .dt_s = s->dt_s, .frame_s = s->frame_s, .compute_s = compute_s, .sim_seconds_per_wall_second = speed,
                                 .dropped_utime = p->dropped_us, .instrument_count = (int8_t)s->instrument_count};
    for (int i = 0; i < s->instrument_count; ++i) {
        memcpy(m.tip_m[i], s->pose[i].tip_m, sizeof m.tip_m[i]);
        memcpy(m.trocar_m[i], s->instrument_def[i].trocar_m, sizeof m.trocar_m[i]);
        for (int a = 0; a < 3; ++a) { /* columns z and y of the instrument's axes */
            m.axis[i][a] = s->axes[i][3 * a + 2];
            m.up[i][a] = s->axes[i][3 * a + 1];
        }
        memcpy(m.force_N[i], s->reaction[i].force_N, sizeof m.force_N[i]);
        for (int a = 0; a < 3; ++a) {
            m.axis[i][a] = s->axes[i][3 * a + 2];
            m.up[i][a] = s->axes[i][3 * a + 1];
        }
        m.radius_m[i] = s->instrument_def[i].radius_m;
        m.roll_rad[i] = s->pose[i].roll_rad;
        m.grip[i] = s->pose[i].grip;
        m.mode[i] = (int8_t)s->instrument_def[i].mode;
        m.active[i] = s->pose[i].active;
    }
    p->api->send(p->link, SIM_STATUS, "SIM_STATUS", utime, &m);
    if (p->rendering && s->frames % p->rendering->every.value == 0) send_tissue(p, s, utime);
}
