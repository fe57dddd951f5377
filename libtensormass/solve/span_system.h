/* Few rows whose normals and shares are given: how hard each presses. */
#ifndef TMS_SPAN_SYSTEM_H
#define TMS_SPAN_SYSTEM_H

#include "local.h"

enum { TMS_SPAN_ROWS = 64 };

typedef struct tms_span_system {
    int32_t count;
    double cap_N;
    double give[TMS_SPAN_ROWS][TMS_SPAN_ROWS]; /* m/N: of row i's gap by the force of row j */
    double gap_m[TMS_SPAN_ROWS];               /* without any of these forces */
    double skin_m_N[TMS_SPAN_ROWS], radius_m[TMS_SPAN_ROWS];
    double lambda_N[TMS_SPAN_ROWS]; /* in: a guess; out: what each bears */
    double matrix[TMS_SPAN_ROWS * TMS_SPAN_ROWS], off_N[TMS_SPAN_ROWS];
    int32_t pivot[TMS_SPAN_ROWS];
} tms_span_system;

/* lambda = what its skin bears at the gap that all of them leave it, of every row at once. False: not found. */
bool tms_span_solve(tms_span_system *system);
/* The gap of row i with the forces in lambda_N. */
double tms_span_gap(const tms_span_system *system, int32_t i);

#endif
