/* A world that is left to itself, and one that goes back to a snapshot: for tests of energy and of bits. */
#ifndef TM_TEST_RELEASED_H
#define TM_TEST_RELEASED_H

#include "../fixture.h"
#include "tensormass/energy.h"

/* Releases an undamped cube from a stretch along z, for `parts` times 100 steps: the account closes, and energy varies
 * only within the scheme's oscillation, both within `share` of the start. */
static inline void released_conserves_energy(const char *name, tm_world *world, const tm_mesh *mesh, double side_m,
                                             double stretch, int parts, double share) {
    tm_error error;
    tm_energy e;
    tm_state *s = tm_world_state(world);
    fix_ok(tm_stage_energy(world, &error), &error);
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++)
        s->u_m[i] = s->u_prev_m[i] = (i % 3 == 2 ? stretch : -0.12) * (mesh->rest_m[i] - side_m / 2);
    double least = HUGE_VAL, most = 0;
    for (int k = 0; k < parts; k++) {
        fix_ok(tm_world_step(world, 100), &error);
        fix_ok(tm_world_energy(world, &e, &error), &error);
        const double total = e.kinetic_J + e.elastic_J;
        least = fmin(least, total), most = fmax(most, total);
        assert_true(fabs(e.residual_J) < share * e.start_J);
    }
    print_message("%s: energy between %.4f and %.4f of the start\n", name, least / e.start_J, most / e.start_J);
    assert_true(most - least < share * e.start_J);
}

/* Saves a snapshot, steps on and restores it. */
static inline void step_and_go_back(tm_world *world, int32_t steps) {
    tm_error error;
    const int64_t bytes = tm_snapshot_bytes(world);
    void *kept = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(world, kept, bytes, &error), &error);
    fix_ok(tm_world_step(world, steps), &error);
    fix_ok(tm_snapshot_restore(world, kept, bytes, &error), &error);
    free(kept);
}

#endif
