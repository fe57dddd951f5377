/* First-time check of a device (haptic-rt --setup): a push test. Along each axis, both ways, a force grows by a
 * millinewton in a millisecond until the tip has moved by a millimetre, and falls again. The way it moved proves the
 * signs, the force that it took the units. If all is well, a weak sum of sines then shakes each axis for 2.5 s, which
 * identifies mass, damping, friction, stiffness and delay of device and hand. The controller renders the force, with
 * all its limits. */
#ifndef HRT_SETUP_H
#define HRT_SETUP_H

#include "identify.h"
#include "node.h"

enum { HRT_SETUP_PUSHES = 6 };

typedef enum hrt_setup_verdict {
    HRT_SETUP_PENDING = 0,
    HRT_SETUP_GOOD,
    HRT_SETUP_AGAINST, /* moved against the force, or more across it */
    HRT_SETUP_STILL,   /* did not move at the largest force */
    HRT_SETUP_UNTURNED /* moved as commanded, but the torque did not turn the handle its way */
} hrt_setup_verdict;

typedef struct hrt_setup_push {
    hrt_setup_verdict verdict;
    float force_N, moved_m[3], turned_rad; /* towards the force */
} hrt_setup_push;

typedef struct hrt_setup {
    int64_t since_us; /* of the phase; 0: not begun */
    int32_t push;     /* number of the push; HRT_SETUP_PUSHES: done */
    bool falling;
    float force_N, at_N;                    /* now, and where the fall began */
    bool turns;                             /* torque at the handle is rendered */
    double start_rad[2];                    /* tilt before the push */
    double start_m[3], low_m[3], high_m[3]; /* tip before the push; its range at rest */
    uint32_t seq;
    hrt_setup_push result[HRT_SETUP_PUSHES];
    double tick_s; /* period of the calls; set it before the first */
    int32_t axis;  /* that is shaken; 3: done */
    int64_t axis_us, begin_us;
    const char *ended; /* why it ended early; null: it did not */
    hrt_identify identify[3];
} hrt_setup;

/* Continues the test by a tick: posts a sample. Returns false once it is done, or ended by a fault or after 90 s. */
bool hrt_setup_feed(hrt_setup *setup, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us);
/* Prints what was found. Returns whether all pushes moved the tip as commanded, and every axis was shaken. */
bool hrt_setup_print(const hrt_setup *setup);

#endif
