/* The message side of a controller or a device, over any link. Passes received messages to its node or hand, and builds
 * the sent ones from them. It has no thread or clock: real time and lockstep run the same code. */
#ifndef HRT_PEER_H
#define HRT_PEER_H

#include "core/gate.h"
#include "link.h"
#include "node.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_peer_def {
    int32_t instrument;
    hrt_node *node;     /* controller: receives FORCE_i, PATCH_i, SIM_STATUS, CONTROLLER_COMMAND_i; null: none */
    const app_key *key; /* null or unknown: messages are not authenticated */
    bool pose_given;    /* the node has the scene's exact pose; ignore the pose in SIM_STATUS */
    bool replay;        /* accept samples from lcm-logplayer, although they answer another controller */
    /* device: receives HAND_i; null: none */
    int32_t joints; /* number of the device's joints */
    void (*hand)(void *user, const double joint[HRT_JOINTS], bool active);
    void *user;
} hrt_peer_def;

typedef struct hrt_peer {
    hrt_peer_def def;
    app_link *link;
    bool sealed;
    _Atomic int64_t refused;       /* commands for another controller, and resets too frequent or while in use */
    _Atomic int64_t heard_session; /* session of the simulation, for tool_state_t.sim_session */
    _Atomic uint32_t command_seq;
    /* used by the receiving thread */
    int64_t sim_session, replay_session, replay_offset_us, reset_us;
    app_replay statuses, hands;
    hrt_gate hand_gate;
    /* used by the sending thread */
    uint32_t status_seq;
} hrt_peer;

/* Capacity for hrt_peer_topics. */
enum { HRT_PEER_TOPICS = 5 };
/* Initialises a peer. Then call hrt_peer_topics, open a link with these topics, and set peer->link. */
void hrt_peer_init(hrt_peer *peer, const hrt_peer_def *def);
/* Fills the topics that the peer receives; returns their number. */
int hrt_peer_topics(hrt_peer *peer, app_topic topic[HRT_PEER_TOPICS]);
/* Send messages; call both from one thread. Another may receive concurrently. */
void hrt_peer_send_tool(hrt_peer *peer, const tensormass_tool_state_t *tool);
void hrt_peer_send_status(hrt_peer *peer, const tensormass_controller_status_t *status);

#ifdef __cplusplus
}
#endif
#endif
