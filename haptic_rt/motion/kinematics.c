/* The device's geometry for simulation and virtual device: core/engine.h in `double`. */
#include "kinematics.h"

#include <math.h>

static void sine_cosine(double angle, double *sine, double *cosine) {
    *sine = sin(angle);
    *cosine = cos(angle);
}

#define HRT_REAL double
#define HRT_AXES hrt_axes64
#define HRT_KINEMATICS(name) hrt_##name##64
#define HRT_SQRT sqrt
#define HRT_ASIN asin
#define HRT_ATAN2 atan2
#define HRT_SINE_COSINE sine_cosine
#define HRT_SIZE_MIN 1.0e-100
#define HRT_SIZE_MAX 1.0e100
#include "engine.h"
