/* Contact compliance of one row, c = contact compliance / share, m/N, and viscous contact drag.
 *   depth = c lambda up to `soft_m` (LAW_COMPLIANCE_TRAVEL radii); slope c/20 beyond.
 * So no force of a hand pushes the tool's axis through the surface. */
#ifndef LAW_COMPLIANCE_H
#define LAW_COMPLIANCE_H

#include "libtensormass/numeric/number.h"

#define LAW_COMPLIANCE_TRAVEL LAW(0.3) /* radii */
#define LAW_COMPLIANCE_HARDENING LAW(20)
/* Viscous contact drag: force per reaction and sliding speed, s/m. */
#define LAW_DRAG_S_M LAW(0.3)

static inline law_real law_compliance_depth(law_real compliance_m_N, law_real soft_m, law_real lambda_N) {
    const law_real depth = compliance_m_N * lambda_N;
    return depth <= soft_m ? depth : soft_m + (depth - soft_m) / LAW_COMPLIANCE_HARDENING;
}

static inline law_real law_compliance_slope(law_real compliance_m_N, law_real soft_m, law_real lambda_N) {
    return compliance_m_N * lambda_N <= soft_m ? compliance_m_N : compliance_m_N / LAW_COMPLIANCE_HARDENING;
}

/* Returns the lambda in [0, cap] that solves gap + diagonal lambda + depth(lambda) = 0. NaN gives 0, by the form of the
 * comparisons. Pivot 0: fixed by supports and without compliance, so nothing deforms. */
static inline law_real law_compliance_reaction(law_real compliance_m_N, law_real soft_m, law_real gap_m,
                                               law_real diagonal_m_N, law_real cap_N) {
    const law_real pivot = diagonal_m_N + compliance_m_N;
    if (!(gap_m < LAW(0)) || !(pivot > LAW(0))) return LAW(0);
    law_real lambda = -gap_m / pivot;
    if (compliance_m_N * lambda > soft_m)
        lambda = -(gap_m + soft_m - soft_m / LAW_COMPLIANCE_HARDENING) /
                 (diagonal_m_N + compliance_m_N / LAW_COMPLIANCE_HARDENING);
    return law_min(lambda, cap_N);
}

/* Returns the energy stored at lambda, J. */
static inline law_real law_compliance_energy(law_real compliance_m_N, law_real soft_m, law_real lambda_N) {
    const law_real soft = law_min(lambda_N, soft_m / compliance_m_N);
    return LAW(0.5) * compliance_m_N * (soft * soft + (lambda_N * lambda_N - soft * soft) / LAW_COMPLIANCE_HARDENING);
}

/* Returns the intercept of the hard line beyond soft_m: its depth extrapolated to zero force, m. */
static inline law_real law_compliance_offset(law_real soft_m) { return soft_m - soft_m / LAW_COMPLIANCE_HARDENING; }

#endif
