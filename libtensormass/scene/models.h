/* Models that a scene can name, indexed by app_model. */
#ifndef TM_SIM_MODELS_H
#define TM_SIM_MODELS_H

#include "sim.h"

typedef struct sim_model_row {
    /* Builds s->model from s->def. Returns 0, or a status after adding a fault. */
    tm_status (*build)(sim *s);
    bool solves_rest; /* --settle: solved directly without instruments; other models relax with them */
} sim_model_row;

extern const sim_model_row sim_models[];

tm_status sim_build_dynamic(sim *s);
tm_status sim_build_precomputed(sim *s); /* effect_precomputed.c */
tm_status sim_build_hybrid(sim *s);      /* effect_hybrid.c */
/* Adds a fault for a failed constructor, on the scene's line of the invalid member; returns 0 for TM_OK. */
tm_status sim_check_model(const sim *s, tm_status status, const tm_error *error);

#endif
