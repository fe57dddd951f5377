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

typedef struct sim_lcm_api {
    /* url null: no network; log null: no log. */
    sim_lcm *(*open)(const char *url, const char *log, tm_error *error);
    /* False: the log could not be written to its end. */
    bool (*close)(sim_lcm *link);
    void (*on_tool)(sim_lcm *link, int instrument,
                    void (*take)(void *user, int instrument, const tensormass_tool_state_t *tool), void *user);
    void (*on_controller)(sim_lcm *link, int instrument,
                          void (*take)(void *user, int instrument, const tensormass_controller_status_t *status),
                          void *user);
    /* `message` is the generated struct of its kind. On `channel` and into the log, stamped utime. */
    void (*send)(sim_lcm *link, sim_message kind, const char *channel, int64_t utime, const void *message);
    /* Hands over what has come, waiting at most so long for the first. */
    void (*receive)(sim_lcm *link, int64_t wait_us);
} sim_lcm_api;

/* Opens the module; null, with the package to install, when it is not there. */
const sim_lcm_api *sim_lcm_module(tm_error *error);

#endif
