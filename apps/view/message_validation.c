#include "message_validation.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const double SILENT_S = 1.0;
static const double FAR_M = 1e3, LARGE_N = 1e6;

void view_intake_begin(view_intake *intake) {
    memset(intake, 0, sizeof *intake);
    intake->tissue_s = intake->status_s = -1;
}

void view_intake_refuse(view_intake *intake, const char *channel, const char *format, ...) {
    va_list list;
    const size_t room = sizeof intake->counts.why;
    const int head = snprintf(intake->counts.why, room, "%.40s: ", channel);
    va_start(list, format);
    vsnprintf(intake->counts.why + head, room - (size_t)head, format, list);
    va_end(list);
    intake->counts.rejected++;
}

static bool all_within(const double *value, int count, double limit) {
    for (int i = 0; i < count; i++)
        if (!(fabs(value[i]) <= limit)) return false;
    return true;
}

/* Copies text for display: bytes that are not printable ASCII become '?'. */
static void copy_text(char *to, size_t room, const char *from) {
    size_t n = 0;
    for (; from[n] && n + 1 < room; n++) to[n] = from[n] >= ' ' && from[n] <= '~' ? from[n] : '?';
    to[n] = 0;
}

/* Returns null if every index and number can be drawn, else what is wrong. */
static const char *tissue_fault(const tensormass_tissue_t *m) {
    if (m->vertex_count > VIEW_VERTICES_MAX || m->triangle_count > VIEW_TRIANGLES_MAX)
        return "more vertices or triangles than can be drawn";
    for (int32_t i = 0; i < m->vertex_count; i++) {
        for (int k = 0; k < 3; k++)
            if (!(fabsf(m->vertex_m[i][k]) <= (float)FAR_M)) return "a coordinate is not finite, or beyond 1000 m";
        if (m->vertex_id[i] < 0) return "a vertex number is negative";
    }
    for (int32_t i = 0; i < m->triangle_count; i++) {
        const int32_t *t = m->triangle[i];
        for (int k = 0; k < 3; k++)
            if (t[k] < 0 || t[k] >= m->vertex_count) return "a triangle has a vertex that does not exist";
        if (m->triangle_kind[i] < 0 || m->triangle_kind[i] > 1) return "a triangle's kind is neither 0 nor 1";
    }
    return NULL;
}

static const char *ties_fault(const tensormass_tissue_t *m) {
    if (m->tie_total > VIEW_TIES_MAX) return "more ties than can be drawn";
    if (m->tie_count > m->tie_total) return "more ties hold than the scene has";
    for (int32_t i = 0; i < m->tie_count; i++) {
        if (m->tie_id[i] < 0 || m->tie_id[i] >= m->tie_total) return "a tie's number is not one of the scene's";
        for (int k = 0; k < 6; k++)
            if (!(fabsf(m->tie_m[i][k]) <= (float)FAR_M)) return "an end of a tie is not finite, or beyond 1000 m";
    }
    return NULL;
}

static bool read_tissue(view_surface *s, const tensormass_tissue_t *m) {
    bool same =
        s->vertex_count == m->vertex_count && s->triangle_count == m->triangle_count && s->session == m->session;
    if (!view_surface_reserve(s, m->vertex_count, m->triangle_count)) return false;
    for (int32_t i = 0; i < m->vertex_count; i++) {
        memcpy(s->vertex_m + 3 * i, m->vertex_m[i], 3 * sizeof(float));
        same = same && s->vertex_id[i] == m->vertex_id[i];
        s->vertex_id[i] = m->vertex_id[i];
    }
    for (int32_t i = 0; i < m->triangle_count; i++) {
        same = same && !memcmp(s->triangle + 3 * i, m->triangle[i], 3 * sizeof(int32_t)) &&
               (s->kind[i] & 1) == m->triangle_kind[i];
        memcpy(s->triangle + 3 * i, m->triangle[i], 3 * sizeof(int32_t));
        s->kind[i] = (uint8_t)((s->kind[i] & ~1) | m->triangle_kind[i]);
    }
    s->vertex_count = m->vertex_count, s->triangle_count = m->triangle_count;
    s->session = m->session, s->revision = m->topology_revision;
    s->version++;
    if (!same) ++s->topology;
    return true;
}

static bool read_ties(view_ties *t, const tensormass_tissue_t *m) {
    if (!view_ties_reserve(t, m->tie_count)) return false;
    for (int32_t i = 0; i < m->tie_count; i++) memcpy(t->end_m + 6 * i, m->tie_m[i], 6 * sizeof(float));
    t->total = m->tie_total, t->count = m->tie_count;
    return true;
}

void view_intake_tissue(view_intake *in, view_picture *p, double time_s, const tensormass_tissue_t *m) {
    const char *fault = tissue_fault(m);
    if (!fault) fault = ties_fault(m);
    if (fault)
        view_intake_refuse(in, "TISSUE", "%s", fault);
    else if (!read_tissue(&p->surface, m) || !read_ties(&p->ties, m))
        view_intake_refuse(in, "TISSUE", "no memory for %d vertices and %d ties", m->vertex_count, m->tie_count);
    else
        in->tissue_s = time_s, ++in->counts.accepted;
}

static const char *status_fault(const tensormass_sim_status_t *m) {
    if (m->instrument_count < 0 || m->instrument_count > VIEW_INSTRUMENTS) return "instrument_count is not 0, 1 or 2";
    for (int i = 0; i < m->instrument_count; i++) {
        if (!all_within(m->tip_m[i], 3, FAR_M) || !all_within(m->trocar_m[i], 3, FAR_M))
            return "an instrument's position is not finite";
        if (!all_within(m->direction[i], 3, 1.01)) return "the direction of a shaft is not a unit vector";
        if (!all_within(m->axis[i], 3, 1e6) || !all_within(m->up[i], 3, 1e6))
            return "an instrument's axis is not finite";
        if (!(m->radius_m[i] > 0 && m->radius_m[i] <= 0.1)) return "an instrument's radius is not in (0, 0.1] m";
        if (!all_within(m->force_N[i], 3, LARGE_N)) return "a force is not finite";
        if (!all_within(&m->patch_age[i], 1, 1)) return "the age of a patch is not -1 or 0 to 1";
        if (!all_within(&m->roll_rad[i], 1, 1e6) || !all_within(&m->grip[i], 1, 10))
            return "roll or grip is not finite";
        if (m->device[i] < 0 || m->device[i] >= hrt_device_type_count)
            return "an instrument's device is not one that this program knows";
    }
    const double numbers[] = {m->dt_s, m->frame_s, m->compute_s, m->sim_seconds_per_wall_second, m->sample_rate_Hz};
    return all_within(numbers, 5, 1e9) ? NULL : "a time is not finite";
}

static void read_instrument(view_instrument *t, const tensormass_sim_status_t *m, int i) {
    t->shown = true;
    t->device = hrt_device_types[m->device[i]];
    t->mode = (hrt_mode)m->mode[i], t->active = m->active[i] != 0;
    memcpy(t->tip_m, m->tip_m[i], sizeof t->tip_m);
    memcpy(t->trocar_m, m->trocar_m[i], sizeof t->trocar_m);
    memcpy(t->direction, m->direction[i], sizeof t->direction);
    t->is_free = m->is_free[i] != 0;
    memcpy(t->axis, m->axis[i], sizeof t->axis);
    memcpy(t->up, m->up[i], sizeof t->up);
    memcpy(t->force_N, m->force_N[i], sizeof t->force_N);
    t->patch_age = m->patch_age[i];
    t->radius_m = m->radius_m[i], t->roll_rad = m->roll_rad[i], t->grip = m->grip[i];
}

void view_intake_status(view_intake *in, view_picture *p, double time_s, const tensormass_sim_status_t *m) {
    const char *fault = status_fault(m);
    if (fault) {
        view_intake_refuse(in, "SIM_STATUS", "%s", fault);
        return;
    }
    const char *name = strrchr(m->scene, '/');
    copy_text(p->title, sizeof p->title, name ? name + 1 : m->scene);
    copy_text(p->model, sizeof p->model, m->model);
    p->has_status = true;
    p->tets = m->tets_alive, p->substeps = m->substeps, p->compute_s = m->compute_s;
    p->sim_rate = m->sim_seconds_per_wall_second, p->frame_hz = m->frame_s > 0 ? 1 / m->frame_s : 0;
    p->sample_hz = m->sample_rate_Hz;
    float force[VIEW_INSTRUMENTS] = {0};
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) {
        p->instrument[i].shown = false;
        if (i >= m->instrument_count) continue;
        read_instrument(&p->instrument[i], m, i);
        const double *f = m->force_N[i];
        force[i] = (float)sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    }
    view_trace_add(&p->trace, time_s, force);
    in->status_s = time_s, ++in->counts.accepted;
}

void view_intake_controller(view_intake *in, view_picture *p, double time_s, int i,
                            const tensormass_controller_status_t *m) {
    view_instrument *t = &p->instrument[i];
    struct controller_memory *old = &in->controller[i];
    const double numbers[] = {m->lateness_us[1], m->sample_age_s};
    if (!all_within(numbers, 2, 1e12)) {
        view_intake_refuse(in, i ? "CONTROLLER_1" : "CONTROLLER_0", "a time is not finite");
        return;
    }
    double passed_s = (double)(m->utime - old->utime) * 1e-6;
    if (t->has_controller && old->session == m->session && passed_s > 0.01 && passed_s < 10)
        t->tick_hz = (double)(m->ticks - old->ticks) / passed_s;
    t->has_controller = true;
    t->state = (hrt_state)m->state, t->fault = m->fault, t->passivity = m->passivity_on != 0;
    copy_text(t->fault_text, sizeof t->fault_text, m->fault_text);
    copy_text(t->extrapolator, sizeof t->extrapolator, m->extrapolator);
    t->lateness_p99_us = m->lateness_us[1], t->sample_age_s = m->sample_age_s, t->missed_ticks = m->missed_ticks;
    *old = (struct controller_memory){m->session, m->utime, m->ticks, time_s};
    in->counts.accepted++;
}

void view_intake_age(view_intake *in, view_picture *p, double time_s) {
    p->time_s = time_s;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++)
        if (p->instrument[i].has_controller && time_s - in->controller[i].heard_s > SILENT_S)
            p->instrument[i].has_controller = false;
    if (in->tissue_s < 0)
        snprintf(p->notice, sizeof p->notice, "waiting for TISSUE: start tm-sim --realtime SCENE");
    else if (time_s - in->tissue_s > SILENT_S)
        snprintf(p->notice, sizeof p->notice, "no TISSUE for %.0f s: waiting for tm-sim", floor(time_s - in->tissue_s));
    else
        p->notice[0] = 0;
}
