/* Converts messages to the core's structs; the core uses neither LCM nor double. Controller, lockstep, replay and
 * recordings all convert here. Messages are not trusted: only data accepted by hrt_sample_check or hrt_patch_prepare
 * reach the tick. */
#ifndef HRT_FROM_MESSAGE_H
#define HRT_FROM_MESSAGE_H

#include "hrt.h"
#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_force_sample_t.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Converts a sample. Positions become relative to trocar_m (m, world). unilateral: false for a grasper, whose force may
 * pull. The caller sets the patch. */
hrt_reject hrt_sample_from_message(const tensormass_force_sample_t *message, const double trocar_m[3], bool unilateral,
                                   const hrt_params *params, hrt_sample *sample);
/* Converts and checks a patch; `scratch` is memory for the checks. */
hrt_reject hrt_patch_from_message(const tensormass_contact_patch_t *message, const double trocar_m[3],
                                  float scratch[HRT_PATCH_COMPLIANCE], hrt_patch *patch);

#ifdef __cplusplus
}
#endif
#endif
