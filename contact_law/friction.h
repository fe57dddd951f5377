/* Coulomb friction of one station of a tool on the tissue under it. The station's skin gives way along the surface as
 * it does across it: while it sticks its force is the stretch of that skin over its compliance, so that it stays where
 * it is and does not creep; what would be beyond `coefficient * N` slips. The coefficient is the static one of what has
 * rested, the sliding one of what has slid: it falls evenly over LAW_FRICTION_SLIP_M of slip and comes back evenly over
 * LAW_FRICTION_STICK_S of sticking (slip weakening: Ida 1972; healing at rest: Dieterich 1972). One bristle a contact
 * and its bound: Dahl 1968; Haessig and Friedland 1991. */
#ifndef LAW_FRICTION_H
#define LAW_FRICTION_H

#include "libtensormass/numeric/vec.h"

#define LAW_FRICTION_SLIP_M LAW(0.2e-3)
#define LAW_FRICTION_STICK_S LAW(0.1)

/* rest: 1 has rested, 0 has slid. */
static inline law_real law_friction_coefficient(law_real at_rest, law_real sliding, law_real rest) {
    return sliding + (at_rest - sliding) * rest;
}

/* What is left of v in the plane across the unit vector `normal`. */
static LAW_CALL void law_across(const law_real normal[3], law_real v[3]) { vmadd(v, -vdot(v, normal), normal, v); }

/* Shortens a force to what friction bears. False: it was within, the station sticks. Written so that what is no number
 * bears nothing. */
static LAW_CALL bool law_friction_slips(law_real bound_N, law_real force_N[3]) {
    const law_real size = vnorm(force_N);
    if (size <= bound_N) return false;
    vscale(size > LAW(0) && bound_N > LAW(0) ? bound_N / size : LAW(0), force_N, force_N);
    return true;
}

/* `rest` after it slipped so far, or, where that is 0, stuck so long. */
static inline law_real law_stick_state(law_real rest, law_real slip_m, law_real passed_s) {
    return law_clamp(slip_m > LAW(0) ? rest - slip_m / LAW_FRICTION_SLIP_M : rest + passed_s / LAW_FRICTION_STICK_S,
                     LAW(0), LAW(1));
}

#endif
