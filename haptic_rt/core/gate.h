/* Sender filter of a channel that any program may write to. It accepts one session at a time, in order of its seq and
 * its clock. The simulation uses it for tool states, the controller for samples. Pure; no floats.
 *
 * Only the receiver's monotonic clock measures a sender's silence. Sessions are compared for equality, and the sender's
 * times only with each other; no wall clock is trusted. After a second of silence any session, seq and time are
 * accepted, so no accepted message can block the channel for longer. */
#ifndef HRT_GATE_H
#define HRT_GATE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { HRT_GATE_SILENCE_US = 1000000 };

/* Identification of a message. */
typedef struct hrt_gate_mark {
    int64_t session; /* new at every start of the peer */
    int64_t utime;   /* us, the sender's clock; it never decreases within a session */
    uint32_t seq;    /* modulo 2^32 */
} hrt_gate_mark;

/* State of the filter. All zero: nothing accepted yet. */
typedef struct hrt_gate {
    bool known;
    hrt_gate_mark last; /* mark of the newest accepted message */
    int64_t heard_us;   /* time of its reception, on the receiver's clock */
} hrt_gate;

typedef enum hrt_gate_verdict {
    HRT_GATE_ACCEPTED = 0,
    HRT_GATE_NEW_SESSION, /* accepted from a new session: discard state of the previous one */
    HRT_GATE_REPEATED,    /* the same seq again */
    HRT_GATE_LATE,        /* a seq before the newest */
    HRT_GATE_CLOCK_BACK,  /* a later seq with an earlier time */
    HRT_GATE_FOREIGN,     /* another session while the current one is active */
    HRT_GATE_PINNED,      /* another session while the current one is pinned */
    HRT_GATE_VERDICT_COUNT
} hrt_gate_verdict;

static inline bool hrt_gate_open(hrt_gate_verdict verdict) { return verdict <= HRT_GATE_NEW_SESSION; }
/* Returns a sentence for the operator: the reason, and when it ends. */
const char *hrt_gate_text(hrt_gate_verdict verdict);

/* Decides whether to accept a valid message, and stores its mark if so. now_us: the receiver's monotonic clock. pinned:
 * reject other sessions and messages out of order, however long the silence (while force is rendered). */
hrt_gate_verdict hrt_gate_accept(hrt_gate *gate, int64_t now_us, bool pinned, const hrt_gate_mark *mark);

#ifdef __cplusplus
}
#endif
#endif
