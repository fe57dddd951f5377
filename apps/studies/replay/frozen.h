/* SOFA's way to render force between frames: the last contact problem with frozen directions, solved again at every
 * tick. */
#ifndef TM_FROZEN_H
#define TM_FROZEN_H

#include "hrt.h"

typedef struct frozen {
    hrt_sample now;
    bool known; /* there is a problem */
    bool holds;
    int rows;
    hrt_contact_row row[HRT_CONTACT_ROWS];
    double w[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS]; /* m/N along the rows */
    double gap_m[HRT_CONTACT_ROWS];               /* at the sample, without reactions */
    double skin[HRT_CONTACT_ROWS], soft_m;        /* m/N, and how far it is soft */
    bool hard[HRT_CONTACT_ROWS];
    double lambda_N[HRT_CONTACT_ROWS], cap_N, radius_m;
    double hold[HRT_CONTACT_ROWS][3]; /* how a row's gap follows the tip of a hold, m/m, and its reaction pulls on it */
    double rest_N[3], stiffness[9];   /* of the hold */
    double rest_of_it_N[3];           /* of the sample's force what the problem does not give */
} frozen;

/* Takes a sample; its patch may change afterwards. */
void frozen_sample(frozen *z, const hrt_params *params, const hrt_sample *sample);
/* Force on the tool at `tip_m`, N. */
void frozen_force(frozen *z, const float tip_m[3], float force_N[3]);

#endif
