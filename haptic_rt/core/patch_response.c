/* Response of a patch's node to forces: the innermost loop of `local_model` and its friction. */
#include "internal.h"

void hrt_patch_respond(const hrt_patch *patch, uint32_t a, const uint8_t *b, const law_v3 *x, int32_t count,
                       float *shift_m) {
    const uint32_t n = 3u * (uint32_t)hrt_patch_nodes(patch);
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    for (; count > 0; count--, b++, x++) {
        const uint32_t i = 3u * (a < *b ? a : *b), j = 3u * (a + *b) - i, after = n - i - 1u;
        const float *p = &patch->compliance_m_N[i * (n + after) / 2u + j], *q = p + after, *r = q + after - 1;
        const law_v3 u = vget(p);
        law_v3 v = vget(q), w = vget(r);
        if (a == *b) v.x = u.y, w.x = u.z, w.y = v.z;
        if (a > *b)
            sum = vplus(vplus(vplus(sum, vtimes(x->x, u)), vtimes(x->y, v)), vtimes(x->z, w));
        else
            sum = vplus(sum, (law_v3){vinner(u, *x), vinner(v, *x), vinner(w, *x)});
    }
    vput(sum, &shift_m[HRT_XYZ * (ptrdiff_t)a]);
}
