/* What the simulation hears: tool states, and what controllers say of themselves. With a key a tool answers this very
 * simulation, and every message counts once: recorded ones never fit. */
#ifndef TM_SIM_LISTEN_H
#define TM_SIM_LISTEN_H

#include "link.h"
#include "tensormass/contact.h"

typedef struct sim_listener {
    void (*tool)(void *user, int instrument, const tensormass_tool_state_t *tool);
    void (*controller)(void *user, int instrument, const tensormass_controller_status_t *status);
    void *user;
} sim_listener;

typedef struct sim_ears {
    sim_listener listener;
    bool sealed;
    int64_t session; /* this simulation's */
    app_replay tools[TM_MAX_INSTRUMENTS], statuses[TM_MAX_INSTRUMENTS];
} sim_ears;

enum { SIM_TOPICS = 2 * TM_MAX_INSTRUMENTS };
/* Fills `topic` for so many instruments, and says how many topics they are; `ears` must outlive the link. */
int sim_ears_topics(sim_ears *ears, int instruments, app_topic topic[SIM_TOPICS]);

#endif
