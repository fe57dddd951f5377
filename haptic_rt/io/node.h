/* A controller on its bus: controller + CAN codec + mailbox. Who calls hrt_node_tick differs (Linux loop, lockstep
 * simulation), the code does not. */
#ifndef HRT_NODE_H
#define HRT_NODE_H

#include <stdatomic.h>

#include "bus.h"
#include "can/exchange.h"
#include "gate.h"
#include "hrt.h"
#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_controller_status_t.h"
#include "lcm_types/tensormass_force_sample_t.h"
#include "lcm_types/tensormass_tool_state_t.h"
#include "mode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where the scene put the trocar and how the device hangs there. World frame. */
typedef struct hrt_pose {
    double trocar_m[3];
    double axis[3]; /* shaft's direction into the body at zero pitch and yaw */
    double up[3];
} hrt_pose;

typedef struct hrt_node_config {
    int32_t instrument; /* 0, 1 */
    hrt_mode mode;
    int64_t session; /* new at every start; lockstep: any constant */
    hrt_params params;
    bool pose_known; /* false: never engages before hrt_node_post_pose */
    hrt_pose pose;
    hrt_extrapolator extrapolator;
    bool passivity, coupling;
    bool enable; /* permission to engage; true */
} hrt_node_config;
hrt_node_config hrt_node_config_default(int32_t instrument);

/* Commands, thread-safe like samples. -1 leaves a setting. */
typedef struct hrt_command {
    int32_t extrapolator, passivity, coupling, enable;
    bool reset;
} hrt_command;

/* One writer, one reader, no lock. The writer owns a slot, the reader two (the one whose patch is in use, and a spare),
 * one is between them. */
typedef struct hrt_mailbox {
    struct hrt_slot {
        hrt_sample sample;
        hrt_patch patch;
        uint32_t number; /* of the samples posted */
    } slot[4];
    _Atomic uint32_t between; /* slot number, | 4 when not yet read */
    uint32_t write, held, spare;
} hrt_mailbox;

enum { HRT_NODE_RECEIVE, HRT_NODE_TICK, HRT_NODE_SEND, HRT_NODE_STAGES };

typedef struct hrt_node {
    hrt_node_config config;
    hrt_bus *bus;
    hrt_controller controller;
    hrt_mailbox mailbox;
    /* the posting thread's */
    float scratch[HRT_PATCH_COMPLIANCE];
    bool patch_waits; /* in slot[write], for the sample with its seq */
    int64_t patch_session;
    hrt_gate gate;       /* whose samples are taken, in what order */
    int64_t newest_t_us; /* t_n of the newest taken: the controller's own clock, so it never goes back */
    _Atomic uint32_t rejected, late;
    uint32_t posted;
    _Atomic(const char *) refusal; /* why the last of them; null: none */
    _Atomic int64_t now_us;        /* of the last tick, */
    _Atomic bool in_use;           /* and whether it rendered force */
    _Atomic int32_t wish_extrapolator, wish_passivity, wish_coupling, wish_enable, wish_reset; /* -1: none */
    hrt_pose pose_posted;
    _Atomic uint32_t pose_count, pose_taken; /* equal: taken over */
    /* the tick's */
    hrt_input input;
    hrt_result result;
    hrt_can_exchange exchange;
    uint32_t tool_seq;
    uint32_t taken;      /* number of the last sample taken */
    uint32_t superseded; /* posted, and a newer one came before the tick that would have taken them */
    uint32_t lost;       /* never came: gaps in seq, less those */
    /* for timing figures: set by who wants them */
    int64_t (*clock_ns)(void);
    int64_t stage_ns[HRT_NODE_STAGES];
} hrt_node;

/* The bus is opened by the caller and outlives the node. */
void hrt_node_init(hrt_node *node, const hrt_node_config *config, hrt_bus *bus);
/* From one thread, not the tick's. A patch comes before the sample with the same seq. Validated here, order and origin
 * too; anything but HRT_ACCEPT never reaches the tick, nor does it push out what waits there. Another simulation is
 * taken when no force is rendered and the present one has been silent for a second (gate.h). */
hrt_reject hrt_node_post_patch(hrt_node *node, const tensormass_contact_patch_t *patch);
hrt_reject hrt_node_post_sample(hrt_node *node, const tensormass_force_sample_t *sample);
/* Is this the simulation whose samples are taken, or may it become so? From the posting thread. */
bool hrt_node_hears(const hrt_node *node, int64_t session);
/* Force is rendered. Any thread. */
bool hrt_node_in_use(const hrt_node *node);
/* The scene's trocar. Taken over while no force is rendered. */
void hrt_node_post_pose(hrt_node *node, const hrt_pose *pose);
void hrt_node_post_command(hrt_node *node, const hrt_command *command);
/* Every 2 ms: receive, tick, send. `tool` (null: not wanted) is what the simulation is told; false: it means nothing
 * yet (no encoders, or no pose). */
bool hrt_node_tick(hrt_node *node, int64_t now_us, tensormass_tool_state_t *tool);
/* Before the program ends: motors off. */
void hrt_node_stop(hrt_node *node);
/* Its texts are constants, not to be freed; timing is the loop's, who fills it in. */
void hrt_node_status(const hrt_node *node, tensormass_controller_status_t *status);

#ifdef __cplusplus
}
#endif
#endif
