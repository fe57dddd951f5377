/* Checks messages and lays them into the picture. Every message is untrusted. */
#ifndef VIEW_INTAKE_H
#define VIEW_INTAKE_H

#include "feed.h"

typedef struct view_intake {
    view_feed_counts counts;
    struct controller_memory {
        int64_t session, utime, ticks;
        double heard_s;
    } controller[VIEW_INSTRUMENTS];
    double tissue_s, status_s; /* when last heard, on the picture's clock; negative: never */
} view_intake;

void view_intake_begin(view_intake *intake);
/* `time_s` is the picture's clock. Channels that mean nothing here are passed over. */
void view_intake_message(view_intake *intake, view_picture *picture, double time_s, const char *channel,
                         const void *data, int size);
/* Forgets controllers gone silent and says what is waited for. Call before drawing. */
void view_intake_age(view_intake *intake, view_picture *picture, double time_s);

#endif
