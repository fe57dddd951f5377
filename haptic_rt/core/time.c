/* Times are int64, their differences float. By 32 bits, which every processor converts by itself: no software floating
 * point. */
#include "internal.h"

float hrt_us(int64_t us) { return (float)(int32_t)(us > INT32_MAX ? INT32_MAX : us < -INT32_MAX ? -INT32_MAX : us); }
