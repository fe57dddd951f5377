/* Motion of a tool: its position on the path, its capsule, and its force as seen at the tip. */
#include "base/vec.h"
#include "contact/contact_internal.h"
#include "libtensormass/numeric/elementary.h"

/* Computes direction and distance from trocar to tip; straight down if the tip is on the trocar. */
static double direction(const double trocar_m[3], const double tip_m[3], double e[3]) {
    double d[3];
    vsub(tip_m, trocar_m, d);
    double length = vunit(d, e);
    if (length <= 0) e[0] = 0, e[1] = 0, e[2] = -1;
    return length;
}

/* Computes the direction of the shaft, straight down if it is undefined. Returns the distance from trocar to tip,
 * infinite for a free tool. */
static double shaft(const tm_instrument_def *def, const tm_tool_pose *pose, double e[3]) {
    if (!def->is_free) return direction(def->trocar_m, pose->tip_m, e);
    const double size = vunit(pose->direction, e);
    if (!(size > 0 && size < INFINITY)) e[0] = 0, e[1] = 0, e[2] = -1;
    return INFINITY;
}

void tm_tool_direction(const tm_instrument_def *def, const tm_tool_pose *pose, double e[3]) {
    TM_REQUIRE(def && pose && e, "def, pose or direction is null", );
    shaft(def, pose, e);
}

tm_capsule tm_tool_capsule(const tm_instrument_def *def, const tm_tool_pose *pose, int32_t instrument) {
    TM_REQUIRE(def && pose, "def or pose is null", (tm_capsule){0});
    tm_capsule capsule = {.radius_m = def->radius_m, .instrument = instrument};
    double e[3], length = shaft(def, pose, e);
    vset(pose->tip_m, capsule.tip_m);
    vmadd(pose->tip_m, -law_min(def->contact_length_m, length), e, capsule.tail_m);
    return capsule;
}

/* Interpolates the direction at constant rate in the plane of both ends, and linearly the insertion in the trocar or
 * the tip of a free tool. */
static void along_path(const tm_instrument_def *def, const tm_tool_pose *from, const tm_tool_pose *to, double fraction,
                       tm_tool_pose *pose) {
    double a[3], b[3], across[3], e[3];
    double length_a = shaft(def, from, a), length_b = shaft(def, to, b);
    vcross(a, b, across);
    double sine = vnorm(across), angle = tm_arctangent2(sine, vdot(a, b));
    if (sine < 1e-9) {
        for (int c = 0; c < 3; c++) e[c] = a[c] + fraction * (b[c] - a[c]);
    } else {
        vscale(tm_sine((1 - fraction) * angle) / sine, a, e);
        vmadd(e, tm_sine(fraction * angle) / sine, b, e);
    }
    vunit(e, e);
    if (def->is_free) {
        for (int c = 0; c < 3; c++) pose->tip_m[c] = from->tip_m[c] + fraction * (to->tip_m[c] - from->tip_m[c]);
        vset(e, pose->direction);
    } else
        vmadd(def->trocar_m, length_a + fraction * (length_b - length_a), e, pose->tip_m);
    pose->roll_rad = from->roll_rad + fraction * (to->roll_rad - from->roll_rad);
    pose->grip = from->grip + fraction * (to->grip - from->grip);
    pose->active = to->active;
}

/* Sets the allowance of a tool that was teleported into tissue. It has supplied no energy, so its rows may generate
 * this much to push it out. */
#define PLACED_J 1e-6

void tm_tool_set_pose(tm_tool *tool, const tm_tool_pose *at) {
    tool->pose = tool->from = tool->to = *at;
    tool->path_step = tool->path_steps = 0;
    tool->capsule = tool->previous = tool->earlier = tm_tool_capsule(&tool->def, at, tool->capsule.instrument);
    tool->outside = tool->placed_inside = false;
    tool->placed_J = PLACED_J;
    tool->placings++;
    tool->gathered_age = -1;
}

void tm_tool_move(tm_tool *tool, const tm_tool_pose *to, int32_t substeps) {
    tool->from = tool->pose;
    tool->to = *to;
    tool->path_step = 0;
    tool->path_steps = substeps;
    if (substeps <= 0)
        tool->path_steps = 1; /* a path without length is a single piece: it may be long, but is no teleport */
}

bool tm_tool_is_present(const tm_tool *tool) { return tool->pose.active || tool->def.mode == TM_TOOL_CAUTERY; }

void tm_tool_advance(tm_tool *tool, int32_t part, int32_t parts) {
    bool was_active = tool->pose.active;
    tool->previous = tool->capsule;
    if (tool->path_step < tool->path_steps) {
        const double step = tool->path_step + (part + 1.0) / parts;
        if (part + 1 == parts) tool->path_step++;
        if (tool->path_step == tool->path_steps)
            tool->pose = tool->to;
        else
            along_path(&tool->def, &tool->from, &tool->to, step / tool->path_steps, &tool->pose);
        tool->capsule = tm_tool_capsule(&tool->def, &tool->pose, tool->capsule.instrument);
    }
    if (tool->pose.active && !was_active && tool->def.mode != TM_TOOL_CAUTERY)
        tool->outside = tool->placed_inside = false; /* it has just entered the body */
}

/* Returns 1 if the ray from `at` along unit e crosses a triangle within [0, length). */
static int crosses(const double at[3], const double e[3], double length, const double p[3][3]) {
    double a[3], b[3], d[3], h[3], q[3];
    vsub(p[1], p[0], a);
    vsub(p[2], p[0], b);
    vsub(at, p[0], d);
    vcross(e, b, h);
    double det = vdot(a, h);
    if (det == 0) return 0;
    double s = vdot(d, h) / det;
    vcross(d, a, q);
    double t = vdot(e, q) / det, along = vdot(b, q) / det;
    return s >= 0 && t >= 0 && s + t <= 1 && along >= 0 && along < length;
}

bool tm_tool_is_outside(const tm_tool *tool, const double *rest_m, const double *u_m, const tm_surface_view *surface) {
    double e[3], at[3];
    const double *tip = tool->capsule.tip_m;
    if (tool->def.is_free) {
        shaft(&tool->def, &tool->pose, e);
        vscale(-1, e, e);
    } else
        direction(tip, tool->def.trocar_m, e);
    double length = direction(tip, tool->capsule.tail_m, at);
    int32_t crossings = 0;
    for (int32_t i = 0; i < surface->count; i++) {
        double p[3][3];
        for (int j = 0; j < 3; j++)
            for (int c = 0; c < 3; c++) {
                int32_t dof = 3 * surface->triangle[3 * i + j] + c;
                p[j][c] = rest_m[dof] + u_m[dof];
            }
        if (crosses(tip, e, length, p)) return false;
        crossings += crosses(tip, e, INFINITY, p);
    }
    return crossings % 2 == 0;
}

tm_lever tm_lever_at(const double trocar_m[3], const double tip_m[3]) {
    tm_lever lever;
    vset(trocar_m, lever.trocar_m);
    /* a tip on the trocar has no lever: bounded */
    lever.length_m = law_max(direction(trocar_m, tip_m, lever.direction), 1e-3);
    return lever;
}

tm_lever tm_tool_lever(const tm_instrument_def *def, const tm_tool_pose *pose) {
    return def->is_free ? (tm_lever){.length_m = INFINITY} : tm_lever_at(def->trocar_m, pose->tip_m);
}

void tm_lever_force(const tm_lever *lever, const double point_m[3], const double force_N[3], double tip_force_N[3]) {
    const double *e = lever->direction;
    double arm[3], torque[3], across[3];
    if (lever->length_m == INFINITY) {
        vset(force_N, tip_force_N);
        return;
    }
    vsub(point_m, lever->trocar_m, arm);
    vcross(arm, force_N, torque);
    vcross(e, torque, across);
    /* the insertion joint has the force along the axis, the pivots its torque about the trocar */
    vscale(vdot(force_N, e), e, tip_force_N);
    vmadd(tip_force_N, -1 / lever->length_m, across, tip_force_N);
}

void tm_tip_force(const double trocar_m[3], const double tip_m[3], const double point_m[3], const double force_N[3],
                  double tip_force_N[3]) {
    TM_REQUIRE(trocar_m && tip_m && point_m && force_N && tip_force_N, "an argument is null", );
    const tm_lever lever = tm_lever_at(trocar_m, tip_m);
    tm_lever_force(&lever, point_m, force_N, tip_force_N);
}

void tm_tool_tip_force(const tm_instrument_def *def, const tm_tool_pose *pose, const double point_m[3],
                       const double force_N[3], double tip_force_N[3]) {
    TM_REQUIRE(def && pose && point_m && force_N && tip_force_N, "an argument is null", );
    const tm_lever lever = tm_tool_lever(def, pose);
    tm_lever_force(&lever, point_m, force_N, tip_force_N);
}

double tm_capsule_travel(const tm_capsule *a, const tm_capsule *b) {
    double tip[3], tail[3];
    vsub(a->tip_m, b->tip_m, tip);
    vsub(a->tail_m, b->tail_m, tail);
    return law_max(vnorm(tip), vnorm(tail));
}
