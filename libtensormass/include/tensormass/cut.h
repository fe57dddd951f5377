/* Removal of tetrahedra. Exact: after any sequence, tensors, masses, surface and forces equal a fresh build of what is
 * left, bit for bit. */
#ifndef TENSORMASS_CUT_H
#define TENSORMASS_CUT_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Removes the listed tetrahedra (living ones; dead ones are skipped) and then whatever must go to leave the mesh
 * conformal and manifold: fans that hang by an edge or a vertex (the largest fan stays), rings about a vertex (cut
 * open). Needs def.cuttable. A world notices at its next tm_world_step. No allocation. Returns how many were removed in
 * all. `removed` (may be null) receives their indices. */
TM_API int32_t tm_cut_remove(tm_tissue *tissue, const int32_t *tet, int32_t count, int32_t *removed,
                             int32_t removed_max);

typedef enum tm_cut_loose { TM_LOOSE_FALL = 0, TM_LOOSE_REMOVE = 1 } tm_cut_loose;

typedef struct tm_cut_def {
    uint32_t cookie, size;
    double rate_1_s;    /* tetrahedra per second that one cautery may remove; 200 */
    tm_cut_loose loose; /* pieces that hang on no support and no grasper; TM_LOOSE_FALL: until they are out of sight,
                           then removed */
} tm_cut_def;
TM_API tm_cut_def tm_cut_def_default(void);
/* Adds the "cut" stage: active cautery instruments of `contact` remove what they touch. Loose pieces are looked for a
 * little each step, so they are noticed some frames after the cut. Refuses (TM_ERR_ARGUMENT) a tissue that is not
 * cuttable, a rate not above 0. */
TM_API tm_status tm_stage_cut(tm_world *world, tm_contact *contact, const tm_cut_def *def, tm_error *error);
/* What the "cut" stage has removed since the last call, oldest first, at most `max`; the rest waits. `instrument` (may
 * be null): who cut, mending included, or -1 for a loose piece. Returns how many. */
TM_API int32_t tm_cut_take(tm_world *world, int32_t *tet, int8_t *instrument, int32_t max);

/* Snapshot of everything a world needs to go on with the same bits (state, living tetrahedra, contact, grasps), for the
 * same build of the library on the same kind of machine, and a world set up from the same scene. Bytes are checksummed;
 * a foreign, damaged or truncated snapshot is refused (TM_ERR_FILE) and the world left as it was; one of another mesh
 * or other stages too (TM_ERR_ARGUMENT). `buffer` is aligned to 8 bytes. */
TM_API int64_t tm_snapshot_bytes(const tm_world *world);
TM_API tm_status tm_snapshot_save(const tm_world *world, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_snapshot_restore(tm_world *world, const void *buffer, int64_t bytes, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
