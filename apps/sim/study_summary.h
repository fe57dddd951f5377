/* Results of tm-accuracy --scene for a scene, for tm-sim --explain. */
#ifndef TM_SIM_EXPECTED_H
#define TM_SIM_EXPECTED_H

#include "scene/sim.h"

/* Returns the FNV-1a hash of bytes or of a file's contents, continued from `hash`; 0 begins. */
uint64_t sim_hash_bytes(uint64_t hash, const void *data, size_t size);
uint64_t sim_hash_file(uint64_t hash, const char *path);

typedef struct sim_expected {
    struct cJSON *study; /* null: none, or the study of another version of the scene */
    char file[1100];
    double error, uncertainty; /* relative error of the force at the hand; uncertainty NAN: unknown */
} sim_expected;

/* Reads SCENE.accuracy.json next to SCENE.yaml. Prints a remark if the scene has changed since. */
void sim_expected_open(sim_expected *x, const sim *s);
void sim_expected_close(sim_expected *x);
/* Returns the change of the force without the effect of that name; NAN if the study has none. */
double sim_expected_without(const sim_expected *x, const char *effect);
/* Returns the change of the force by another law of large strains, and its name; NAN if the study has none. */
double sim_expected_law(const sim_expected *x, const char **law);
/* Returns the relative error at the hand of an extrapolator with force samples at this rate; NAN if the study has
 * none. */
double sim_expected_felt(const sim_expected *x, const char *extrapolator, double rate_Hz);
/* Returns the change of the force without the scene's mass scaling. */
double sim_expected_mass(const sim_expected *x);

#endif
