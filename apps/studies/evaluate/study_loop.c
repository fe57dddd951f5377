/* The closed loop: device, hand, controller and a delayed simulation of a soft surface. For each extrapolator and rate
 * it finds the stiffest contact whose oscillation decays: after a step of 1 mm in the hand's demand the insertion stays
 * within one encoder count.
 *
 * The surface is a patch with an exponential compliance kernel, solved at the samples as `local_model` solves it at the
 * ticks. Conditions: no Coulomb friction; coupling off; force, slew and stiffness limits inactive (a case with an
 * active limit does not count as stable); the same device and hand for all. Theory, for zero-order hold: b > K (T/2 +
 * delay) + B, with b the damping of device and hand together, B that of the surface, delay that of the samples plus a
 * tick (Colgate and Schenkel 1997; Diolaiti et al. 2006). The condition suffices for any passive hand; this hand may be
 * stable beyond it.
 *
 * On tissue (loop_tissue.c) the same loop is searched from above. There tissue with mass responds in the next frame to
 * an encoder step of the tool, and a few counts of motion may remain.
 *
 * Over 400 lines: the loop, its search and the tables that are made of it share their cases and results. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "device/device.h"
#include "evaluate.h"
#include "io/node.h"
#include "json_file.h"

enum { COLUMNS = 5, ROWS = 4, VERTICES = COLUMNS * ROWS, MAX_LINE = 8 };
static const double TISSUE_COUNTS = 4;
static const double TISSUE_M_N = 1.0 / 50; /* approximate compliance of the study's tissue under the tip */
static const double SPACING_M = 0.005, KERNEL_M = 0.008, RADIUS_M = 0.0035, SURFACE_M = 0.12, PRESS_M = 0.002,
                    SECONDS = 6, STEP_AT_S = 3, ERROR_S = 0.2;

/* Makes a flat patch below the tool, prepared like a received one: surface at insertion SURFACE_M, outward normal
 * towards the trocar. */
static void make_patch(hrt_patch *p, double compliance_m_N) {
    *p = (hrt_patch){.vertex_count = VERTICES,
                     .radius_m = (float)RADIUS_M,
                     .contact_length_m = 0.05f,
                     .contact_compliance_m_N = (float)(0.05 * compliance_m_N)};
    for (int i = 0; i < VERTICES; i++) {
        p->vertex_m[3 * i] = (float)(SPACING_M * (i % COLUMNS - 1.9));
        p->vertex_m[3 * i + 1] = (float)(SPACING_M * (i / COLUMNS - 1.4));
        p->vertex_m[3 * i + 2] = (float)SURFACE_M;
    }
    for (int c = 0; c < (COLUMNS - 1) * (ROWS - 1); c++) {
        uint8_t a = (uint8_t)(c % (COLUMNS - 1) + COLUMNS * (c / (COLUMNS - 1))), b = (uint8_t)(a + 1),
                d = (uint8_t)(a + COLUMNS), e = (uint8_t)(d + 1);
        uint8_t t[6] = {a, d, b, b, d, e}; /* counter-clockwise seen from the trocar, that is from smaller z */
        memcpy(p->triangle + 6 * p->triangle_count / 2, t, sizeof t);
        p->triangle_count += 2;
    }
    int at = 0;
    for (int i = 0; i < 3 * VERTICES; i++)
        for (int j = i; j < 3 * VERTICES; j++, at++) {
            const float *a = p->vertex_m + 3 * (i / 3), *b = p->vertex_m + 3 * (j / 3);
            double d = hypot((double)a[0] - (double)b[0], (double)a[1] - (double)b[1]);
            p->compliance_m_N[at] = i % 3 == j % 3 ? (float)(compliance_m_N * exp(-d / KERNEL_M)) : 0;
        }
    static float scratch[HRT_PATCH_COMPLIANCE];
    if (hrt_patch_prepare(p, scratch) != HRT_ACCEPT) abort(); /* a patch from this file, always valid */
}

/* Computes the surface's converged reaction on a tip (relative to the trocar), and its stiffness by central
 * differences. */
static void surface_force(const hrt_patch *patch, const hrt_params *params, const float tip[3], float force[3]) {
    static hrt_extrapolation x;
    hrt_sample s = {.tip_m = {tip[0], tip[1], tip[2]}, .unilateral = true, .patch = patch};
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    hrt_extrapolation_sample(&x, params, &s);
    float before[3] = {NAN, NAN, NAN};
    for (int i = 0; i < 10 && memcmp(before, force, sizeof before) != 0; i++) {
        memcpy(before, force, sizeof before);
        hrt_extrapolation_force(&x, params, 0, tip, force);
    }
}

static void surface_stiffness(const hrt_patch *patch, const hrt_params *params, const float tip[3], double K[9]) {
    for (int j = 0; j < 3; j++) {
        float a[3] = {tip[0], tip[1], tip[2]}, b[3] = {tip[0], tip[1], tip[2]}, fa[3], fb[3];
        const float h = 2e-5f;
        a[j] += h, b[j] -= h;
        surface_force(patch, params, a, fa), surface_force(patch, params, b, fb);
        for (int i = 0; i < 3; i++) K[3 * i + j] = (double)(fa[i] - fb[i]) / (2 * (double)h);
    }
}

typedef struct loop_case {
    hrt_extrapolator which;
    double rate_Hz;
    int delay_frames;
    bool passivity;
    int model;                     /* of the tissue; -1: the exponential surface */
    int tick_us;                   /* period of controller and device */
    double wall_N_s_m;             /* damping of the exponential surface along the shaft, constant between samples */
    const hrt_device_type *device; /* null: the default; else its limits are lifted, so that none is active */
    double device_late_us;         /* delay of the device's torques */
} loop_case;

/* Above this rate a simulation sends neither stiffness nor patch (libtensormass/scene/queries.c). */
static const double informed_rate_max_Hz = 50;

static bool is_informed(const loop_case *c) { return c->model >= 0 || c->rate_Hz <= informed_rate_max_Hz; }
static bool takes_patch(hrt_extrapolator which) { return which == HRT_LOCAL_MODEL || which == HRT_ADAPTIVE; }

typedef struct loop_result {
    bool settled, limited, engaged;
    double stiffness_N_m; /* stiffness of the surface along the shaft where the tool rests */
    double last_swing_m;
    double error_N, error_max_N; /* force at the motors less that of the surface at the tip, for 0.2 s from the step */
} loop_result;

typedef struct waiting {
    int64_t due_us;
    tensormass_force_sample_t sample;
} waiting;

typedef struct loop {
    hrt_loopback bus;
    hrt_bus node_bus, device_bus;
    hrt_node node;
    hrt_device device;
    hrt_patch patch;
    loop_tissue *tissue; /* null: the exponential surface */
    double touch_m;      /* insertion at which the tip touches */
    double along_N_m;    /* stiffness along the shaft at the last sample */
    double deep_m;       /* depth of the tip along the shaft at the last sample; 0: none yet */
    waiting line[MAX_LINE];
    int waiting_count;
    uint32_t seq;
} loop;

/* Sets up the loop. Returns false if the tissue is not available. */
static bool set_up(loop *l, const loop_case *c, double compliance) {
    memset(l, 0, sizeof *l);
    if (c->model >= 0 && !(l->tissue = loop_tissue_open((model)c->model, c->rate_Hz, TISSUE_M_N / compliance)))
        return false;
    l->touch_m = l->tissue ? loop_tissue_touch_m(l->tissue) : SURFACE_M - RADIUS_M;
    hrt_loopback_init(&l->bus);
    hrt_bus_open_loopback(&l->device_bus, &l->bus);
    hrt_bus_open_loopback(&l->node_bus, &l->bus);
    hrt_device_config device = hrt_device_config_of(c->device ? c->device : hrt_device_types[0], 0);
    for (int j = 0; j < HRT_MOTORS; j++) device.coulomb[j] = 0;
    device.period_us = c->tick_us;
    device.delay_us = c->device_late_us;
    device.rest[HRT_INSERTION] = l->touch_m + (l->tissue ? -0.001 : PRESS_M); /* on tissue the tool starts outside */
    hrt_node_config node = hrt_node_config_default(0);
    if (c->device) {
        device.profile.force_max_N = 20;
        for (int j = 0; j < HRT_MOTORS; j++) device.profile.torque_max[j] = 30;
        node.params = device.profile;
    }
    if (l->tissue) node.pose = loop_tissue_pose(l->tissue);
    node.pose_known = true, node.extrapolator = c->which, node.passivity = c->passivity;
    node.params.period_us = (float)c->tick_us;
    node.params.slew_max_N_s = node.params.axis_slew_max_N_s = 20000, node.params.stiffness_max_N_m = 1e6f;
    node.params.power_max_W = node.params.axis_power_max_W = 100;
    node.params.patch_stale_us = node.params.stale_us = 900000; /* slow rates are studied, not stale samples */
    node.params.horizon_us = 900000;
    hrt_device_init(&l->device, &device, &l->device_bus);
    hrt_node_init(&l->node, &node, &l->node_bus);
    make_patch(&l->patch, compliance);
    return true;
}

static void post(loop *l, const waiting *w) {
    const hrt_patch *p = &l->patch;
    tensormass_contact_patch_t m = {.session = 1,
                                    .seq = w->sample.seq,
                                    .vertex_count = VERTICES,
                                    .triangle_count = p->triangle_count,
                                    .contact_compliance_m_N = p->contact_compliance_m_N,
                                    .radius_m = p->radius_m,
                                    .contact_length_m = p->contact_length_m};
    memcpy(m.vertex_m, p->vertex_m, sizeof m.vertex_m);
    memcpy(m.triangle, p->triangle, sizeof m.triangle);
    memcpy(m.compliance_m_N, p->compliance_m_N, sizeof m.compliance_m_N);
    if (takes_patch(l->node.config.extrapolator) && w->sample.stiffness_kind) hrt_node_post_patch(&l->node, &m);
    hrt_node_post_sample(&l->node, &w->sample);
}

/* Samples of tissue have no delay. */
static void simulate_tissue(loop *l, int64_t now_us, const tensormass_tool_state_t *tool) {
    static tensormass_contact_patch_t patch;
    tensormass_force_sample_t sample;
    const bool has = loop_tissue_frame(l->tissue, tool, now_us, &sample, &patch);
    l->along_N_m = -sample.stiffness_N_m[8];
    if (has && takes_patch(l->node.config.extrapolator)) hrt_node_post_patch(&l->node, &patch);
    hrt_node_post_sample(&l->node, &sample);
}

/* Samples the tool now; the line delays the message. */
static void simulate(loop *l, const loop_case *c, int64_t now_us, int64_t frame_us,
                     const tensormass_tool_state_t *tool) {
    if (l->tissue) {
        simulate_tissue(l, now_us, tool);
        return;
    }
    /* without delay it is received in the next tick; delayed by frames, one frame later */
    waiting w = {.due_us = now_us + (c->delay_frames ? c->delay_frames * frame_us + 1 : 0)};
    w.sample = (tensormass_force_sample_t){.utime = now_us,
                                           .session = 1,
                                           .tool_session = tool->session,
                                           .tool_utime = tool->utime,
                                           .seq = (int32_t)l->seq++,
                                           .stiffness_kind = is_informed(c) ? 2 : 0};
    float tip[3], force[3];
    for (int i = 0; i < 3; i++) w.sample.tip_m[i] = tool->tip_m[i], tip[i] = (float)tool->tip_m[i];
    surface_force(&l->patch, &l->node.config.params, tip, force);
    for (int i = 0; i < 3; i++) w.sample.force_N[i] = (double)force[i];
    if (l->deep_m > 0 && force[2] < 0) /* the surface damps and never attracts */
        w.sample.force_N[2] = fmin(w.sample.force_N[2] - c->wall_N_s_m * ((double)tip[2] - l->deep_m) * c->rate_Hz, 0);
    l->deep_m = (double)tip[2];
    if (is_informed(c) && (c->which == HRT_TANGENT || takes_patch(c->which)))
        surface_stiffness(&l->patch, &l->node.config.params, tip, w.sample.stiffness_N_m);
    if (c->delay_frames == 0)
        post(l, &w);
    else if (l->waiting_count < MAX_LINE)
        l->line[l->waiting_count++] = w;
}

static void deliver(loop *l, int64_t now_us) {
    while (l->waiting_count && l->line[0].due_us <= now_us) {
        post(l, &l->line[0]);
        memmove(l->line, l->line + 1, sizeof *l->line * (size_t)--l->waiting_count);
    }
}

/* Adds the difference between the device's force along the shaft and that of the surface where the tip is now. */
static void add_error(loop *l, loop_result *r, int *count) {
    const float tip[3] = {(float)l->device.joint[0], (float)l->device.joint[1], (float)l->device.joint[2]};
    float force[3];
    surface_force(&l->patch, &l->node.config.params, tip, force);
    const double error = l->device.torque[2] - (double)force[2];
    r->error_N += error * error;
    r->error_max_N = fmax(r->error_max_N, fabs(error));
    ++*count;
}

/* Runs the loop. `settling` asks whether it settles alone, so that one whose limits act ends at once. */
static loop_result run_loop(const loop_case *c, double compliance, bool settling) {
    static loop l;
    loop_result r = {0};
    tensormass_tool_state_t tool = {0};
    double low = 1, high = 0;
    int samples = 0;
    if (!set_up(&l, c, compliance)) return r;
    int64_t frame_us = llround(1e6 / c->rate_Hz), next_frame = 0, end = (int64_t)(SECONDS * 1e6);
    for (int64_t t = 0; t < end && !(settling && r.limited); t += c->tick_us) {
        int64_t now = 1000000 + t;
        double s = 1e-6 * (double)t,
               joint[HRT_JOINTS] = {0, 0, l.touch_m + PRESS_M + (s > STEP_AT_S ? 0.001 : 0), 0, 0};
        hrt_device_hand(&l.device, joint, false);
        hrt_device_step(&l.device, now);
        deliver(&l, now);
        hrt_node_tick(&l.node, now, &tool);
        if (t >= next_frame && tool.session) {
            simulate(&l, c, now, frame_us, &tool);
            next_frame += frame_us;
        }
        r.engaged |= l.node.result.state == HRT_ENGAGED;
        if (s > STEP_AT_S - 1)
            r.limited |=
                (l.node.result.limits & (HRT_LIMIT_FORCE | HRT_LIMIT_AXIS | HRT_LIMIT_SLEW | HRT_LIMIT_POWER)) != 0;
        if (!l.tissue && s > STEP_AT_S && s <= STEP_AT_S + ERROR_S) add_error(&l, &r, &samples);
        if (s > SECONDS - 1)
            low = fmin(low, l.device.joint[HRT_INSERTION]), high = fmax(high, l.device.joint[HRT_INSERTION]);
    }
    float tip[3] = {0, 0, (float)l.device.joint[HRT_INSERTION]};
    double K[9];
    if (!l.tissue) surface_stiffness(&l.patch, &l.node.config.params, tip, K), l.along_N_m = -K[8];
    r.stiffness_N_m = l.along_N_m;
    if (samples) r.error_N = sqrt(r.error_N / samples);
    r.last_swing_m = high - low;
    r.settled =
        r.engaged && l.node.result.state == HRT_ENGAGED && !r.limited &&
        r.last_swing_m <= (l.tissue ? TISSUE_COUNTS : 1) / (double)l.node.config.params.counts_per_unit[HRT_INSERTION];
    loop_tissue_close(l.tissue);
    return r;
}

/* Finds the largest stable stiffness, by growing steps and then bisection; `beyond` if nothing tried was unstable. */
static loop_result largest(const loop_case *c, bool quick, bool *beyond) {
    loop_result best = {0};
    double good = 0, bad = 0, growth = quick ? 2.2 : 1.6;
    *beyond = false;
    for (double compliance = 1.0 / 50; !(bad > 0); compliance /= growth) {
        if (compliance < 1.0 / 60000) {
            *beyond = true;
            return best;
        }
        loop_result r = run_loop(c, compliance, true);
        if (r.settled)
            best = r, good = compliance;
        else
            bad = compliance;
    }
    if (!(good > 0)) return best;
    for (int i = 0; i < (quick ? 2 : 3); i++) {
        double middle = sqrt(good * bad);
        loop_result r = run_loop(c, middle, true);
        if (r.settled)
            best = r, good = middle;
        else
            bad = middle;
    }
    return best;
}

/* Adds the largest stable stiffness of a case as a row. */
static void add_largest(cJSON *rows, const loop_case *c, bool quick, double damping_N_s_m) {
    bool beyond;
    const loop_result r = largest(c, quick, &beyond);
    cJSON *row = app_json_add(
        rows,
        "extrapolator %s rate_Hz %g tick_Hz %g delay_frames %d passivity %hhd stiffness_N_m %g beyond %hhd wall_N_s_m %g",
        hrt_extrapolator_name(c->which), c->rate_Hz, 1e6 / c->tick_us, c->delay_frames, c->passivity, r.stiffness_N_m,
        beyond, c->wall_N_s_m);
    /* a sample is received in the tick after it was taken */
    const double late_s = (0.5 + c->delay_frames) / c->rate_Hz + 1e-6 * c->tick_us;
    app_json_add(row, "theory_N_m %g", (damping_N_s_m - c->wall_N_s_m) / late_s);
}

/* Returns whether a law is tested. At streaming rates only forces are sent, so fewer laws differ. */
static bool is_asked(double rate_Hz, int law) {
    return rate_Hz <= informed_rate_max_Hz || law == HRT_HOLD || law == HRT_POSITION || law == HRT_ADAPTIVE;
}

/* Adds the Z-width of zero-order hold by rates of samples and ticks, latency, and the surface's damping. */
static void add_z_width(cJSON *rows, bool quick, double damping_N_s_m) {
    static const struct {
        double rate_Hz;
        int tick_us;
    } whole[] = {{25, 2000}, {100, 2000}, {250, 2000}, {500, 2000}, {1000, 1000}, {2000, 500}},
      brief[] = {{25, 2000}, {500, 2000}};
    static const double wall_N_s_m[] = {0, 3, 6, 9};
    const int count = quick ? 2 : (int)(sizeof whole / sizeof *whole);
    for (int k = 0; k < count; k++) {
        const double rate_Hz = quick ? brief[k].rate_Hz : whole[k].rate_Hz;
        const int tick_us = quick ? brief[k].tick_us : whole[k].tick_us;
        progress("Z-width", (double)k / count);
        for (int w = 0; w < 4; w += quick ? 2 : 1)
            add_largest(rows, &(loop_case){HRT_HOLD, rate_Hz, 0, false, -1, tick_us, wall_N_s_m[w], NULL, 0}, quick,
                        damping_N_s_m);
        for (int late = 0; late < (quick ? 0 : 3); late++) {
            if (late)
                add_largest(rows, &(loop_case){HRT_HOLD, rate_Hz, late, false, -1, tick_us, 0, NULL, 0}, quick,
                            damping_N_s_m);
            add_largest(rows, &(loop_case){HRT_HOLD, rate_Hz, late, true, -1, tick_us, 0, NULL, 0}, quick,
                        damping_N_s_m);
        }
    }
}

/* Returns whether the device slides, and is no form of another with its handle's tilt: that has the same twin. */
static bool is_desk_device(const hrt_device_type *device) { return device->slides && !device->tilts; }

/* Adds the Z-width of each desk device, by its virtual twin, which differ in mass and friction: `hold` at a sample each
 * tick. */
static void add_devices(cJSON *rows, bool quick) {
    const int32_t inverse3 = hrt_device_type_find("inverse3"), omega = hrt_device_type_find("omega");
    for (int32_t d = 0; d < hrt_device_type_count; d++) {
        const hrt_device_type *device = hrt_device_types[d];
        if (!is_desk_device(device) || (quick && d != inverse3 && d != omega))
            continue; /* the short form: a light and a heavy one */
        const hrt_device_config config = hrt_device_config_of(device, 0);
        progress("desk devices", (double)d / hrt_device_type_count);
        for (int rate = 500; rate <= (quick ? 500 : 4000); rate *= 2) {
            const int tick_us = 1000000 / rate;
            add_largest(rows, &(loop_case){HRT_HOLD, rate, 0, false, -1, tick_us, 0, device, 0}, quick,
                        config.viscous[2] + config.hand_damping[2]);
            cJSON_AddStringToObject(cJSON_GetArrayItem(rows, cJSON_GetArraySize(rows) - 1), "device", device->name);
        }
    }
}

/* Adds the error at the hand of each desk device by rate and delay: the hand presses by a millimetre more on a surface
 * that every twin renders stably. */
static void add_device_errors(cJSON *rows, bool quick) {
    static const double compliance_m_N = 1.0 / 500;
    for (int32_t d = 0; d < hrt_device_type_count; d++) {
        const hrt_device_type *device = hrt_device_types[d];
        if (!is_desk_device(device) || (quick && d != hrt_device_type_find("omega"))) continue;
        progress("desk devices' errors", (double)d / hrt_device_type_count);
        for (int rate = 500; rate <= 4000; rate *= quick ? 8 : 2)
            for (int late_us = 0; late_us <= 2000; late_us += 2000) {
                const loop_case c = {.which = HRT_HOLD,
                                     .rate_Hz = rate,
                                     .model = -1,
                                     .tick_us = 1000000 / rate,
                                     .device = device,
                                     .device_late_us = late_us};
                const loop_result r = run_loop(&c, compliance_m_N, false);
                app_json_add(rows, "device %s rate_Hz %d late_ms %g error_mN %g error_max_mN %g settled %hhd",
                             device->name, rate, 1e-3 * late_us, 1e3 * r.error_N, 1e3 * r.error_max_N, r.settled);
            }
    }
}

int study_loop(const study_run *run, cJSON *out) {
    static const double whole[] = {10, 20, 30, 50, 100, 250, 500}, quick[] = {30};
    const double *rates = run->quick ? quick : whole;
    const int count = run->quick ? 1 : (int)(sizeof whole / sizeof *whole), delays = run->quick ? 1 : 2;
    const hrt_device_config device = hrt_device_config_default(0);
    const double b = device.viscous[HRT_INSERTION] + device.hand_damping[HRT_INSERTION];
    cJSON *rows = cJSON_AddArrayToObject(out, "rows");
    for (int k = 0; k < count; k++)
        for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
            progress("closed loop", (double)(k * HRT_EXTRAPOLATOR_COUNT + x) / (count * HRT_EXTRAPOLATOR_COUNT));
            /* even cells without passivity control, and the short form has these alone */
            for (int cell = 0; is_asked(rates[k], x) && cell < 2 * delays; cell += run->quick ? 2 : 1)
                add_largest(
                    rows, &(loop_case){(hrt_extrapolator)x, rates[k], cell / 2, cell % 2 != 0, -1, TICK_US, 0, NULL, 0},
                    run->quick, b);
        }
    add_z_width(cJSON_AddArrayToObject(out, "z_width"), run->quick, b);
    app_json_add(out, "damping_N_s_m %g hand_stiffness_N_m %g mass_kg %g", b, device.hand_stiffness[HRT_INSERTION],
                 device.inertia[HRT_INSERTION]);
    return 0;
}

int study_devices(const study_run *run, cJSON *out) {
    add_devices(cJSON_AddArrayToObject(out, "z_width"), run->quick);
    add_device_errors(cJSON_AddArrayToObject(out, "errors"), run->quick);
    return 0;
}

int study_tissue_loop(const study_run *run, cJSON *rows) {
    static const hrt_extrapolator which[] = {HRT_HOLD, HRT_LOCAL_MODEL, HRT_POSITION, HRT_TANGENT};
    static const model tissue[] = {MODEL_ISOTROPIC, MODEL_CUT};
    for (int i = 0; i < 2; i++)
        for (int x = 0; x < (run->quick ? 2 : 4) && run->model[tissue[i]]; x++) {
            const loop_case c = {which[x], 30, 0, false, tissue[i], TICK_US, 0, NULL, 0};
            bool beyond;
            progress("closed loop on tissue", (4.0 * i + x) / 8);
            const loop_result r = largest(&c, run->quick, &beyond);
            app_json_add(rows, "model %s extrapolator %s rate_Hz %g stiffness_N_m %g beyond %hhd",
                         model_name[tissue[i]], hrt_extrapolator_name(c.which), c.rate_Hz, r.stiffness_N_m, beyond);
        }
    return 0;
}
