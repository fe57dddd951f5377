/* What the parts of tm-sim --trials share. */
#ifndef TM_SIM_TRIALS_H
#define TM_SIM_TRIALS_H

#include "run.h"

enum { POINTS_MAX = 256 };

/* A material point: a tetrahedron and its barycentric coordinates there, outside it too. */
typedef struct trial_point {
    int32_t tet;
    double weight[4];
} trial_point;

/* Scenes with shifted constants, kept from one request to the next: rows of a curve share them. */
enum { TRIAL_SHIFTS = 16 };
typedef struct trial_shifts {
    char *key[TRIAL_SHIFTS]; /* the settings, joined */
    sim *scene[TRIAL_SHIFTS];
    int next; /* the one to be replaced */
} trial_shifts;
void trial_shifts_free(trial_shifts *shifts);

/* Adds to the answer `slopes` [quantities][pairs]: the first-order change of each quantity from the second to the first
 * settings of a pair, at the equilibrium that s is in. Where that cannot be had: `slopes` null, and `why`. */
struct cJSON;
void trial_add_slopes(trial_shifts *shifts, const run_options *o, const app_host *host, sim *s, const trial_point *at,
                      int count, const struct cJSON *asked, struct cJSON *answer);

#endif
