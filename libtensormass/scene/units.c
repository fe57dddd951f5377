/* Numbers with units, in one table. All values inside the programs are SI. */
#include "units.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct unit {
    const char *dimension, *name;
    double factor;
} unit;

/* The first unit of a dimension is SI; it applies to a number without a unit. */
static const unit units[] = {
    {"pressure", "Pa", 1},
    {"pressure", "kPa", 1e3},
    {"pressure", "MPa", 1e6},
    {"pressure", "GPa", 1e9},
    {"pressure", "N/m2", 1},
    {"pressure", "mmHg", 133.322387415},
    {"length", "m", 1},
    {"length", "cm", 1e-2},
    {"length", "mm", 1e-3},
    {"length", "um", 1e-6},
    {"angle", "rad", 1},
    {"angle", "mrad", 1e-3},
    {"angle", "deg", M_PI / 180},
    {"density", "kg/m3", 1},
    {"density", "g/cm3", 1e3},
    {"density", "g/ml", 1e3},
    {"force", "N", 1},
    {"force", "mN", 1e-3},
    {"force", "kN", 1e3},
    {"time", "s", 1},
    {"time", "ms", 1e-3},
    {"time", "us", 1e-6},
    {"time", "min", 60},
    {"rate", "1/s", 1},
    {"rate", "/s", 1},
    {"rate", "Hz", 1},
    {"rate", "kHz", 1e3},
    {"mass", "kg", 1},
    {"mass", "g", 1e-3},
    {"acceleration", "m/s2", 1},
    {"acceleration", "cm/s2", 1e-2},
    {"velocity", "m/s", 1},
    {"velocity", "cm/s", 1e-2},
    {"velocity", "mm/s", 1e-3},
    {"compliance", "m/N", 1},
    {"compliance", "mm/N", 1e-3},
    {"stiffness", "N/m", 1},
    {"stiffness", "N/mm", 1e3},
    {"stiffness", "kN/m", 1e3},
    {"none", "", 1},
    {"none", "%", 1e-2},
};
enum { UNIT_COUNT = sizeof units / sizeof units[0] };

static const char *article(const char *word) { return strchr("aeiou", word[0]) ? "an" : "a"; }

/* "Pa, kPa, MPa" */
static void list_units(const char *dimension, char *out, size_t size) {
    size_t used = 0;
    out[0] = 0;
    for (int i = 0; i < UNIT_COUNT; i++)
        if (!strcmp(units[i].dimension, dimension) && units[i].name[0] && used < size)
            used += (size_t)snprintf(out + used, size - used, "%s%s", used ? ", " : "", units[i].name);
}

static bool same_unit(const char *a, const char *name) {
    /* "kg/m^3" is "kg/m3" */
    for (; *a && *name; a++) {
        if (*a == '^') continue;
        if (*a != *name++) return false;
    }
    return !*a && !*name;
}

static bool find_unit(const char *text, const char *dimension, double *factor, char *why, int why_size) {
    const char *other = NULL;
    for (int i = 0; i < UNIT_COUNT; i++) {
        if (!same_unit(text, units[i].name)) continue;
        if (!strcmp(units[i].dimension, dimension)) {
            *factor = units[i].factor;
            return true;
        }
        if (!other) other = units[i].dimension;
    }
    char known[160];
    list_units(dimension, known, sizeof known);
    for (int i = 0; i < UNIT_COUNT; i++)
        if (!strcmp(units[i].dimension, dimension) && !strcasecmp(text, units[i].name)) {
            snprintf(why, (size_t)why_size, "unknown unit '%s'; did you mean '%s'?", text, units[i].name);
            return false;
        }
    if (!strcmp(dimension, "none"))
        snprintf(why, (size_t)why_size, "'%s' is a unit, and a number without unit is expected; leave it out", text);
    else if (other)
        snprintf(why, (size_t)why_size, "'%s' is %s %s where %s %s is expected; write it in %s", text, article(other),
                 other, article(dimension), dimension, known);
    else
        snprintf(why, (size_t)why_size, "unknown unit '%s'; %s %s is written in %s", text, article(dimension),
                 dimension, known);
    return false;
}

bool app_parse_quantity(const char *text, const char *dimension, double *si, char *why, int why_size) {
    while (isspace((unsigned char)*text)) ++text;
    const char *digits = text + strspn(text, "+-");
    char *end = NULL;
    double value = strtod(text, &end);
    bool plain = (isdigit((unsigned char)*digits) || *digits == '.') && !(digits[0] == '0' && (digits[1] | 32) == 'x');
    if (end == text || !plain) {
        snprintf(why, (size_t)why_size, "'%.60s' is not a number; write a number with or without a unit, such as %s",
                 text,
                 !strcmp(dimension, "pressure") ? "5 kPa"
                 : !strcmp(dimension, "length") ? "3 mm"
                 : !strcmp(dimension, "angle")  ? "30 deg"
                                                : "0.5");
        return false;
    }
    if (!isfinite(value)) {
        snprintf(why, (size_t)why_size, "'%.60s' is not finite; write a number that a double can hold", text);
        return false;
    }
    if (*end == ',' && isdigit((unsigned char)end[1])) {
        snprintf(why, (size_t)why_size, "'%.60s' has a decimal comma; write a point: %.*s.%.40s", text,
                 (int)(end - text), text, end + 1);
        return false;
    }
    while (isspace((unsigned char)*end)) ++end;
    char name[32];
    size_t length = strlen(end);
    while (length && isspace((unsigned char)end[length - 1])) --length;
    if (length >= sizeof name) length = sizeof name - 1;
    memcpy(name, end, length);
    name[length] = 0;
    double factor = 1;
    if (length && !find_unit(name, dimension, &factor, why, why_size)) return false;
    *si = value * factor;
    return true;
}
