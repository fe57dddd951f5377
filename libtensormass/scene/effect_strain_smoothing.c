/* Averages changes of volume and shears, against locking. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number shear;
} options;

static const app_field fields[] = {
    {"strain_smoothing", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "less locking of nearly incompressible tetrahedra, by averaged strains (S-FEM)"},
    {"strain_smoothing.shear_share", APP_NUMBER, "none", "0.4", 0, 1, offsetof(options, shear), 0,
     "share of the shear that is averaged over edges. Error when pressed, nu 0.45, 10,368 tetrahedra: 0.4 "
     "6.2 %, 0.75 7.9 %, 1 9.4 %; 1,296: 17.8, 14.0, 15.6 %. A beam of 4 cells across, nu 0.49, bends too "
     "little: 0.4 by 14 %, 0.75 by 10 %, 1 by 6 %. Steps differ by less than 5 %. With rotation or a nonlinear law "
     "only 0 is allowed: 42 % too little on 2 cells, 16 % on 4"},
};

/* Returns an effect that some bodies have and others not; null: there is none. */
static const char *of_some_bodies(const app_scene *scene) {
    static const char *const name[] = {"strain_smoothing", "rotation", "viscosity"};
    for (int i = 0; i < 3; i++) {
        const int effect = sim_effect_find(scene, name[i]);
        if (sim_effect_line(scene, effect) && !sim_effect_everywhere(scene, effect)) return name[i];
    }
    return NULL;
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    char where[600];
    if (sim_effects_meet(scene, "rotation", "strain_smoothing") && o->shear.line && o->shear.si != 0) {
        app_scene_where(scene, sim_effect_line(scene, sim_effect_find(scene, "rotation")), where, sizeof where);
        return app_scene_bad(
            scene, o->shear.line,
            "strain_smoothing.shear_share = %g and rotation (%s) exclude each other: shears of rotated "
            "tetrahedra are not averaged; write 'shear_share: 0' or leave it out, or remove 'rotation:'",
            o->shear.si, where);
    }
    const int index = sim_effect_find(scene, "strain_smoothing");
    const char *partial = of_some_bodies(scene);
    if (partial && sim_effects_meet(scene, "rotation", "strain_smoothing"))
        return app_scene_bad(scene, o->here.line,
                             "strain_smoothing and rotation act in one body, and %s in some bodies only: the averages "
                             "of rotated tetrahedra are computed for all bodies; name %s at the top level, or leave "
                             "one of the two out",
                             partial, partial);
    if (sim_law_line(scene) && !sim_effect_everywhere(scene, index)) {
        app_scene_where(scene, sim_law_line(scene), where, sizeof where);
        return app_scene_bad(scene, o->here.line,
                             "strain_smoothing of some bodies and a nonlinear law (%s) exclude each other: with such a "
                             "law the averages are computed for all bodies; write 'strain_smoothing:' at the top level",
                             where);
    }
    if (sim_law_line(scene) && o->shear.line && o->shear.si != 0) {
        app_scene_where(scene, sim_law_line(scene), where, sizeof where);
        return app_scene_bad(
            scene, o->shear.line,
            "strain_smoothing.shear_share = %g and a nonlinear law (%s) exclude each other: the average of shears that "
            "have turned is not known; write 'shear_share: 0' or leave it out",
            o->shear.si, where);
    }
    if (scene->precision.index != TM_SINGLE) return 0;
    app_scene_where(scene, scene->precision.line, where, sizeof where);
    return app_scene_bad(
        scene, o->here.line,
        "strain_smoothing and tissue.precision = single (%s) exclude each other: rounded tensors of averages "
        "would make the tissue rotate; write 'precision: double', or remove 'strain_smoothing:'",
        where);
}

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    s->def.model.tissue.strain_smoothing = true;
    s->def.model.tissue.smoothed_shear_share =
        sim_effects_meet(s->scene, "rotation", "strain_smoothing") || sim_law_line(s->scene) ? 0 : o->shear.si;
    return 0;
}

const sim_effect sim_effect_strain_smoothing = {
    .name = "strain_smoothing",
    .doc = "Changes of volume are averaged around vertices and a share of the shear around edges. Tetrahedra "
           "then lock far less near Poisson's ratio 0.5 and are more accurate at any. A cantilever of 4 cells "
           "across bends by 0.92 of the exact value at nu 0.3, 0.86 at 0.49 and 0.81 at 0.4999 (linear "
           "tetrahedra: 0.78, 0.29, 0.03); finer meshes and a larger `shear_share` come closer "
           "(docs/strain-smoothing.md, 'How much locking is left'). It stores four times the tensors; steps are "
           "a third longer (not of cuttable tissue).",
    .example = "{shear_share: 0.2}",
    .trial = SIM_TRIAL_KEEP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .part = SIM_PART_SMOOTHING,
    .region = TM_REGION_SMOOTHING,
    .excludes = {{"hybrid",
                  "strains cannot be averaged across the interface of its condensed part; write 'model: dynamic' or "
                  "'model: precomputed', or remove 'strain_smoothing:'"}},
    .check = check,
    .prepare = prepare,
};
