/* Numbers with units, as users write them. */
#ifndef TM_UNITS_H
#define TM_UNITS_H

#include <stdbool.h>

/* Parses a number with an optional unit to SI: "5 kPa", "3 mm", "30 deg", "0.003". `dimension` is one of the strings of
 * units.c: "pressure" "length" "angle" "density" "force" "time" "rate" "mass" "acceleration" "velocity" "compliance"
 * "stiffness" "none". */
bool app_parse_quantity(const char *text, const char *dimension, double *si, char *why, int why_size);

#endif
