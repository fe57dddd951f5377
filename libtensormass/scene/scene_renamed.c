/* Keys and choices of version 0.1 that were renamed in 0.2; the error for an old name gives the new one. */
#include <string.h>

#include "scene_reader.h"

static const struct {
    const char *old, *now; /* full path, or path=choice */
} row[] = {
    {"contact.skin", "compliance"},
    {"friction.sliding", "kinetic"},
    {"instruments[].friction.sliding", "kinetic"},
    {"grasp.fade", "release_time"},
    {"time.mass_most", "mass_scaling_max"},
    {"volume", "strain_smoothing"},
    {"strain_smoothing.shear", "shear_share"},
    {"viscosity.terms[].volume", "bulk"},
    {"haptics.extrapolator=contact", "local_model"},
};

const char *app_scene_renamed(const char *path) {
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++)
        if (!strcmp(row[i].old, path)) return row[i].now;
    return NULL;
}
