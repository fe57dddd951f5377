/* A controller's, or a device's, side of the messages, over any link: what is heard goes to its node or its hand, what
 * is said is made from them. No thread and no clock of its own: real time and lockstep run this same code. */
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
    hrt_node *node;     /* controller: hears FORCE_i, PATCH_i, SIM_STATUS, CONTROLLER_COMMAND_i; null: none */
    const app_key *key; /* null or not known: nothing is sealed */
    bool pose_given;    /* the scene's pose is the node's to the last bit; what SIM_STATUS says of it is not taken */
    bool replay;        /* take samples that lcm-logplayer sends, though they answer another controller */
    /* device: hears HAND_i; null: none */
    int32_t joints; /* of the device */
    void (*hand)(void *user, const double joint[HRT_JOINTS], bool active);
    void *user;
} hrt_peer_def;

typedef struct hrt_peer {
    hrt_peer_def def;
    app_link *link;
    bool sealed;
    _Atomic int64_t refused;       /* commands for another controller, and resets that come too often or while in use */
    _Atomic int64_t heard_session; /* of the simulation, for tool_state_t.sim_session */
    _Atomic uint32_t command_seq;
    /* the hearing thread's */
    int64_t sim_session, replay_session, replay_offset_us, reset_us;
    app_replay statuses, hands;
    hrt_gate hand_gate;
    /* the saying one's */
    uint32_t status_seq;
} hrt_peer;

/* Room for what hrt_peer_topics fills. */
enum { HRT_PEER_TOPICS = 5 };
/* In this order: init, topics, a link opened with them, which is then set as peer->link. */
void hrt_peer_init(hrt_peer *peer, const hrt_peer_def *def);
/* What it listens to; how many. */
int hrt_peer_topics(hrt_peer *peer, app_topic topic[HRT_PEER_TOPICS]);
/* Both from one thread; another may hear meanwhile. */
void hrt_peer_send_tool(hrt_peer *peer, const tensormass_tool_state_t *tool);
void hrt_peer_send_status(hrt_peer *peer, const tensormass_controller_status_t *status);

#ifdef __cplusplus
}
#endif
#endif
