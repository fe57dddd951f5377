/* Internals of the stage "friction", shared by friction.c, the energy account and patches. */
#ifndef TM_FRICTION_INTERNAL_H
#define TM_FRICTION_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/friction.h"

enum { TM_COOKIE_FRICTION = 0x66726963 };

/* Lasting state of one station. */
typedef struct tm_friction_state {
    double force_N[3];  /* on the tissue */
    double stick_state; /* 1 stuck .. 0 slid (contact_law/friction.h) */
} tm_friction_state;

/* Station with rows in this substep: rows first .. first + count - 1 of contact. */
typedef struct tm_touch {
    int32_t instrument, station, first, count;
    bool slips;
    double moved_m[3], normal[3], normal_force_N, coefficient;
    double force_N[3]; /* on the tissue, now */
} tm_touch;

struct tm_friction {
    tm_pool pool;
    tm_contact *contact;
    tm_friction_def def;
    int32_t placings[TM_MAX_INSTRUMENTS];
    tm_friction_state *state[TM_MAX_INSTRUMENTS], *saved[TM_MAX_INSTRUMENTS]; /* [TM_MAX_STATIONS]; null: no friction */
    tm_touch *touch; /* [max_rows] by instrument, then station */
    int32_t touch_count;
    double (*applied_N)[3]; /* [max_rows] share of its station's force in each row */
    bool joined;            /* in this substep, the rows' drag includes them */
    double lost_J;          /* dissipated by slip at the last substep */
};

/* Hooks of the stage. */
int64_t tm_friction_snapshot(void *self, void *buffer);
bool tm_friction_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
void tm_friction_checkpoint(void *self);
void tm_friction_rollback(void *self, tm_world *world);

/* Returns the energy stored in tangential contact compliance. */
double tm_friction_stretched_J(const tm_friction *friction);
/* Returns this energy of one instrument, J, and shortens all forces. After the sweeps, before the end of the
 * substep. */
double tm_friction_stretch_J(const tm_friction *friction, int32_t instrument);
void tm_friction_scale(tm_friction *friction, int32_t instrument, double share);

#endif
