/* Tissue that relaxes, by a Prony series. */
#include "sim.h"

typedef struct term {
    app_section here;
    app_number time, shear, bulk;
} term;

typedef struct options {
    app_section here;
    app_list term;
} options;

#define TERM(member) offsetof(term, member)
static const app_field fields[] = {
    {"viscosity", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "stress relaxation; the materials' constants are then the instantaneous moduli"},
    {"viscosity.terms", APP_LIST, NULL, "!", 1, TM_VISCOSITY_TERMS, offsetof(options, term), sizeof(term),
     "terms of a Prony series, one to three"},
    {"viscosity.terms[].time", APP_NUMBER, "time", "!", TM_VISCOSITY_TIME_MIN_S, TM_VISCOSITY_TIME_MAX_S, TERM(time), 0,
     "time in which the term's stress falls to 1/e at constant strain"},
    {"viscosity.terms[].shear", APP_NUMBER, "none", "!", 0, TM_VISCOSITY_SHARES_MAX, TERM(shear), 0,
     "share of the instantaneous shear modulus (and of the fibres' terms) that relaxes"},
    {"viscosity.terms[].bulk", APP_NUMBER, "none", NULL, 0, TM_VISCOSITY_SHARES_MAX, TERM(bulk), 0,
     "share of the instantaneous bulk modulus; left out: equal to `shear`, so that Poisson's ratio is constant, which costs less"},
};

static tm_viscosity_def definition(const options *o) {
    tm_viscosity_def def = tm_viscosity_def_default();
    const term *t = o->term.item;
    for (def.count = 0; def.count < o->term.count && def.count < TM_VISCOSITY_TERMS; def.count++, t++)
        def.term[def.count] = (tm_viscosity_term){t->time.si, t->shear.si, t->bulk.line ? t->bulk.si : t->shear.si};
    return def;
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (o->term.count < 1 || o->term.count > TM_VISCOSITY_TERMS)
        return app_scene_bad(scene, o->term.line ? o->term.line : o->here.line,
                             "viscosity.terms has %d terms; give 1 to %d", o->term.count, TM_VISCOSITY_TERMS);
    if (sim_law_line(scene) && !sim_effect_everywhere(scene, sim_effect_find(scene, "viscosity"))) {
        char where[600];
        app_scene_where(scene, sim_law_line(scene), where, sizeof where);
        return app_scene_bad(scene, o->here.line,
                             "viscosity of some bodies and a nonlinear law (%s) exclude each other: with such a law "
                             "histories are kept for all tetrahedra; write 'viscosity:' at the top level",
                             where);
    }
    const tm_viscosity_def def = definition(o);
    tm_error error = {0};
    return tm_viscosity_check(&def, &error) == TM_OK ? 0 : app_scene_bad(scene, o->term.line, "%s", error.message);
}

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    const tm_viscosity_def def = definition(o);
    tm_error error = {0};
    return tm_stage_viscosity(s->model->world, &def, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const sim_effect sim_effect_viscosity = {
    .name = "viscosity",
    .doc = "Stress relaxation at constant strain and creep at constant load: a Prony series, integrated exactly "
           "along straight strain paths. Under a nonlinear law the step is at most 0.93 of the guaranteed "
           "one, otherwise it does not change; `--settle` gives the equilibrium after infinite time "
           "(docs/viscosity.md).",
    .region = TM_REGION_VISCOSITY,
    .example = "{terms: [{time: 0.1 s, shear: 0.3, bulk: 0}]}",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "its responses are of tissue without viscosity; write 'model: dynamic'"},
                 {"hybrid", "its condensed part has no viscosity; write 'model: dynamic'"}},
    .check = check,
    .build = build,
};
