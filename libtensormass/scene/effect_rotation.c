/* Effect `rotation`: corotational elasticity. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number threshold;
} options;

static const app_field fields[] = {
    {"rotation", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "tissue that turns and bends far, by the corotational law"},
    {"rotation.threshold", APP_NUMBER, "none", "0.02", TM_ROTATION_THRESHOLD_MIN, TM_ROTATION_THRESHOLD_MAX,
     offsetof(options, threshold), 0,
     "size of a tetrahedron's displacement gradient (strain and turn together) from which on it is corrected; wholly "
     "at three times that"},
};

static tm_status check(const app_scene *scene, const void *own) {
    (void)own;
    if (scene->precision.index != TM_SINGLE) return 0;
    return app_scene_bad(scene, scene->precision.line,
                         "rotation takes back what the linear tensors give, which rounded ones do not give to the last "
                         "digit; write 'precision: double', or leave rotation out");
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
    .doc = "Large turns and bends: tetrahedra beyond the threshold follow the law in axes that turn with them, fibres "
           "too; the others stay linear and cost nothing more (docs/corotation.md). The step is some 6 % shorter.",
    .example = "{threshold: 0.02}",
    .trial = SIM_TRIAL_DROP_OR_ADD,
    .of_linear_law = "the law turns by itself",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "its responses are of tissue that does not turn; write 'model: dynamic'"},
                 {"hybrid", "its condensed part does not turn; write 'model: dynamic'"}},
    .check = check,
    .prepare = prepare,
    .build = build,
};
