/* The source of exact compliance behind the patch stage of a dynamic scene. */
#ifndef TM_SIM_EXACT_H
#define TM_SIM_EXACT_H

#include "sim.h"

/* 0 or an exit code, having blamed the scene's line. */
int sim_exact_open(sim *s, int line, tm_compliance_source *source);
/* Real time: from now on it works in a thread of its own. Nothing to do where there is none. */
int sim_exact_start(sim *s);
void sim_exact_close(sim *s);

#endif
