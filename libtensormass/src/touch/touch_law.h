/* Compliance of a row of touch: that of instruments (contact_law/compliance.h), and stiffer again by the same factor
 * from TOUCH_CLOSE thicknesses on. So at the default cap of a row, 50 N, the surfaces do not meet yet. Edges that have
 * crossed are no longer held apart by their rows. */
#ifndef TM_TOUCH_LAW_H
#define TM_TOUCH_LAW_H

#include "base/vec.h"
#include "contact_law/compliance.h"

#define TOUCH_CLOSE 0.8 /* thicknesses */

static inline double touch_law_close_m(double soft_m) { return soft_m * (TOUCH_CLOSE / LAW_COMPLIANCE_TRAVEL); }

static inline double touch_law_depth(double compliance_m_N, double soft_m, double lambda_N) {
    const double depth = law_compliance_depth(compliance_m_N, soft_m, lambda_N), close_m = touch_law_close_m(soft_m);
    return depth <= close_m ? depth : close_m + (depth - close_m) / LAW_COMPLIANCE_HARDENING;
}

static inline double touch_law_slope(double compliance_m_N, double soft_m, double lambda_N) {
    const double slope = law_compliance_slope(compliance_m_N, soft_m, lambda_N);
    const bool open = law_compliance_depth(compliance_m_N, soft_m, lambda_N) <= touch_law_close_m(soft_m);
    return open ? slope : slope / LAW_COMPLIANCE_HARDENING;
}

/* Returns the lambda in [0, cap] that solves gap + diagonal lambda + depth(lambda) = 0. */
static inline double touch_law_reaction(double compliance_m_N, double soft_m, double gap_m, double diagonal_m_N,
                                        double cap_N) {
    const double lambda = law_compliance_reaction(compliance_m_N, soft_m, gap_m, diagonal_m_N, cap_N);
    const double close_m = touch_law_close_m(soft_m);
    if (law_compliance_depth(compliance_m_N, soft_m, lambda) <= close_m) return lambda;
    const double stiff = LAW_COMPLIANCE_HARDENING * LAW_COMPLIANCE_HARDENING;
    const double begin_m =
        close_m - (close_m - law_compliance_offset(soft_m)) / LAW_COMPLIANCE_HARDENING; /* at no force */
    return law_min(-(gap_m + begin_m) / (diagonal_m_N + compliance_m_N / stiff), cap_N);
}

/* Returns the energy stored at lambda, J; compliance above 0. */
static inline double touch_law_energy(double compliance_m_N, double soft_m, double lambda_N) {
    const double stiff_m_N = compliance_m_N / LAW_COMPLIANCE_HARDENING;
    const double close_N = (touch_law_close_m(soft_m) - law_compliance_offset(soft_m)) / stiff_m_N;
    const double open_N = law_min(lambda_N, close_N);
    return law_compliance_energy(compliance_m_N, soft_m, open_N) +
           0.5 * stiff_m_N / LAW_COMPLIANCE_HARDENING * (lambda_N * lambda_N - open_N * open_N);
}

#endif
