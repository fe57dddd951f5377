#include "sim.h"

typedef struct options {
    app_section here;
    app_number skin, force_cap;
    app_integer sweeps, rows;
} options;

static const app_field fields[] = {
    {"contact", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "instruments push the tissue's surface"},
    {"contact.skin", APP_NUMBER, "compliance", "0.5 mm/N", 0, 1, offsetof(options, skin), 0,
     "compliance of each contact row: a soft skin on the tip"},
    {"contact.force_cap", APP_NUMBER, "force", "50 N", 0.001, 1e6, offsetof(options, force_cap), 0,
     "of each row; reaching it is flagged"},
    {"contact.sweeps", APP_INTEGER, NULL, "10", 1, 1000, offsetof(options, sweeps), 0,
     "of the projection, each substep"},
    {"contact.rows", APP_INTEGER, NULL, "256", 8, 100000, offsetof(options, rows), 0,
     "at most; the deepest are kept and the loss is flagged"},
};

const tm_contact_def *sim_contact_definition(sim *s) {
    const options *o = sim_options(s->scene, "contact");
    s->contact_def = tm_contact_def_default();
    s->contact_def.instrument_count = s->instrument_count;
    s->contact_def.instrument = s->instrument_def;
    s->contact_def.skin_compliance_m_N = o->skin.si;
    s->contact_def.force_cap_N = o->force_cap.si;
    s->contact_def.sweeps = (int32_t)o->sweeps.value;
    s->contact_def.max_rows = (int32_t)o->rows.value;
    return &s->contact_def;
}

static int build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    const tm_contact_def *def = sim_contact_definition(s);
    if (!s->world) return 0;
    return tm_stage_contact(s->world, def, &s->contact, &error) ? sim_report(s->scene, o->here.line, &error) : 0;
}

const sim_effect sim_effect_contact = {
    .name = "contact",
    .doc =
        "Unilateral, frictionless contact between every instrument (a capsule) and the tissue's surface (triangles).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .needs = {"instruments"},
    .build = build,
};
