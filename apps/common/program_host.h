/* Host of a program that loads scenes. The scene reader's messages go to stderr, models report their progress, and a
 * signal ends a frame. */
#ifndef TM_PROGRAM_HOST_H
#define TM_PROGRAM_HOST_H

#include "app.h"
#include "scene/host.h"

/* Returns the host for sim_scene_load. It stays valid until the program ends. */
const app_host *app_program_host(void);

/* Reports the progress of a model that a program computes itself on stderr. Returns false if the user stopped it. */
bool app_solve_progress(void *user, const char *what, double fraction, double seconds_left);
/* Stops computations whose estimated time exceeds this, from now on; INFINITY: none. */
void app_solve_allow(double seconds);
double app_solve_beyond(void); /* estimated time that the stopped computation still needed, s; 0: none stopped */

#endif
