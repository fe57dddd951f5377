/* SOFA's method to render force between frames: the last contact problem with fixed directions, solved again at every
 * tick. */
#ifndef TM_FROZEN_H
#define TM_FROZEN_H

#include "hrt.h"

typedef struct frozen {
    hrt_sample now;
    bool known; /* a contact problem is stored */
    bool holds;
    int rows;
    hrt_contact_row row[HRT_CONTACT_ROWS];
    double w[HRT_CONTACT_ROWS][HRT_CONTACT_ROWS]; /* Delassus matrix along the rows, m/N */
    double gap_m[HRT_CONTACT_ROWS];               /* at the sample, without reactions */
    double row_compliance_m_N[HRT_CONTACT_ROWS],
        soft_m; /* contact compliance, m/N, and the depth up to which it holds */
    bool hard[HRT_CONTACT_ROWS];
    double lambda_N[HRT_CONTACT_ROWS], cap_N, radius_m;
    double hold[HRT_CONTACT_ROWS][3]; /* change of a row's gap per tip motion in a grasp, m/m; the row's reaction acts
                                         on the tip by its transpose */
    double rest_N[3], stiffness[9];   /* of the grasp */
    double rest_of_it_N[3];           /* part of the sample's force that the problem does not explain */
} frozen;

/* Stores a sample; its patch may change afterwards. */
void frozen_sample(frozen *z, const hrt_params *params, const hrt_sample *sample);
/* Computes the force on the tool at `tip_m`, N. */
void frozen_force(frozen *z, const float tip_m[3], float force_N[3]);

#endif
