/* Converts time differences, int64, to float through 32 bits: every processor converts these in hardware. */
#include "internal.h"

float hrt_us(int64_t us) { return (float)(int32_t)(us > INT32_MAX ? INT32_MAX : us < -INT32_MAX ? -INT32_MAX : us); }
