/* Effect `rotation`: corotational elasticity. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number threshold;
} options;

static const app_field fields[] = {
    {"rotation", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "large rotations and bending, by the corotational law"},
    {"rotation.threshold", APP_NUMBER, "none", "0.02", TM_ROTATION_THRESHOLD_MIN, TM_ROTATION_THRESHOLD_MAX,
     offsetof(options, threshold), 0,
     "norm of a tetrahedron's displacement gradient (strain and rotation) at which the correction begins; "
     "it is complete at three times that"},
};

static tm_status check(const app_scene *scene, const void *own) {
    (void)own;
    if (scene->precision.index != TM_SINGLE || !sim_options(scene, "viscosity")) return 0;
    return app_scene_bad(scene, scene->precision.line,
                         "tissue.precision = single and rotation with 'viscosity:' exclude each other: what relaxes is "
                         "kept in double; write 'precision: double', or leave viscosity out");
}

static tm_status prepare(sim *s, const void *own) {
    s->def.model.tissue.rotation = ((const options *)own)->threshold.si;
    return 0;
}

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    return tm_stage_rotation(s->model->world, NULL, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const sim_effect sim_effect_rotation = {
    .name = "rotation",
    .doc = "Large rotations and bending: tetrahedra beyond the threshold are computed in axes that rotate with "
           "them, fibres included; the others stay linear at no additional cost (docs/corotation.md). The "
           "step is 16 % shorter at nu 0.45.",
    .example = "{threshold: 0.02}",
    .trial = SIM_TRIAL_DROP_OR_ADD,
    .region = TM_REGION_ROTATION,
    .of_linear_law = "a nonlinear law includes rotation",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "its responses are of linear tissue; write 'model: dynamic'"},
                 {"hybrid", "its condensed part is linear; write 'model: dynamic'"}},
    .check = check,
    .prepare = prepare,
    .build = build,
};
