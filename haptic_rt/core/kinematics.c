/* The device's geometry for the tick: engine.h in `float`. */
#include "internal.h"

/* Our own, so that every machine makes the same bits of it. Error below 1.5e-7 for |angle| < 1000; quarter turns are
 * taken off in three pieces, then Taylor's series economised on +-pi/4. */
static void sine_cosine(float angle, float *sine, float *cosine) {
    const float x = hrt_clamp(angle, -1000.0f, 1000.0f);
    const int32_t quarter = (int32_t)(0.636619772f * x + (x < 0.0f ? -0.5f : 0.5f));
    const float turns = (float)quarter;
    const float r = ((x - turns * 1.5703125f) - turns * 4.837512969970703125e-4f) - turns * 7.549790126404332e-8f;
    const float r2 = r * r;
    const float s = r + r * r2 * (-1.6666654611e-1f + r2 * (8.3321608736e-3f + r2 * -1.9515295891e-4f));
    const float c = 1.0f - 0.5f * r2 +
                    r2 * r2 * (4.166664568298827e-2f + r2 * (-1.388731625493765e-3f + r2 * 2.443315711809948e-5f));
    const bool swap = (quarter & 1) != 0;
    *sine = (swap ? c : s) * ((quarter & 2) != 0 ? -1.0f : 1.0f);
    *cosine = (swap ? s : c) * (((quarter + 1) & 2) != 0 ? -1.0f : 1.0f);
}

#define HRT_REAL float
#define HRT_AXES hrt_axes
#define HRT_KINEMATICS(name) hrt_##name
#define HRT_SQRT sqrtf
#define HRT_ASIN asinf
#define HRT_ATAN2 atan2f
#define HRT_SINE_COSINE sine_cosine
#define HRT_SIZE_MIN 1.0e-6f
#define HRT_SIZE_MAX 1.0e6f
#include "engine.h"
