/* What a nonlinear law states of itself, outside of its kernels: the first part of NAME_law.h. Included by law_facts.c
 * and by what checks, prepares and bounds the constants of a material. */
#ifndef TM_LAW_FACTS_H
#define TM_LAW_FACTS_H

#include "material/law_bound.h"

typedef struct tm_law_facts {
    const char *name;
    bool has_fibres;  /* the moduli may be those of fibres; otherwise dlambda = dmu = beta = 0 */
    bool needs_fibre; /* has a direction with isotropic moduli too */
    tm_law_constant constant[TM_LAW_CONSTANTS]; /* in the order of law_constant; name null after the last */
    /* Sets limits that were not given, where they differ from TM_STRETCH_DEFAULT; null: none. */
    void (*limits)(tm_material *material, bool stretch_given);
    /* Checks inequalities other than ranges; null: none. */
    tm_status (*check)(const tm_material *material, tm_error *error);
    /* Converts c, law_constant, to what the stress reads, J instead of Pa; null: the same. */
    void (*prepare)(const tm_material *material, double volume_m3, double c[TM_LAW_CONSTANTS]);
    /* Adds the bounds of the law's terms in a cell of states, with lambda_Pa for the material's; sets those of U(J). */
    void (*bound)(const tm_material *material, double lambda_Pa, const tm_bound_cell *cell, tm_bound *bound);
} tm_law_facts;

/* [TM_LAW_COUNT]; that of the linear law has a name alone. */
extern const tm_law_facts *const tm_law_facts_of[];

/* Fails with "law NAME with WHAT = VALUE: INEQUALITY is violated". */
tm_status tm_law_bad(const tm_material *material, const char *what, double value, const char *violated,
                     tm_error *error);

#endif
