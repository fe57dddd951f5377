/* The facts of all nonlinear laws, and the checks that are common to them. */
#include "material/law_facts.h"

#include <math.h>
#include <string.h>

#include "material/hyperelastic.h"

#define TM_LAW_FACTS
#include "material/green_strain.h"

#include "material/law_files.h"

#define FACTS(NAME, name) [TM_LAW_##NAME] = &tm_##name##_facts,
static const tm_law_facts linear = {.name = "linear", .has_fibres = true};
const tm_law_facts *const tm_law_facts_of[TM_LAW_COUNT] = {[TM_LAW_LINEAR] = &linear, TM_NONLINEAR_LAWS(FACTS)};

static const tm_law_facts *facts_of(int64_t law) {
    return law >= 0 && law < TM_LAW_COUNT ? tm_law_facts_of[law] : NULL;
}

const char *tm_law_name(tm_law_kind law) { return facts_of(law) ? facts_of(law)->name : NULL; }

const tm_law_constant *tm_law_constant_at(tm_law_kind law, int32_t index) {
    if (!facts_of(law) || index < 0 || index >= TM_LAW_CONSTANTS) return NULL;
    const tm_law_constant *constant = &facts_of(law)->constant[index];
    return constant->name ? constant : NULL;
}

bool tm_law_has_fibres(tm_law_kind law) { return facts_of(law) && facts_of(law)->has_fibres; }
bool tm_law_needs_fibre(tm_law_kind law) { return facts_of(law) && facts_of(law)->needs_fibre; }

tm_status tm_law_bad(const tm_material *m, const char *what, double value, const char *violated, tm_error *error) {
    const char *remedy = strncmp(what, "lambda", 6) ? "" : "; give a larger Poisson's ratio, or lambda";
    return tm_fail(error, TM_ERR_MATERIAL, -1, "law %s with %s = %g: %s is violated%s", facts_of(m->law)->name, what,
                   value, violated, remedy);
}

static tm_status check_constants(const tm_material *m, tm_error *error) {
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) {
        const tm_law_constant *c = tm_law_constant_at((tm_law_kind)m->law, i);
        const double value = m->law_constant[i];
        if (!isfinite(value))
            return tm_fail(error, TM_ERR_MATERIAL, -1, "law %s: constant %d = %g is not finite; give a number",
                           facts_of(m->law)->name, i, value);
        if (c && !(value >= c->min && value <= c->max))
            return tm_fail(error, TM_ERR_MATERIAL, -1, "law %s with %s = %g: %g <= %s <= %g is violated",
                           facts_of(m->law)->name, c->name, value, c->min, c->name, c->max);
    }
    return TM_OK;
}

tm_status tm_law_check(const tm_material *m, tm_error *error) {
    if (m->law == TM_LAW_LINEAR) return TM_OK;
    const tm_law_facts *law = facts_of(m->law);
    if (!law)
        return tm_fail(error, TM_ERR_MATERIAL, -1, "law %lld does not exist; give a value of tm_law_kind, below %d",
                       (long long)m->law, TM_LAW_COUNT);
    const tm_status status = check_constants(m, error);
    if (status) return status;
    if (!(m->stretch_max >= TM_STRETCH_LEAST && m->stretch_max <= TM_STRETCH_MOST))
        return tm_fail(error, TM_ERR_MATERIAL, -1, "law %s up to a stretch of %g: %g <= stretch <= %g is violated",
                       law->name, m->stretch_max, TM_STRETCH_LEAST, (double)TM_STRETCH_MOST);
    return law->check ? law->check(m, error) : TM_OK;
}

void tm_law_constants(const tm_material *m, double volume_m3, double c[TM_LAW_CONSTANTS]) {
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) c[i] = m->law_constant[i];
    if (tm_law_facts_of[m->law]->prepare) tm_law_facts_of[m->law]->prepare(m, volume_m3, c);
}

void tm_law_bound_terms(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    if (tm_law_facts_of[m->law]->bound) tm_law_facts_of[m->law]->bound(m, lambda_Pa, c, b);
}
