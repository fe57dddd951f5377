/* Cautery: removes the tetrahedra that an active instrument touches, and records the removals of this frame. */
#include "choices.h"
#include "sim.h"

typedef struct options {
    app_section here;
    app_number rate;
    app_choice loose;
    app_number fade;
} options;

#define LOOSE(ROW) ROW("fall", TM_LOOSE_FALL) ROW("remove", TM_LOOSE_REMOVE)
APP_CHOICE_CHECK(LOOSE)

static const app_field fields[] = {
    {"cut", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "active cauteries remove the tetrahedra that they touch"},
    {"cut.rate", APP_NUMBER, "rate", "200 /s", 1e-3, 1e9, offsetof(options, rate), 0,
     "largest number of tetrahedra that one cautery removes in a second"},
    {"cut.loose", APP_CHOICE, APP_CHOICE_WORDS(LOOSE), "fall", 0, 0, offsetof(options, loose), 0,
     "detached fragments fall out of sight, or are removed"},
    {"cut.fade", APP_NUMBER, "time", "0 s", 0, 10, offsetof(options, fade), 0,
     "time in which the force from a removed tetrahedron falls to 0; 50 ms halves the jumps of a cut"},
};

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    const int hybrid = sim_effect_find(scene, "hybrid"), line = hybrid < 0 ? 0 : sim_effect_line(scene, hybrid);
    char where[600];
    if (!line || !(o->fade.si > 0)) return 0;
    app_scene_where(scene, line, where, sizeof where);
    return app_scene_bad(
        scene, o->fade.line,
        "cut.fade and the hybrid model (%s) exclude each other: its contact forces cannot fade; leave out "
        "cut.fade, or write 'model: dynamic'",
        where);
}

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    s->def.model.tissue.cuttable = true;
    s->def.cut = tm_cut_def_default();
    s->def.cut.rate_1_s = o->rate.si;
    s->def.cut.loose = (tm_cut_loose)o->loose.index;
    s->def.cut.fade_s = o->fade.si;
    s->def.cut.keep = s->rigid_tet;
    s->def.model.cut = &s->def.cut;
    return 0;
}

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    size_t n = (size_t)s->mesh->tet_count;
    s->cuts.tet = tm_allocate(n * sizeof *s->cuts.tet);
    s->cuts.instrument = tm_allocate(n);
    s->cuts.capacity = (int32_t)n;
    return s->cuts.tet && s->cuts.instrument
               ? 0
               : app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
}

static void destroy(sim *s) {
    tm_release(s->cuts.tet, (size_t)s->cuts.capacity * sizeof *s->cuts.tet);
    tm_release(s->cuts.instrument, (size_t)s->cuts.capacity);
}

static void frame(sim *s) {
    s->cuts.count = tm_cut_fetch_removed(s->model->world, s->cuts.tet, s->cuts.instrument, s->mesh->tet_count);
    s->cuts.total += s->cuts.count;
}

const sim_effect sim_effect_cut = {
    .name = "cut",
    .doc = "Cauteries (instruments of mode `cautery`) remove tetrahedra while their pedal is down. The mesh "
           "stays conformal and manifold, and the tissue equals a fresh build of the remaining mesh, bit for "
           "bit. The step must be stable for each tetrahedron by itself: with slivers it is 0.018 to 0.15 of "
           "the uncut tissue's step. `tm-mesh info` names the worst tetrahedron; mesh the organ again, or set "
           "`time.mass_scaling`.",
    .example = "{rate: 100 /s}",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .part = SIM_PART_CUTTING,
    .needs = {"contact"},
    .check = check,
    .prepare = prepare,
    .build = build,
    .frame = frame,
    .destroy = destroy,
};
