/* Cauteries that remove what they touch. The removal itself is the tissue's (tm_cut_remove, tissue.h). */
#ifndef TENSORMASS_CUT_H
#define TENSORMASS_CUT_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tm_cut_loose { TM_LOOSE_FALL = 0, TM_LOOSE_REMOVE = 1 } tm_cut_loose;

typedef struct tm_cut_def {
    uint32_t cookie, size;
    double rate_1_s;    /* tetrahedra per second that one cautery may remove; 200 */
    tm_cut_loose loose; /* pieces that hang on no support and no grasper; TM_LOOSE_FALL: until they are out of sight,
                           then removed */
    double fade_s;      /* what instruments felt on a tetrahedron that the stage removes fades within this time; 0: at
                           once */
} tm_cut_def;
TM_API tm_cut_def tm_cut_def_default(void);
/* Adds the "cut" stage: active cautery instruments of `contact` remove what they touch. Detached fragments are looked
 * for a little each step, so they are noticed some frames after the cut. Refuses (TM_ERR_ARGUMENT) a tissue that is not
 * cuttable, a rate not above 0, a fade below 0; TM_ERR_EXCLUDED: a fade where a hybrid model solves contact. */
TM_API tm_status tm_stage_cut(tm_world *world, tm_contact *contact, const tm_cut_def *def, tm_error *error);
/* What the "cut" stage has removed since the last call, oldest first, at most `max`; the rest waits. `instrument` (may
 * be null): who cut, repairing included, or -1 for a detached fragment. Returns how many. */
TM_API int32_t tm_cut_fetch_removed(tm_world *world, int32_t *tet, int8_t *instrument, int32_t max);

#ifdef __cplusplus
}
#endif
#endif
