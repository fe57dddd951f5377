/* Shared by the cases: a clamped block, its energy, and the text of an outcome. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "stability.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

static void say(outcome *o, verdict v, double figure, const char *format, va_list arguments) {
    o->verdict = v, o->figure = figure;
    vsnprintf(o->text, sizeof o->text, format, arguments);
}

#define WORDS(function, verdict, figure)                                                                               \
    va_list arguments;                                                                                                 \
    va_start(arguments, format);                                                                                       \
    say(o, verdict, figure, format, arguments);                                                                        \
    va_end(arguments)

void accurate(outcome *o, double figure, const char *format, ...) {
    WORDS(accurate, isfinite(figure) ? ACCURATE : BROKEN, figure);
}
void stable(outcome *o, double figure, const char *format, ...) {
    WORDS(stable, isfinite(figure) ? STABLE : BROKEN, figure);
}
void broken(outcome *o, const char *format, ...) { WORDS(broken, BROKEN, NAN); }

void refused(outcome *o, const tm_error *error) {
    o->verdict = REFUSED, o->figure = 0;
    snprintf(o->text, sizeof o->text, "%s: %s", tm_status_name(error->status), error->message);
}

void series_add(outcome *o, double x, double y) {
    if (o->count < SERIES_MAX && isfinite(x) && isfinite(y)) o->x[o->count] = x, o->y[o->count++] = y;
}

double random_unit(uint64_t *state) { return 2 * app_uniform(state) - 1; }

app_bench_def bench_default(void) {
    app_bench_def def = app_bench_default(4, 0.04);
    def.step_fraction = 0.95;
    return def;
}

static bool is_open(tm_status status, const tm_error *error, outcome *o) {
    if (status != TM_OK) refused(o, error);
    return status == TM_OK;
}

bool bench_open(const app_bench_def *def, app_bench *b, outcome *o) {
    tm_error error = {0};
    return is_open(app_bench_open(def, b, &error), &error, o);
}

bool bench_start(const app_bench_def *def, app_bench *b, outcome *o) {
    tm_error error = {0};
    return is_open(app_bench_start(def, b, &error), &error, o);
}

rig_def rig_default(int tools, const tm_tool_pose *start) {
    rig_def def = {.bench = bench_default(),
                   .tools = tools,
                   .row_compliance_m_N = tm_contact_def_default().contact_compliance_m_N};
    for (int t = 0; t < tools; t++)
        def.tool[t] = (tm_instrument_def){.radius_m = 0.0025,
                                          .contact_length_m = 0.1,
                                          .trocar_m = {start[t].tip_m[0], start[t].tip_m[1], 0.2},
                                          .pose = start[t]};
    return def;
}

bool rig_open(const rig_def *def, rig *r, const char *force_name, outcome *o) {
    tm_contact_def contact = tm_contact_def_default();
    const tm_grasp_def grasp = tm_grasp_def_default();
    const tm_cut_def cut = tm_cut_def_default();
    tm_error error = {0};
    *r = (rig){.tools = def->tools, .finite = true, .o = o};
    if (!bench_open(&def->bench, &r->b, o)) return false;
    for (int t = 0; t < def->tools; t++) r->at[t] = def->tool[t].pose;
    contact.instrument_count = def->tools, contact.instrument = def->tool,
    contact.contact_compliance_m_N = def->row_compliance_m_N;
    o->x_name = "simulated s", o->y_name = force_name;
    tm_world *world = r->b.world;
    if (tm_stage_contact(world, &contact, &r->contact, &error) == TM_OK &&
        (!def->jaws || tm_stage_grasp(world, r->contact, &grasp, &r->grasp, &error) == TM_OK) &&
        (!def->friction || tm_stage_friction(world, r->contact, def->friction, &r->friction, &error) == TM_OK) &&
        (!def->bench.cuttable || tm_stage_cut(world, r->contact, &cut, &error) == TM_OK) &&
        (!def->energy || tm_stage_energy(world, &error) == TM_OK))
        return true;
    app_bench_close(&r->b);
    refused(o, &error);
    return false;
}

void rig_steps(rig *r, int32_t steps, int32_t window, bool jump) {
    tm_contact_begin_frame(r->contact, steps, window < steps ? window : steps);
    for (int t = 0; t < r->tools; t++) {
        if (jump)
            tm_contact_set_pose(r->contact, t, &r->at[t]);
        else
            tm_contact_set_target(r->contact, t, &r->at[t], steps);
    }
    r->finite = r->finite && tm_world_step(r->b.world, steps) == TM_OK;
    for (int t = 0; t < r->tools; t++) {
        memcpy(r->force_N[t], tm_contact_reaction(r->contact, t).force_N, sizeof r->force_N[t]);
        r->finite = r->finite && isfinite(vnorm(r->force_N[t]));
    }
}

void rig_frame(rig *r, double frame_s, int32_t window) {
    rig_steps(r, (int32_t)ceil(frame_s / tm_world_step_s(r->b.world)), window, false);
}

void rig_lead(rig *r, const tm_tool_pose *from, const tm_tool_pose *to, int k, int frames) {
    for (int t = 0; t < r->tools; t++) {
        r->at[t] = to[t];
        for (int c = 0; c < 3; c++)
            r->at[t].tip_m[c] = from[t].tip_m[c] + (to[t].tip_m[c] - from[t].tip_m[c]) * k / frames;
    }
}

double rig_over_cone(const rig *r, int tool, bool *slips, double *along_N, double *normal_force_N) {
    tm_friction_station grip[64];
    const int32_t there = r->friction ? tm_friction_stations(r->friction, tool, grip, 64) : 0;
    double over = 0;
    for (int32_t i = 0; i < there && i < 64; i++) {
        const double size = vnorm(grip[i].force_N);
        over = fmax(over, size / grip[i].normal_force_N - grip[i].coefficient);
        if (slips) *slips = *slips || grip[i].slips;
        if (along_N) *along_N += size, *normal_force_N += grip[i].normal_force_N;
    }
    return over;
}

void random_velocities(app_bench *b, uint64_t seed, double speed_m_s) {
    tm_state *s = tm_world_state(b->world);
    int32_t n = 3 * b->mesh->vertex_count;
    uint8_t *held = app_zeroed((size_t)n, 1);
    tm_support_mask(b->world, held);
    for (int32_t i = 0; i < n; i++)
        s->u_prev_m[i] = s->u_m[i] - (held[i] ? 0 : speed_m_s * s->dt_s * random_unit(&seed));
    free(held);
}

double scheme_energy(app_bench *b, double *scratch) {
    const tm_state *s = tm_world_state(b->world);
    const double *mass = tm_tissue_mass_kg(b->tissue);
    double kinetic = 0, elastic = 0;
    tm_tissue_force(b->tissue, s->u_m, scratch);
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++) {
        double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        kinetic += 0.5 * mass[i / 3] * v * v;
        elastic -= 0.5 * s->u_prev_m[i] * scratch[i];
    }
    return kinetic + elastic;
}

double energy_drift(app_bench *b, int64_t steps, outcome *o) {
    double *scratch = app_zeroed(3 * (size_t)b->mesh->vertex_count, sizeof *scratch), worst = 0;
    random_velocities(b, 12345, 0.1);
    double start = scheme_energy(b, scratch);
    int64_t piece = steps / 100 > 0 ? steps / 100 : 1;
    o->x_name = "simulated s", o->y_name = "energy / energy at the start";
    for (int64_t done = 0; done < steps; done += piece) {
        if (tm_world_step(b->world, (int32_t)piece) != TM_OK) {
            free(scratch);
            return -1;
        }
        double now = scheme_energy(b, scratch) / start;
        worst = fmax(worst, fabs(now - 1));
        series_add(o, tm_world_state(b->world)->time_s, now);
    }
    free(scratch);
    return worst;
}
