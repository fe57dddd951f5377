/* From messages to what the core takes, which knows no LCM and no double: the only place where this is done, for
 * controller, lockstep, replay and recordings alike. Messages are not trusted; what is made of one goes to the tick
 * when hrt_sample_check or hrt_patch_prepare accepts it, never before. */
#ifndef HRT_FROM_MESSAGE_H
#define HRT_FROM_MESSAGE_H

#include "hrt.h"
#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_force_sample_t.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Positions become relative to trocar_m (m, world); a grasper's force may pull. The patch is the caller's to set. */
hrt_reject hrt_sample_from_message(const tensormass_force_sample_t *message, const double trocar_m[3], bool unilateral,
                                   const hrt_params *params, hrt_sample *sample);
/* `scratch`: for the checks. */
hrt_reject hrt_patch_from_message(const tensormass_contact_patch_t *message, const double trocar_m[3],
                                  float scratch[HRT_PATCH_COMPLIANCE], hrt_patch *patch);

#ifdef __cplusplus
}
#endif
#endif
