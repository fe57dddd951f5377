/* Names of the modes of an instrument. */
#include "mode.h"

#include "internal.h"

#define NAME_OF(mode, name) name,
static const char *const names[HRT_MODE_COUNT] = {HRT_MODES(NAME_OF)};

const char *hrt_mode_name(hrt_mode mode) { return (int)mode >= 0 && mode < HRT_MODE_COUNT ? names[mode] : "?"; }

bool hrt_mode_find(const char *name, hrt_mode *mode) {
    for (int m = 0; m < HRT_MODE_COUNT; m++) {
        if (!hrt_same_name(names[m], name)) continue;
        *mode = (hrt_mode)m;
        return true;
    }
    return false;
}
