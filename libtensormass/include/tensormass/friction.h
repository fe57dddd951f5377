/* Coulomb friction of instruments on the tissue (docs/friction.md): a stage of its own beside contact, swept
 * with its rows. A world without it pays nothing. */
#ifndef TENSORMASS_FRICTION_H
#define TENSORMASS_FRICTION_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* No instrument on tissue, wet or dry, comes near this; more is refused, here and by a controller. */
#define TM_FRICTION_MAX 2.0

typedef struct tm_friction_coefficient {
    double mu_static;  /* static: of what has stuck for 0.1 s; 0 to TM_FRICTION_MAX */
    double mu_kinetic; /* of what has slid 0.2 mm; 0 to at_rest */
} tm_friction_coefficient;

typedef struct tm_friction_def {
    uint32_t cookie, size;
    tm_friction_coefficient instrument[TM_MAX_INSTRUMENTS]; /* 0, 0 by default: that one has none */
} tm_friction_def;

/* What friction does at one station of a tool's axis (tm_contact_row.station). */
typedef struct tm_friction_station {
    int32_t station;
    bool slips;            /* in the last step; false: it sticks */
    double force_N[3];     /* on the tissue, across `normal` */
    double normal[3];      /* unit, from tool to tissue: of all rows of the station */
    double normal_force_N; /* what they press with along it: |force_N| <= coefficient * normal_force_N, equal where it
                              slips */
    double coefficient;    /* that held in the last step: by what `rest` was before it */
    double stick_state;    /* 1 has rested: the static coefficient holds; 0 has slid: the sliding one; evenly between */
} tm_friction_station;

typedef struct tm_friction tm_friction;

TM_API tm_friction_def tm_friction_def_default(void);
/* Adds the stage "friction"; `contact` is the world's. Its forces are in tm_contact_reaction. The world owns the
 * handle. TM_ERR_ARGUMENT: a coefficient out of range, or a world that has friction already. */
TM_API tm_status tm_stage_friction(tm_world *world, tm_contact *contact, const tm_friction_def *def,
                                   tm_friction **friction, tm_error *error);
/* Stations that touched in the last step, ascending; at most `most` of them. Returns how many there are. */
TM_API int32_t tm_friction_stations(const tm_friction *friction, int32_t instrument, tm_friction_station *station,
                                    int32_t most);

#ifdef __cplusplus
}
#endif
#endif
