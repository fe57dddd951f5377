/* The controller's rule for each flag of a sample (docs/controller.md). */
#include "internal.h"

static const uint16_t flags_of[HRT_RULE_REFUSE] = {
    /* The cap is the contact law's own, far above the device's. t_n gives the age after an overrun. A missing patch is
       detected by itself. evidence.c handles the cautery's next cut. */
    [HRT_RULE_TAKE] = HRT_FLAG_CAPPED | HRT_FLAG_OVERRAN | HRT_FLAG_PATCH | HRT_FLAG_CUTTING,
    /* Rows are missing in stiffness and patch. Derivatives are less accurate than an unconverged force. A fast tool may
       have missed contact. A patch would push out a tool inside the tissue without contact. While jaws open, the force
       falls without motion. */
    [HRT_RULE_FORCE_ONLY] =
        HRT_FLAG_OVERFLOWED | HRT_FLAG_UNCONVERGED | HRT_FLAG_TOO_FAST | HRT_FLAG_INSIDE | HRT_FLAG_RELEASING,
    /* An old force at a new position would corrupt every estimate. */
    [HRT_RULE_NOT_FRESH] = HRT_FLAG_REPEATED,
    /* There is no reaction. */
    [HRT_RULE_FADE] = HRT_FLAG_UNSTABLE,
};

hrt_flag_rule hrt_flags_rule(uint32_t flags) {
    if (flags >= 2u * HRT_FLAG_CUTTING) return HRT_RULE_REFUSE;
    int rule = HRT_RULE_FADE;
    while (rule > HRT_RULE_TAKE && (flags & flags_of[rule]) == 0u) rule--;
    return (hrt_flag_rule)rule;
}
