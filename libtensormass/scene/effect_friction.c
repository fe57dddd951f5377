/* Effect `friction`: friction coefficients of the instruments. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number at_rest, sliding;
} options;

static const app_field fields[] = {
    {"friction", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "friction between instruments and tissue"},
    {"friction.static", APP_NUMBER, "none", "0.3", 0, TM_FRICTION_MAX, offsetof(options, at_rest), 0,
     "coefficient until an instrument slips, for instruments without their own"},
    {"friction.kinetic", APP_NUMBER, "none", "0.2", 0, TM_FRICTION_MAX, offsetof(options, sliding), 0,
     "coefficient while an instrument slides, at most `static`"},
};

static tm_friction_coefficient of_instrument(const app_instrument *t, const options *o) {
    return (tm_friction_coefficient){.mu_static = t->friction_static.line ? t->friction_static.si : o->at_rest.si,
                                     .mu_kinetic = t->friction_kinetic.line ? t->friction_kinetic.si : o->sliding.si};
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    for (int i = 0; i < scene->instrument.count; i++) {
        const app_instrument *t = (const app_instrument *)scene->instrument.item + i;
        const tm_friction_coefficient c = of_instrument(t, o);
        if (c.mu_kinetic <= c.mu_static) continue;
        const int line = t->friction_kinetic.line  ? t->friction_kinetic.line
                         : t->friction_static.line ? t->friction_static.line
                         : o->sliding.line         ? o->sliding.line
                                                   : o->at_rest.line;
        return app_scene_bad(
            scene, line,
            "instrument %d: the kinetic coefficient %g is above the static one, %g; give kinetic <= static", i,
            c.mu_kinetic, c.mu_static);
    }
    return 0;
}

static tm_status prepare(sim *s, const void *own) {
    s->def.friction = tm_friction_def_default();
    for (int i = 0; i < s->scene->instrument.count; i++)
        s->def.friction.instrument[i] = of_instrument((const app_instrument *)s->scene->instrument.item + i, own);
    s->def.model.friction = &s->def.friction;
    return 0;
}

const sim_effect sim_effect_friction = {
    .name = "friction",
    .doc = "Coulomb friction of the instruments on the tissue, solved with contact: they stick within the cone "
           "of the static coefficient and slide at the kinetic one, and the hand feels both (docs/friction.md).",
    .example = "{static: 0.3, kinetic: 0.2}",
    .trial = SIM_TRIAL_DROP_OR_ADD,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .needs = {"contact"},
    .excludes = {{"hybrid",
                  "its contact solver has no friction; write 'model: dynamic' or 'model: precomputed', or remove "
                  "'friction:'"}},
    .check = check,
    .prepare = prepare,
};
