/* Coulomb friction of one station of a tool on tissue. The station's contact compliance also acts tangentially. While
 * the station sticks, its force is the tangential stretch over the compliance, so it does not creep. Force beyond
 * `coefficient * N` slips.
 *
 * The coefficient is static after sticking and kinetic after slip. It falls linearly over LAW_FRICTION_SLIP_M of slip
 * and recovers linearly over LAW_FRICTION_STICK_S of sticking (slip weakening: Ida 1972; healing at rest: Dieterich
 * 1972). One bristle per contact and its bound: Dahl 1968; Haessig and Friedland 1991. */
#ifndef LAW_FRICTION_H
#define LAW_FRICTION_H

#include "libtensormass/numeric/vec.h"

#define LAW_FRICTION_SLIP_M LAW(0.2e-3)
#define LAW_FRICTION_STICK_S LAW(0.1)

/* Returns the coefficient for the stick state `rest`: 1 stuck, 0 slid. */
static inline law_real law_friction_coefficient(law_real at_rest, law_real sliding, law_real rest) {
    return sliding + (at_rest - sliding) * rest;
}

/* Projects v onto the plane perpendicular to the unit vector `normal`. */
static LAW_CALL void law_across(const law_real normal[3], law_real v[3]) { vmadd(v, -vdot(v, normal), normal, v); }

/* Limits a force to the friction bound. Returns false if it was within: the station sticks. A NaN gives zero force, by
 * the form of the comparisons. */
static LAW_CALL bool law_friction_slips(law_real bound_N, law_real force_N[3]) {
    const law_real size = vnorm(force_N);
    if (size <= bound_N) return false;
    vscale(size > LAW(0) && bound_N > LAW(0) ? bound_N / size : LAW(0), force_N, force_N);
    return true;
}

/* Returns the stick state after `slip_m` of slip or, if that is 0, after `passed_s` of sticking. */
static inline law_real law_stick_state(law_real rest, law_real slip_m, law_real passed_s) {
    return law_clamp(slip_m > LAW(0) ? rest - slip_m / LAW_FRICTION_SLIP_M : rest + passed_s / LAW_FRICTION_STICK_S,
                     LAW(0), LAW(1));
}

#endif
