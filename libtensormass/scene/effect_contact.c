/* Effect `contact`: contact of the instruments with the tissue. */
#include "sim.h"

typedef struct options {
    app_section here;
    app_number compliance, force_cap;
    app_integer sweeps, rows;
} options;

static const app_field fields[] = {
    {"contact", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "instruments push the tissue's surface"},
    {"contact.compliance", APP_NUMBER, "compliance", "0.5 mm/N", 0, 1, offsetof(options, compliance), 0,
     "compliance of each contact row, as of a soft layer on the tip"},
    {"contact.force_cap", APP_NUMBER, "force", "50 N", 0.001, 1e6, offsetof(options, force_cap), 0,
     "largest force of each row; reaching it sets a flag"},
    {"contact.sweeps", APP_INTEGER, NULL, "10", 1, 1000, offsetof(options, sweeps), 0,
     "Gauss-Seidel sweeps in each substep"},
    {"contact.rows", APP_INTEGER, NULL, "256", 8, 100000, offsetof(options, rows), 0,
     "largest number of contact rows; if there are more, the deepest are kept and a flag is set"},
};

/* The array of instruments is filled later; the scene owns it for good. */
static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    tm_contact_def *def = &s->def.contact;
    *def = tm_contact_def_default();
    def->instrument_count = s->scene->instrument.count;
    def->instrument = s->instrument_def;
    def->contact_compliance_m_N = o->compliance.si;
    def->force_cap_N = o->force_cap.si;
    def->sweeps = (int32_t)o->sweeps.value;
    def->max_rows = (int32_t)o->rows.value;
    s->def.model.contact = def;
    return 0;
}

const sim_effect sim_effect_contact = {
    .name = "contact",
    .doc =
        "Unilateral, frictionless contact between every instrument (a capsule) and the tissue's surface (triangles).",
    .example = "{compliance: 0.5 mm/N}",
    .trial = SIM_TRIAL_KEEP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .needs = {"instruments"},
    .prepare = prepare,
};
