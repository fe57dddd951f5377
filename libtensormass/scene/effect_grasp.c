/* Effect `grasp`: graspers hold tissue between their jaws. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number close_grip, open_grip, jaw, reach, compliance, fade, force_cap;
    app_integer max_vertices;
} options;

static const app_field fields[] = {
    {"grasp", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "graspers hold the tissue between their jaws"},
    {"grasp.close", APP_NUMBER, "none", "0.7", 0, 1, offsetof(options, close_grip), 0, "grip at which the jaws close"},
    {"grasp.open", APP_NUMBER, "none", "0.3", 0, 1, offsetof(options, open_grip), 0,
     "grip at which they open, below `close`"},
    {"grasp.jaw", APP_NUMBER, "length", "10 mm", 1e-4, 0.1, offsetof(options, jaw), 0,
     "length of shaft behind the tip that grasps"},
    {"grasp.reach", APP_NUMBER, "length", "1 mm", 0, 0.1, offsetof(options, reach), 0,
     "distance beyond the radius within which vertices are grasped"},
    {"grasp.compliance", APP_NUMBER, "compliance", "0.2 mm/N", 0, 1, offsetof(options, compliance), 0,
     "compliance of the spring on each grasped vertex"},
    {"grasp.release_time", APP_NUMBER, "time", "0.1 s", 0, 10, offsetof(options, fade), 0,
     "time after opening until the force is 0"},
    {"grasp.force_cap", APP_NUMBER, "force", "20 N", 0.001, 1e6, offsetof(options, force_cap), 0,
     "largest force of each spring; beyond it the vertex slips"},
    {"grasp.max_vertices", APP_INTEGER, NULL, "64", 1, 10000, offsetof(options, max_vertices), 0,
     "largest number of vertices in one instrument's jaws; the nearest are kept"},
};

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (o->open_grip.si < o->close_grip.si) return 0;
    return app_scene_bad(scene, o->open_grip.line ? o->open_grip.line : o->close_grip.line,
                         "grasp.open %g is not below grasp.close %g; lower it", o->open_grip.si, o->close_grip.si);
}

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    tm_grasp_def def = tm_grasp_def_default();
    def.close_grip = o->close_grip.si;
    def.open_grip = o->open_grip.si;
    def.jaw_length_m = o->jaw.si;
    def.reach_m = o->reach.si;
    def.compliance_m_N = o->compliance.si;
    def.release_time_s = o->fade.si;
    def.force_cap_N = o->force_cap.si;
    def.max_vertices = (int32_t)o->max_vertices.value;
    s->def.grasp = def;
    s->def.model.grasp = &s->def.grasp;
    return 0;
}

const sim_effect sim_effect_grasp = {
    .name = "grasp",
    .doc = "Closed jaws of an instrument of mode `grasper` hold the tissue between them by springs; opening "
           "releases it within `release_time`.",
    .example = "{compliance: 0.2 mm/N}",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .needs = {"contact"},
    .check = check,
    .prepare = prepare,
};
