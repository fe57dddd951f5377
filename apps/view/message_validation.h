/* Validates messages and stores them in the picture. Every message is untrusted. */
#ifndef VIEW_INTAKE_H
#define VIEW_INTAKE_H

#include "lcm_types/tensormass_controller_status_t.h"
#include "lcm_types/tensormass_sim_status_t.h"
#include "lcm_types/tensormass_tissue_t.h"
#include "message_source.h"

typedef struct view_intake {
    view_feed_counts counts;
    struct controller_memory {
        int64_t session, utime, ticks;
        double heard_s;
    } controller[VIEW_INSTRUMENTS];
    double tissue_s, status_s; /* time of the last message, on the picture's clock; negative: none yet */
} view_intake;

void view_intake_begin(view_intake *intake);
/* Store one message each. `time_s` is on the picture's clock. The messages are well-formed; their values are still
 * unchecked. */
void view_intake_tissue(view_intake *intake, view_picture *picture, double time_s, const tensormass_tissue_t *message);
void view_intake_status(view_intake *intake, view_picture *picture, double time_s,
                        const tensormass_sim_status_t *message);
void view_intake_controller(view_intake *intake, view_picture *picture, double time_s, int instrument,
                            const tensormass_controller_status_t *message);
/* Counts a refused message and stores the reason. */
__attribute__((format(printf, 3, 4))) void view_intake_refuse(view_intake *intake, const char *channel,
                                                              const char *format, ...);
/* Drops silent controllers and sets the notice of what the picture waits for. Call before drawing. */
void view_intake_age(view_intake *intake, view_picture *picture, double time_s);

#endif
