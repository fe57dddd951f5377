/* A peer on the network, for haptic-rt and tm-device. One thread receives, another sends. Publishing stores the message
 * in a slot without lock, allocation or waiting. */
#ifndef HRT_LIVE_H
#define HRT_LIVE_H

#include "histogram.h"
#include "peer.h"

typedef struct hrt_live hrt_live;

/* Statistics of sent messages. */
typedef struct hrt_live_sent {
    hrt_histogram lay;
    int64_t tools, skipped; /* skipped: replaced by a newer one before it was sent */
} hrt_live_sent;

typedef struct hrt_live_refused {
    int64_t malformed, forged, commands;
    app_packet_counts packets;
} hrt_live_refused;

/* Opens the peer; both threads inherit the caller's scheduling. Returns null, with `why`, if the URL cannot be opened.
 */
hrt_live *hrt_live_open(app_network_opener *network, const char *url, const hrt_peer_def *def, char *why, int why_size);
/* Closes the peer and fills `sent` (may be null). */
void hrt_live_close(hrt_live *live, hrt_live_sent *sent);
/* Call both from the loop's thread. */
void hrt_live_send_tool(hrt_live *live, const tensormass_tool_state_t *tool);
void hrt_live_send_status(hrt_live *live, const tensormass_controller_status_t *status);
hrt_live_refused hrt_live_refusals(hrt_live *live);

#endif
