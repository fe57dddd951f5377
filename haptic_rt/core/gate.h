/* Who is believed on a channel that anybody may write to: one peer at a time, told by its session, in order of its seq
 * and of its own clock. Used by the simulation for tool states and by the controller for samples. Pure, no float.
 *
 * Only the receiver's own monotonic clock decides how long a peer has been silent. Sessions are compared for equality
 * alone, and the peer's times only with each other: nobody's wall clock is believed, and after a second of silence any
 * session, seq and time will do, so that nothing that was ever taken locks the door for longer than that. */
#ifndef HRT_GATE_H
#define HRT_GATE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { HRT_GATE_SILENCE_US = 1000000 };

/* What a message says of itself. */
typedef struct hrt_gate_mark {
    int64_t session; /* new at every start of the peer */
    int64_t utime;   /* us, the peer's clock: never goes back within a session */
    uint32_t seq;    /* modulo 2^32 */
} hrt_gate_mark;

/* All zero: nobody yet. */
typedef struct hrt_gate {
    bool known;
    hrt_gate_mark last; /* of the newest accepted */
    int64_t heard_us;   /* when that came, the receiver's clock */
} hrt_gate;

typedef enum hrt_gate_verdict {
    HRT_GATE_ACCEPTED = 0,
    HRT_GATE_NEW_SESSION, /* accepted, and it is not who spoke before: forget what hangs on that one */
    HRT_GATE_REPEATED,    /* the same seq again */
    HRT_GATE_LATE,        /* a seq before the newest */
    HRT_GATE_CLOCK_BACK,  /* a later seq with an earlier time */
    HRT_GATE_FOREIGN,     /* another session while the current one speaks */
    HRT_GATE_PINNED,      /* another session while the current one may not be left */
    HRT_GATE_VERDICT_COUNT
} hrt_gate_verdict;

static inline bool hrt_gate_open(hrt_gate_verdict verdict) { return verdict <= HRT_GATE_NEW_SESSION; }
/* A sentence for people: why, and when that ends. */
const char *hrt_gate_text(hrt_gate_verdict verdict);

/* Judges a message whose content was found good, and remembers it when it is accepted. now_us: the receiver's monotonic
 * clock. pinned: no other session, and nothing out of order, however long the silence (while force is rendered). */
hrt_gate_verdict hrt_gate_accept(hrt_gate *gate, int64_t now_us, bool pinned, const hrt_gate_mark *mark);

#ifdef __cplusplus
}
#endif
#endif
