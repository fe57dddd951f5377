/* The static problem of a tm_model_def, for the models that solve it. */
#ifndef TMS_MODEL_PROBLEM_H
#define TMS_MODEL_PROBLEM_H

#include "internal.h"
#include "tensormass/model.h"

typedef struct tms_problem {
    uint8_t *fixed;           /* [3*vertex_count] */
    double *value_m, *load_N; /* [3*vertex_count] */
} tms_problem;

/* Sets tissue, supports, loads and weight in `solve`. */
tm_status tms_problem_build(const tm_model_def *def, const tm_tissue *whole, tms_problem *problem, tm_solve_def *solve,
                            tm_error *error);
void tms_problem_free(tms_problem *problem);
/* Sets def->invalid_member, if requested. Returns `status`. */
tm_status tms_invalid_member(const tm_model_def *def, const char *member, tm_status status);

#endif
