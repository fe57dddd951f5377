/* Published constants of human tissues, found by what a region is called. */
#ifndef SCENE_TISSUES_H
#define SCENE_TISSUES_H

#include <stdbool.h>

typedef enum tissue_role {
    TISSUE_SOFT,
    TISSUE_TUMOUR, /* what the first press looks for */
    TISSUE_VESSEL, /* holds an organ where it leaves it */
    TISSUE_BONE    /* held whole */
} tissue_role;

typedef struct tissue_constants {
    const char *name, *words; /* beginnings of words; "rib." is the whole word */
    tissue_role role;
    double young_Pa, poisson, density_kg_m3;
    const char *source; /* of Young's modulus, a line of text */
} tissue_constants;

/* By the first row whose words the name has, in lower case, "_" between words or not. Null: in no row. */
const tissue_constants *tissue_find(const char *name);
/* What stands for a region that is in no row. */
extern const tissue_constants tissue_unknown;
/* Where all densities are from. */
extern const char tissue_density_source[];
/* The table, a row at a time; null after the last. */
const tissue_constants *tissue_row(int index);

#endif
