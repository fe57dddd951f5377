/* Internals of the precomputed model, shared by precomputed*.c and precomputed_patch.c. */
#ifndef TMS_PRECOMPUTED_H
#define TMS_PRECOMPUTED_H

#include "contact_solver.h"

enum { TMS_FELT = TM_PATCH_VERTICES + TM_GRASP_VERTICES };

struct tm_precomputed {
    const tm_tissue *tissue;
    tms_responses responses;
    int32_t *kept_index; /* [3*vertex_count] column of a component, -1 */
    int32_t *surface;    /* [surface_count] vertices with responses, ascending */
    int32_t surface_count;
    double *sum; /* [kept_count] superposition */
    bool superposed;
    tms_contact_solver solver;
    double *yield; /* [3*TMS_FELT][3*capacity] for a patch: forces of the other tools per force on its vertices and on
                    * those that its tool grasps; null: no contact */
    tm_patch_solver *patch_solver; /* null: no grasp */
};

/* Computes the 3x3 block of vertex a for forces on vertex b; `self` is the model. */
void tms_precomputed_compliance(void *self, int32_t a, int32_t b, double C[9]);

/* precomputed_snapshot.c: returns the bytes, and writes them to `buffer` unless it is null. Restores all or nothing. */
int64_t tms_precomputed_snapshot(const tm_precomputed *model, void *buffer);
/* Maximum size of a snapshot, for any contact and grasp. */
int64_t tms_precomputed_snapshot_max(const tm_precomputed *model);
tm_status tms_precomputed_restore(tm_precomputed *model, const void *buffer, int64_t bytes, tm_error *error);

#endif
