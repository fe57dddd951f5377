/* Published constants of human tissues, found by a region's name. */
#ifndef SCENE_TISSUES_H
#define SCENE_TISSUES_H

#include <stdbool.h>

typedef enum tissue_role {
    TISSUE_SOFT,
    TISSUE_TUMOUR, /* the first instrument presses above it */
    TISSUE_VESSEL, /* holds an organ where the vessel leaves it */
    TISSUE_BONE    /* fixed completely */
} tissue_role;

typedef struct tissue_constants {
    const char *name, *words; /* beginnings of words; "rib." matches the complete word only */
    tissue_role role;
    double young_Pa, poisson, density_kg_m3;
    const char *source; /* source of Young's modulus, one line */
} tissue_constants;

/* Returns the first row with a word that occurs in the name, in lower case, with or without "_" between words. Returns
 * null if no row matches. */
const tissue_constants *tissue_find(const char *name);
/* Constants for a region that matches no row. */
extern const tissue_constants tissue_unknown;
/* Source of all densities. */
extern const char tissue_density_source[];
/* Returns a row of the table, or null after the last. */
const tissue_constants *tissue_row(int index);

/* Constants of a nonlinear law for one tissue or silicone. */
typedef struct tissue_large {
    const char *name, *species;
    const char *material; /* value of tissue.materials.NAME */
    double stretch;       /* uniaxial, up to which the source holds */
    const char *source;
} tissue_large;
/* Returns a row of their table, or null after the last. */
const tissue_large *tissue_large_row(int index);

#endif
