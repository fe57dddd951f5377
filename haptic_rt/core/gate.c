/* The sender filter of a channel: one session at a time, in order of seq and clock. */
#include "gate.h"

static const char *const verdict_text[HRT_GATE_VERDICT_COUNT] = {
    "accepted",
    "accepted, a new session",
    "its seq was sent before",
    "its seq is older than the newest; any seq is accepted after a second of silence",
    "its clock went backwards within its session; any time is accepted after a second of silence",
    "another session is sending; this one is accepted a second after the other's last message",
    "another session is in use; this one is accepted when that has ended",
};

const char *hrt_gate_text(hrt_gate_verdict verdict) {
    return (int)verdict >= 0 && verdict < HRT_GATE_VERDICT_COUNT ? verdict_text[verdict] : "unknown";
}

static hrt_gate_verdict judge(const hrt_gate *gate, int64_t now_us, bool pinned, const hrt_gate_mark *mark) {
    if (!gate->known) return HRT_GATE_NEW_SESSION;
    const bool same = mark->session == gate->last.session;
    if (!same && pinned) return HRT_GATE_PINNED;
    if (!pinned && now_us - gate->heard_us >= HRT_GATE_SILENCE_US)
        return same ? HRT_GATE_ACCEPTED : HRT_GATE_NEW_SESSION;
    if (!same) return HRT_GATE_FOREIGN;
    const uint32_t step = mark->seq - gate->last.seq; /* at least half the range: backwards */
    if (step == 0u) return HRT_GATE_REPEATED;
    if (step > UINT32_MAX / 2u) return HRT_GATE_LATE;
    return mark->utime < gate->last.utime ? HRT_GATE_CLOCK_BACK : HRT_GATE_ACCEPTED;
}

hrt_gate_verdict hrt_gate_accept(hrt_gate *gate, int64_t now_us, bool pinned, const hrt_gate_mark *mark) {
    const hrt_gate_verdict verdict = judge(gate, now_us, pinned, mark);
    if (!hrt_gate_open(verdict)) return verdict;
    gate->known = true;
    gate->last = *mark;
    gate->heard_us = now_us;
    return verdict;
}
