/* Moving window over the energy that contact generates, for the passivity observers of the dynamic and the hybrid
 * model. Their states keep the total, its minimum in each interval of the window, and the age of the newest interval.
 * In `double` alone: the controller has no such account. */
#ifndef LAW_LEDGER_H
#define LAW_LEDGER_H

#include <string.h>

#define LAW_WINDOW_S 0.2  /* length of the window */
enum { LAW_LEDGER = 17 }; /* its intervals, plus the newest, which has only begun */

/* Returns the energy generated since its minimum within the window: the maximum over all windows that end now. */
static inline double law_ledger_recent(double generated_J, const double min_generated_J[LAW_LEDGER]) {
    double least = generated_J;
    for (int i = 0; i < LAW_LEDGER; i++) least = least < min_generated_J[i] ? least : min_generated_J[i];
    return generated_J - least;
}

/* Advances the window by a substep; the newest interval comes first. */
static inline void law_ledger_advance(double generated_J, double min_generated_J[LAW_LEDGER], double *age_s,
                                      double dt_s) {
    if (!(min_generated_J[0] < generated_J)) min_generated_J[0] = generated_J;
    *age_s += dt_s;
    if (*age_s < LAW_WINDOW_S / (LAW_LEDGER - 1)) return;
    *age_s = 0;
    memmove(min_generated_J + 1, min_generated_J, sizeof *min_generated_J * (LAW_LEDGER - 1));
    min_generated_J[0] = generated_J;
}

#endif
