/* A controller on its bus: controller, CAN codec and mailbox. The Linux loop and the lockstep simulation call the same
 * hrt_node_tick. */
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

/* Place of trocar and device in the scene, world frame. */
typedef struct hrt_pose {
    double trocar_m[3]; /* of a free instrument its origin */
    double axis[3];     /* shaft's direction into the body at zero pitch and yaw */
    double up[3];
    int64_t is_free; /* 1: no trocar; as wide as its neighbours, as poses are compared by their bytes */
} hrt_pose;

typedef struct hrt_node_config {
    int32_t instrument; /* 0, 1 */
    hrt_mode mode;
    int64_t session; /* new at every start; lockstep: any constant */
    hrt_params params;
    bool pose_known; /* false: does not engage before hrt_node_post_pose */
    hrt_pose pose;
    hrt_extrapolator extrapolator;
    bool passivity, coupling;
    bool enable; /* permission to engage; default true */
} hrt_node_config;
hrt_node_config hrt_node_config_default(int32_t instrument);

/* A command; posting is thread-safe. -1 leaves a setting unchanged. */
typedef struct hrt_command {
    int32_t extrapolator, passivity, coupling, enable;
    bool reset;
} hrt_command;

/* Lock-free mailbox with one writer and one reader. The writer owns one slot, the reader two: the one whose patch is in
 * use, and a spare. The fourth is exchanged between them. */
typedef struct hrt_mailbox {
    struct hrt_slot {
        hrt_sample sample;
        hrt_patch patch;
        uint32_t number; /* number of the posted sample */
    } slot[4];
    _Atomic uint32_t between; /* slot number;
                               *
                               * 4: not yet read */
    uint32_t write, held, spare;
} hrt_mailbox;

enum { HRT_NODE_RECEIVE, HRT_NODE_TICK, HRT_NODE_SEND, HRT_NODE_STAGES };

typedef struct hrt_node {
    hrt_node_config config;
    hrt_bus *bus;
    struct hrt_drive *drive; /* the device, instead of one on the bus; null: the bus */
    hrt_controller controller;
    hrt_mailbox mailbox;
    /* used by the posting thread */
    float scratch[HRT_PATCH_COMPLIANCE];
    bool patch_waits; /* a patch waits in slot[write] for the sample with its seq */
    int64_t patch_session;
    hrt_gate gate;       /* filter of the samples' senders */
    int64_t newest_t_us; /* t_n of the newest accepted sample, on the controller's own clock; it never decreases */
    _Atomic uint32_t rejected, late;
    uint32_t posted;
    _Atomic(const char *) refusal; /* reason of the last rejection; null: none */
    _Atomic int64_t now_us;        /* time of the last tick */
    _Atomic bool in_use;           /* whether that tick rendered force */
    _Atomic int32_t wish_extrapolator, wish_passivity, wish_coupling, wish_enable, wish_reset; /* -1: none */
    hrt_pose pose_posted;
    _Atomic uint32_t pose_count, pose_taken; /* equal: the posted pose is in use */
    /* used by the tick */
    hrt_input input;
    hrt_result result;
    hrt_can_exchange exchange;
    uint32_t tool_seq;
    uint32_t taken;      /* number of the last sample taken */
    uint32_t superseded; /* samples replaced by a newer one before a tick took them */
    uint32_t lost;       /* samples never received: gaps in seq, less `superseded` */
    /* for timing: set by the caller, or null */
    int64_t (*clock_ns)(void);
    int64_t stage_ns[HRT_NODE_STAGES];
} hrt_node;

/* Initialises the node. The caller opens the bus, which must outlive the node. To use a device that is not on a bus
 * (drive.h), set `drive` afterwards; the bus then only counts nothing. */
void hrt_node_init(hrt_node *node, const hrt_node_config *config, hrt_bus *bus);
/* Posts a patch or a sample; call both from one thread, not the tick's. A patch precedes the sample with its seq. Both
 * check content, order and origin. Only accepted data reach the tick; rejected data replace nothing in the mailbox.
 * Another simulation is accepted if no force is rendered and the current one has been silent for a second (gate.h). */
hrt_reject hrt_node_post_patch(hrt_node *node, const tensormass_contact_patch_t *patch);
hrt_reject hrt_node_post_sample(hrt_node *node, const tensormass_force_sample_t *sample);
/* Returns a sample without force at the tool's tip, as a simulation would answer it. */
tensormass_force_sample_t hrt_node_sample_for(const tensormass_tool_state_t *tool, uint32_t seq);
/* Returns whether this simulation is the accepted one or may become so. Call it from the posting thread. */
bool hrt_node_hears(const hrt_node *node, int64_t session);
/* Returns whether force is rendered; callable from any thread. */
bool hrt_node_in_use(const hrt_node *node);
/* Posts the scene's pose. It takes effect while no force is rendered. */
void hrt_node_post_pose(hrt_node *node, const hrt_pose *pose);
void hrt_node_post_command(hrt_node *node, const hrt_command *command);
/* Receives, ticks and sends; call it every 2 ms. Fills `tool` (may be null) for the simulation. Returns false if that
 * is not valid yet: no encoders, or no pose. */
bool hrt_node_tick(hrt_node *node, int64_t now_us, tensormass_tool_state_t *tool);
/* Turns the motors off; call it before the program ends. */
void hrt_node_stop(hrt_node *node);
/* Fills the status. Its texts are constants, not to be freed. The loop adds the timing. */
void hrt_node_status(const hrt_node *node, tensormass_controller_status_t *status);

#ifdef __cplusplus
}
#endif
#endif
