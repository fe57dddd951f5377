/* Events of a grasper's jaws: closing, holding and releasing. */
#ifndef LAW_JAW_H
#define LAW_JAW_H

#include <stdbool.h>

typedef enum law_jaw_event {
    LAW_JAW_STAYS,
    LAW_JAW_CLOSES, /* on the tissue that is there now, also while releasing */
    LAW_JAW_OPENS,
    LAW_JAW_FADES /* continues releasing */
} law_jaw_event;

/* Returns the next event and updates `was_closed`. A grip rising to close_grip closes, falling to open_grip opens;
 * between the two the state is kept. An absent tool is open. */
static inline law_jaw_event law_jaw_work(bool *was_closed, bool holding, bool releasing, bool active, double grip,
                                         double close_grip, double open_grip) {
    const bool closed = active && (*was_closed ? grip > open_grip : grip >= close_grip);
    const bool closing = closed && !*was_closed;
    *was_closed = closed;
    if (closing && !holding) return LAW_JAW_CLOSES;
    if (holding) return closed ? LAW_JAW_STAYS : LAW_JAW_OPENS;
    return releasing ? LAW_JAW_FADES : LAW_JAW_STAYS;
}

/* Returns the force limit of the grasp springs relative to their force at opening: 1 at first, 0 after fade_s. */
static inline double law_jaw_fade(double fade, double passed_s, double fade_s) {
    const double left = fade - passed_s / (fade_s > passed_s ? fade_s : passed_s);
    return left > 0 ? left : 0;
}

#endif
