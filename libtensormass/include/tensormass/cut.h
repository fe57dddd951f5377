/* Cauteries that remove tetrahedra on contact. The tissue does the removal (tm_cut_remove, tissue.h). */
#ifndef TENSORMASS_CUT_H
#define TENSORMASS_CUT_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tm_cut_loose { TM_LOOSE_FALL = 0, TM_LOOSE_REMOVE = 1 } tm_cut_loose;

typedef struct tm_cut_def {
    uint32_t cookie, size;
    double rate_1_s;     /* maximum removal rate of one cautery, tetrahedra per second; 200 */
    tm_cut_loose loose;  /* treatment of fragments without support or grasper; TM_LOOSE_FALL: they fall, and are removed
                            once out of sight */
    double fade_s;       /* release time of an instrument's force on a tetrahedron that the stage removes; 0: at once */
    const uint8_t *keep; /* [tet_count] 1: cauteries do not remove this tetrahedron; copied; null: none */
} tm_cut_def;
TM_API tm_cut_def tm_cut_def_default(void);
/* Adds the stage "cut": active cautery instruments of `contact` remove what they touch. The search for detached
 * fragments is spread over steps, so they are found some frames after the cut. TM_ERR_ARGUMENT: a tissue that is not
 * cuttable, a rate not above 0, a fade below 0. TM_ERR_EXCLUDED: a fade where a hybrid model solves contact. */
TM_API tm_status tm_stage_cut(tm_world *world, tm_contact *contact, const tm_cut_def *def, tm_error *error);
/* Fetches the tetrahedra that the stage has removed since the last call, oldest first, at most `max`; the rest stays
 * queued. `instrument` (may be null): the one that cut, manifold repair included; -1: a detached fragment. Returns the
 * count. */
TM_API int32_t tm_cut_fetch_removed(tm_world *world, int32_t *tet, int8_t *instrument, int32_t max);

#ifdef __cplusplus
}
#endif
#endif
