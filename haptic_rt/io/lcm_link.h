/* LCM for haptic-rt and tm-device, in the module `haptic` that is opened only when messages are wanted. Receives in a
 * thread of its own that posts to the nodes' mailboxes; publishing is done by the caller and does not allocate. */
#ifndef HRT_LCM_LINK_H
#define HRT_LCM_LINK_H

#include "node.h"

#define HRT_LCM_URL "udpm://239.255.76.67:7667?ttl=0"

typedef struct hrt_link hrt_link;

typedef struct hrt_link_counts {
    _Atomic int64_t samples, patches, poses, commands, hands;
} hrt_link_counts;

typedef struct hrt_link_def {
    const char *url;
    int32_t instrument;
    hrt_node *node; /* controller: FORCE_i, PATCH_i, SIM_STATUS, CONTROLLER_COMMAND_i */
    bool replay;    /* take samples that lcm-logplayer sends, though they answer another controller */
    /* device: HAND_i */
    void (*hand)(void *user, const double joint[5], bool active);
    void *user;
} hrt_link_def;

typedef struct hrt_link_api {
    /* The receive thread inherits the caller's scheduling. Null, with `why`, when LCM cannot open the URL. */
    hrt_link *(*open)(const hrt_link_def *def, char *why, int why_size);
    void (*close)(hrt_link *link);
    void (*publish_tool)(hrt_link *link, const hrt_tool_state *tool);
    void (*publish_status)(hrt_link *link, const hrt_status *status);
    const hrt_link_counts *(*counts)(const hrt_link *link);
} hrt_link_api;

/* Opens the module. Null, after a message on stderr with what to install, when it is not there. */
const hrt_link_api *hrt_link_module(void);

#endif
