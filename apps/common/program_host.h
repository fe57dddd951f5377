/* A program around scenes: what their reader has to say goes to stderr as it comes, models show how far they are, and a
 * signal ends a frame. */
#ifndef TM_PROGRAM_HOST_H
#define TM_PROGRAM_HOST_H

#include "app.h"
#include "scene/host.h"

/* For sim_scene_load. Valid for ever. */
const app_host *app_program_host(void);

/* For models that a program computes itself: says on stderr how far it is; stops where the user did. */
bool app_solve_progress(void *user, const char *what, double fraction, double seconds_left);
/* From now on what would take longer than that is stopped, by its own estimate; INFINITY: nothing is. */
void app_solve_allow(double seconds);
double app_solve_beyond(void); /* what that would have taken more; 0: nothing was stopped */

#endif
