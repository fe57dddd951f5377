/* The controller's stated rule for everything that the simulation may say of a sample (docs/controller.md). */
#include "internal.h"

static const struct {
    uint32_t flag;
    hrt_flag_rule rule;
} rows[] = {
    {HRT_FLAG_CAPPED, HRT_RULE_TAKE},            /* the cap is the contact law's own, far above the device's */
    {HRT_FLAG_OVERFLOWED, HRT_RULE_FORCE_ONLY},  /* rows are missing in stiffness and patch */
    {HRT_FLAG_OVERRAN, HRT_RULE_TAKE},           /* t_n tells the age */
    {HRT_FLAG_PATCH, HRT_RULE_TAKE},             /* a patch that did not come is missed by itself */
    {HRT_FLAG_UNCONVERGED, HRT_RULE_FORCE_ONLY}, /* derivatives are worse than the force that they are of */
    {HRT_FLAG_HELD_OVER, HRT_RULE_NOT_FRESH},    /* an old force at a new place would bend every estimate */
    {HRT_FLAG_UNSTABLE, HRT_RULE_FADE},          /* there is no reaction */
    {HRT_FLAG_TOO_FAST, HRT_RULE_FORCE_ONLY},    /* contact may have been missed on the way */
    {HRT_FLAG_INSIDE, HRT_RULE_FORCE_ONLY},      /* touches nothing: a patch would push it out */
};

hrt_flag_rule hrt_flags_rule(uint32_t flags) {
    hrt_flag_rule rule = HRT_RULE_TAKE;
    for (size_t k = 0; k < sizeof rows / sizeof *rows; k++) {
        if ((flags & rows[k].flag) == 0u) continue;
        flags &= ~rows[k].flag;
        if (rows[k].rule > rule) rule = rows[k].rule;
    }
    return flags == 0u ? rule : HRT_RULE_REFUSE;
}
