/* Coulomb friction of instruments on the tissue (docs/friction.md). A separate stage, swept with the rows of contact. A
 * world without it has no cost. */
#ifndef TENSORMASS_FRICTION_H
#define TENSORMASS_FRICTION_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Maximum friction coefficient. No instrument on wet or dry tissue comes near it. Larger values are refused, by a
 * controller too. */
#define TM_FRICTION_MAX 2.0

typedef struct tm_friction_coefficient {
    double mu_static;  /* after 0.1 s of sticking; 0 to TM_FRICTION_MAX */
    double mu_kinetic; /* after 0.2 mm of slip; 0 to mu_static */
} tm_friction_coefficient;

typedef struct tm_friction_def {
    uint32_t cookie, size;
    tm_friction_coefficient instrument[TM_MAX_INSTRUMENTS]; /* 0, 0 by default: no friction */
} tm_friction_def;

/* Friction at one station of a tool's axis (tm_contact_row.station). */
typedef struct tm_friction_station {
    int32_t station;
    bool slips;        /* slipped in the last step; false: sticks */
    double force_N[3]; /* on the tissue, perpendicular to `normal` */
    double normal[3];  /* unit, from tool to tissue: direction of the station's total row force */
    double
        normal_force_N; /* magnitude of that total: |force_N| <= coefficient * normal_force_N, equal where it slips */
    double coefficient; /* used in the last step, from `stick_state` before it */
    double stick_state; /* 1 stuck (static coefficient), 0 slid (kinetic coefficient), linear between */
} tm_friction_station;

typedef struct tm_friction tm_friction;

TM_API tm_friction_def tm_friction_def_default(void);
/* Adds the stage "friction"; `contact` is the world's. tm_contact_reaction includes its forces. The world owns the
 * handle. TM_ERR_ARGUMENT: a coefficient out of range, or a world that has friction already. */
TM_API tm_status tm_stage_friction(tm_world *world, tm_contact *contact, const tm_friction_def *def,
                                   tm_friction **friction, tm_error *error);
/* Writes the stations that touched in the last step, ascending, at most `most`. Returns how many there are. */
TM_API int32_t tm_friction_stations(const tm_friction *friction, int32_t instrument, tm_friction_station *station,
                                    int32_t most);

#ifdef __cplusplus
}
#endif
#endif
