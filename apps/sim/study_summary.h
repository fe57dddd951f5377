/* What tm-accuracy --scene has found out about a scene, for tm-sim --explain. */
#ifndef TM_SIM_EXPECTED_H
#define TM_SIM_EXPECTED_H

#include "scene/sim.h"

/* FNV-1a of bytes and of what is in a file; `hash` 0 begins. */
uint64_t sim_hash_bytes(uint64_t hash, const void *data, size_t size);
uint64_t sim_hash_file(uint64_t hash, const char *path);

typedef struct sim_expected {
    struct cJSON *study; /* null: there is none, or it is of another form of the scene */
    char file[1100];
    double error, uncertainty; /* of the force at the hand, relative; uncertainty NAN: not known */
} sim_expected;

/* Reads SCENE.accuracy.json beside SCENE.yaml. Remarks where it is no longer of this scene. */
void sim_expected_open(sim_expected *x, const sim *s);
void sim_expected_close(sim_expected *x);
/* Change of the force without the effect of that name; NAN: the study does not say. */
double sim_expected_without(const sim_expected *x, const char *effect);
/* Error at the hand of an extrapolator with force samples at this rate, relative; NAN: the same. */
double sim_expected_felt(const sim_expected *x, const char *extrapolator, double rate_Hz);
/* Change of the force without the scene's mass scaling. */
double sim_expected_mass(const sim_expected *x);

#endif
