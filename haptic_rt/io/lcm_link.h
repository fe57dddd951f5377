/* LCM for haptic-rt and tm-device, in the module `haptic` that is opened only when messages are wanted. Receives in a
 * thread of its own that posts to the nodes' mailboxes, and sends in another: who publishes leaves the message in a
 * slot without lock, allocation or waiting. */
#ifndef HRT_LCM_LINK_H
#define HRT_LCM_LINK_H

#include "histogram.h"
#include "node.h"
#include "receiver.h"
#include "seal.h"

#define HRT_LCM_URL "udpm://239.255.76.67:7667?ttl=0"

typedef struct hrt_link hrt_link;

typedef struct hrt_link_counts {
    _Atomic int64_t samples, patches, poses, commands, hands;
    _Atomic int64_t malformed; /* not whole messages of their type */
    _Atomic int64_t forged;    /* without the key's tag, or heard before */
    _Atomic int64_t refused;   /* commands for another controller, and resets that come too often or while in use */
} hrt_link_counts;

/* How long messages lay before they were sent. */
typedef struct hrt_link_sent {
    hrt_histogram lay;
    int64_t tools, skipped; /* skipped: a newer one came before it could be sent */
} hrt_link_sent;

typedef struct hrt_link_def {
    const char *url;
    int32_t instrument;
    hrt_node *node;     /* controller: FORCE_i, PATCH_i, SIM_STATUS, CONTROLLER_COMMAND_i */
    const app_key *key; /* null or not known: nothing is sealed */
    bool replay;        /* take samples that lcm-logplayer sends, though they answer another controller */
    /* device: HAND_i */
    void (*hand)(void *user, const double joint[5], bool active);
    void *user;
} hrt_link_def;

typedef struct hrt_link_api {
    /* Both threads inherit the caller's scheduling. Null, with `why`, when LCM cannot open the URL. */
    hrt_link *(*open)(const hrt_link_def *def, char *why, int why_size);
    /* `sent` (null: not wanted) is filled. */
    void (*close)(hrt_link *link, hrt_link_sent *sent);
    /* Both from the loop's thread. */
    void (*publish_tool)(hrt_link *link, const hrt_tool_state *tool);
    void (*publish_status)(hrt_link *link, const hrt_status *status);
    const hrt_link_counts *(*counts)(const hrt_link *link);
    const app_receiver_counts *(*packets)(const hrt_link *link);
} hrt_link_api;

/* Opens the module. Null, after a message on stderr with what to install, when it is not there. */
const hrt_link_api *hrt_link_module(void);

#endif
