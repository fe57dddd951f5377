/* Tissue that does not lock: averaged changes of volume and shears. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number shear;
} options;

static const app_field fields[] = {
    {"volume", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "tetrahedra that do not lock, however near incompressible the tissue is"},
    {"volume.shear", APP_NUMBER, "none", "0.4", 0, 1, offsetof(options, shear), 0,
     "share of the shear that is averaged over edges: 0.4 is exactest where tissue is pressed on fine meshes, 0.75 on "
     "coarse ones, 1 where it bends; with rotation 0, and nothing else"},
};

static int check(const app_scene *scene, const void *own) {
    const options *o = own;
    char where[600];
    if (sim_options(scene, "rotation") && o->shear.line && o->shear.si != 0) {
        app_scene_where(scene, sim_effect_line(scene, sim_effect_find(scene, "rotation")), where, sizeof where);
        return app_scene_bad(scene, o->shear.line,
                             "volume.shear = %g and rotation (%s) exclude each other: the average of shears that have "
                             "turned is not known; write 'shear: 0' or leave it out, or remove 'rotation:'",
                             o->shear.si, where);
    }
    if (scene->precision.index != TM_SINGLE) return 0;
    app_scene_where(scene, scene->precision.line, where, sizeof where);
    return app_scene_bad(scene, o->here.line,
                         "volume and tissue.precision = single (%s) exclude each other: rounded tensors of averages "
                         "would set tissue turning; take double, or remove 'volume:'",
                         where);
}

static int prepare(sim *s, const void *own) {
    const options *o = own;
    s->def.model.tissue.volume = true;
    s->def.model.tissue.volume_shear = sim_options(s->scene, "rotation") ? 0 : o->shear.si;
    return 0;
}

const sim_effect sim_effect_volume = {
    .name = "volume",
    .doc = "Changes of volume are averaged around vertices and a share of the shear around edges, so that tetrahedra "
           "do not lock towards Poisson's ratio 0.5 and are exacter at any. Four times the tensors, steps a third "
           "longer (not of tissue that may be cut).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .part = SIM_PART_VOLUME,
    .excludes = {{"hybrid", "nothing can be averaged over the border of its condensed part; write 'model: dynamic' or "
                            "'model: precomputed', or remove 'volume:'"}},
    .check = check,
    .prepare = prepare,
};
