/* Removal of tetrahedra. Exact: after any sequence, tensors, masses, surface and forces equal a fresh build of what is left, bit for bit. */
#ifndef TENSORMASS_CUT_H
#define TENSORMASS_CUT_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Removes the listed tetrahedra (living ones; dead ones are skipped) and then whatever must go to leave the mesh conformal and
 * manifold. Needs def.cuttable. No allocation. Returns how many were removed in all. `removed` (may be null) receives their indices. */
TM_API int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed, int32_t removed_max);

typedef enum tm_cut_loose { TM_LOOSE_FALL = 0, TM_LOOSE_REMOVE = 1 } tm_cut_loose;

typedef struct tm_cut_def {
    uint32_t cookie;
    double rate_1_s;      /* tetrahedra per second that one cautery may remove */
    tm_cut_loose loose;   /* pieces without a support */
} tm_cut_def;
TM_API tm_cut_def tm_cut_def_default(void);
/* Adds the "cut" stage: cautery instruments of `contact` remove what they touch. */
TM_API tm_status tm_stage_cut(tm_world *world, tm_contact *contact, const tm_cut_def *def, tm_error *error);

/* Snapshot of everything a world needs to go on with the same bits (state, living tetrahedra, contact, grasps). */
TM_API int64_t tm_snapshot_bytes(const tm_world *world);
TM_API tm_status tm_snapshot_save(const tm_world *world, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_snapshot_restore(tm_world *world, const void *buffer, int64_t bytes, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
