/* The effect "friction": a tool pressed into the block slides there and back. Measures the cost of a step relative to
 * the same slide without friction, and the resulting change of the force at the hand. Also measures the deviation of a
 * sliding station from Coulomb's law. */
#include <math.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"

enum { ROWS = 6, PRESS = 40, REST = 20, SLIDE = 80, FRAMES = PRESS + REST + 2 * SLIDE, GRIPS = 32 };
static const double FRAME_S = 0.005, RADIUS_M = 0.0025, DEPTH_M = 0.003, FROM_M = 0.010, WAY_M = 0.008;
static const tm_friction_coefficient COEFFICIENT[ROWS] = {{0, 0},     {0.05, 0.05}, {0.1, 0.1},
                                                          {0.3, 0.2}, {0.3, 0.3},   {0.5, 0.5}};

typedef struct friction_scene {
    problem p;
    tm_contact *contact;
    tm_friction *friction; /* null: none */
    double force_N[FRAMES][3], per_step_s[FRAMES];
    double off_law; /* maximum deviation of a slipping station, over its normal force */
    int32_t slipped;
} friction_scene;

static tm_tool_pose at_frame(int frame) {
    const double way = fmax(0, frame - PRESS - REST + 1.0) / SLIDE, in = fmin(1, (frame + 1.0) / PRESS);
    return (tm_tool_pose){.tip_m = {FROM_M + WAY_M * (way > 1 ? 2 - way : way), BLOCK_M / 2,
                                    BLOCK_M + RADIUS_M + 0.0005 - (DEPTH_M + 0.0005) * in},
                          .active = true};
}

static tm_status make_scene(int cells, tm_friction_coefficient coefficient, friction_scene *r, tm_error *error) {
    problem_def def = problem_default(cells);
    memset(r, 0, sizeof *r);
    def.pressed = false, def.material.damping_1_s = 60;
    tm_status status = problem_create(&def, &r->p, error);
    const tm_instrument_def tool = {.radius_m = RADIUS_M,
                                    .contact_length_m = 0.1,
                                    .trocar_m = {FROM_M + WAY_M / 2, BLOCK_M / 2, 0.2},
                                    .pose = at_frame(-1)};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    if (status == TM_OK) status = tm_stage_contact(r->p.world, &contact, &r->contact, error);
    tm_friction_def friction = tm_friction_def_default();
    friction.instrument[0] = coefficient;
    if (status == TM_OK && coefficient.mu_static > 0)
        status = tm_stage_friction(r->p.world, r->contact, &friction, &r->friction, error);
    return status;
}

static void check_stations(friction_scene *r) {
    tm_friction_station grip[GRIPS];
    const int32_t there = r->friction ? tm_friction_stations(r->friction, 0, grip, GRIPS) : 0;
    for (int32_t i = 0; i < there && i < GRIPS; i++) {
        const double *f = grip[i].force_N,
                     share = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) / grip[i].normal_force_N;
        if (!grip[i].slips) continue;
        r->off_law = fmax(r->off_law, fabs(share - grip[i].coefficient));
        r->slipped++;
    }
}

static tm_status frame(friction_scene *r, int at, tm_error *error) {
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(r->p.world));
    const tm_tool_pose to = at_frame(at);
    const double start = app_seconds();
    tm_contact_begin_frame(r->contact, substeps, substeps);
    tm_contact_set_target(r->contact, 0, &to, substeps);
    const tm_status status = tm_world_step(r->p.world, substeps);
    r->per_step_s[at] = (app_seconds() - start) / substeps;
    if (status != TM_OK) return tm_fail(error, status, -1, "friction: the step failed in frame %d", at);
    memcpy(r->force_N[at], tm_contact_reaction(r->contact, 0).force_N, sizeof r->force_N[at]);
    check_stations(r);
    return TM_OK;
}

/* Returns the RMS difference of the components from `first` to `last` during the slide, over the RMS of `r`. */
static double left_out(const friction_scene *r, const friction_scene *without, int first, int last) {
    double off = 0, all = 0;
    for (int f = PRESS + REST; f < FRAMES; f++)
        for (int c = first; c <= last; c++) {
            off += pow(r->force_N[f][c] - without->force_N[f][c], 2);
            all += pow(r->force_N[f][c], 2);
        }
    return sqrt(off / all);
}

static void row_of(cJSON *rows, friction_scene *r, const friction_scene *without, double plain_s) {
    const tm_friction_coefficient *own = COEFFICIENT + (r - without);
    const double seconds = app_median(r->per_step_s + PRESS + REST, 2 * SLIDE),
                 *end = r->force_N[PRESS + REST + SLIDE - 1];
    app_json_add(
        rows,
        "at_rest %g sliding %g along_N %g normal_force_N %g along %g force %g off_law %g slipped %d seconds_per_step %g price %g",
        own->mu_static, own->mu_kinetic, -end[0], end[2], left_out(r, without, 0, 0), left_out(r, without, 0, 2),
        r->off_law, r->slipped, seconds, seconds / plain_s);
}

tm_status knob_friction(const run *r, cJSON *out, cJSON *rows, tm_error *error) {
    static friction_scene world[ROWS]; /* too large for a stack */
    const int cells = r->quick ? 6 : 12;
    tm_status status = TM_OK;
    memset(world, 0, sizeof world);
    for (int i = 0; i < ROWS && status == TM_OK; i++) status = make_scene(cells, COEFFICIENT[i], world + i, error);
    for (int f = 0; f < FRAMES && status == TM_OK; f++) { /* in turns: a slow spell of the machine affects all */
        for (int i = 0; i < ROWS && status == TM_OK; i++) status = frame(world + i, f, error);
        r->progress("friction", (f + 1.0) / FRAMES);
    }
    double plain[2 * SLIDE];
    memcpy(plain, world->per_step_s + PRESS + REST, sizeof plain); /* app_median sorts */
    const double plain_s = app_median(plain, 2 * SLIDE);
    for (int i = 0; i < ROWS && status == TM_OK; i++) row_of(rows, world + i, world, plain_s);
    app_json_add(out, "tets %g speed_m_s %g", 6.0 * cells * cells * cells, WAY_M / SLIDE / FRAME_S);
    for (int i = 0; i < ROWS; i++)
        if (world[i].p.world) problem_destroy(&world[i].p);
    return status;
}
