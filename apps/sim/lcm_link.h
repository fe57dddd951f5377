/* LCM behind a table of functions: the module `lcm` is opened only when a scene or command needs messages or a log. */
#ifndef TM_SIM_LCM_LINK_H
#define TM_SIM_LCM_LINK_H

#include <stdint.h>

#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_controller_status_t.h"
#include "lcm_types/tensormass_cut_event_t.h"
#include "lcm_types/tensormass_force_sample_t.h"
#include "lcm_types/tensormass_sim_status_t.h"
#include "lcm_types/tensormass_tissue_t.h"
#include "lcm_types/tensormass_tool_state_t.h"
#include "seal.h"
#include "tensormass/base.h"

typedef enum sim_message {
    SIM_FORCE,
    SIM_PATCH,
    SIM_TISSUE,
    SIM_CUT,
    SIM_STATUS,
    SIM_TOOL,
    SIM_CONTROLLER,
    SIM_MESSAGE_COUNT
} sim_message;

typedef struct sim_lcm sim_lcm;

typedef struct sim_listener {
    void (*tool)(void *user, int instrument, const tensormass_tool_state_t *tool);
    void (*controller)(void *user, int instrument, const tensormass_controller_status_t *status);
    void *user;
} sim_listener;

typedef struct sim_refused {
    int64_t malformed; /* messages that are not whole */
    int64_t forged;    /* without the key's tag, heard before, or an answer to another simulation */
    int64_t packets;   /* not LCM's, or too long */
    int64_t foreign;   /* of other machines, though the URL has ttl=0 */
} sim_refused;

typedef struct sim_lcm_api {
    /* url null: no network; log null: no log. `session` is this simulation's; what is sent is sealed with the key, if
     * it is known. */
    sim_lcm *(*open)(const char *url, const char *log, const app_key *key, int64_t session, tm_error *error);
    /* False: the log could not be written to its end. */
    bool (*close)(sim_lcm *link);
    /* Tool states and controllers' words of so many instruments, from now on. False: the URL cannot be opened. */
    bool (*listen)(sim_lcm *link, int instruments, const sim_listener *listener, tm_error *error);
    /* `message` is the generated struct of its kind. On `channel` and into the log, stamped utime. */
    void (*send)(sim_lcm *link, sim_message kind, const char *channel, int64_t utime, const void *message);
    /* Hands over what has come, waiting at most so long for the first. */
    void (*receive)(sim_lcm *link, int64_t wait_us);
    sim_refused (*refused)(const sim_lcm *link);
} sim_lcm_api;

/* Opens the module; null, with the package to install, when it is not there. */
const sim_lcm_api *sim_lcm_module(tm_error *error);

#endif
