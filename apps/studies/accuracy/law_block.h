/* Blocks of the nonlinear laws' verification: pressed, sheared, twisted, bent and indented as
 * apps/studies/accuracy/reference/law_cases.py has them. */
#ifndef TM_LAW_BLOCK_H
#define TM_LAW_BLOCK_H

#include "bench.h"
#include "tensormass.h"

enum { LAW_PROBES = 12, LAW_LEVELS = 3 };
typedef enum law_case { LAW_PRESS, LAW_SHEAR, LAW_TWIST, LAW_BEND, LAW_INDENT, LAW_CASES } law_case;
/* Returns the case's name in laws.json. */
const char *law_case_name(law_case which);

/* A material of laws.json. */
typedef struct law_sample {
    const char *name;
    tm_law_kind law;
    double constant[TM_LAW_CONSTANTS];
    bool fibred; /* mu_L = 2 mu_T, beta = mu_T */
} law_sample;
enum { LAW_SAMPLES = 6 };
extern const law_sample law_samples[LAW_SAMPLES];

/* How its tissue is computed. */
typedef struct law_form {
    const char *name;
    bool nonlinear, rotation, smoothing;
    double stretch_max; /* of the law; 0: the default */
} law_form;

typedef struct law_measured {
    double force; /* of what moves the face, N; of the twist its moment, N m */
    double energy_J, u_m[3 * LAW_PROBES];
    int32_t limited, tets; /* beyond a limit of the law; all */
} law_measured;

/* Returns the block of the case, free to move. `small`: 1,152 to 1,296 tetrahedra, else 9,216 to 10,368. */
app_bench_def law_bench(law_case which, const law_sample *s, const law_form *form, bool small);
/* Opens the block and finds its rest at each of `count` levels, ascending. */
tm_status law_rest(law_case which, const law_sample *s, const law_form *form, bool small, const double *level,
                   int count, law_measured *out, tm_error *error);

#endif
