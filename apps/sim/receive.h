/* Receives tool states and the controllers' status. With a key, a tool must answer this session of the simulation and
 * each message counts once, so recorded messages are rejected. */
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
    int64_t session; /* session of this simulation */
    app_replay tools[TM_MAX_INSTRUMENTS], statuses[TM_MAX_INSTRUMENTS];
} sim_ears;

enum { SIM_TOPICS = 2 * TM_MAX_INSTRUMENTS };
/* Fills `topic` for this many instruments and returns the number of topics. `ears` must outlive the link. */
int sim_ears_topics(sim_ears *ears, int instruments, app_topic topic[SIM_TOPICS]);

#endif
