/* The models that a scene can name, by app_model. */
#ifndef TM_SIM_MODELS_H
#define TM_SIM_MODELS_H

#include "sim.h"

typedef struct sim_model_row {
    /* Makes s->model from s->def. 0 or a status, having complained. */
    tm_status (*build)(sim *s);
    bool solves_rest; /* --settle: directly, without instruments, where others relax with them */
} sim_model_row;

extern const sim_model_row sim_models[];

tm_status sim_build_dynamic(sim *s);
tm_status sim_build_precomputed(sim *s); /* effect_precomputed.c */
tm_status sim_build_hybrid(sim *s);      /* effect_hybrid.c */
/* What a constructor came back with, blamed on the line that asked for what is at fault; 0 for TM_OK. */
tm_status sim_check_model(const sim *s, tm_status status, const tm_error *error);

#endif
