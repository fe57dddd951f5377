/* Stage "integrate": central differences. Solved for the new position they read
 *   u+ = u + carry (u - u-) + mobility f,  mobility = 1/(m/dt2 + gamma/2dt),  carry = (m/dt2 - gamma/2dt) mobility,
 * where carry is 1 without damping. */
#include "world/world_internal.h"

void tm_stage_integrate_run(void *self, tm_world *world) {
    (void)self;
    const double *TM_RESTRICT u = world->state.u_m, *TM_RESTRICT u_prev = world->state.u_prev_m;
    const double *TM_RESTRICT f = world->state.force_N, *TM_RESTRICT mobility = world->mobility_s2_kg;
    double *TM_RESTRICT u_next = world->state.u_next_m;
    const tm_force_graph *g = &world->tissue->graph;
    for (int32_t begin, end = 0; tm_next_run(g->living, g->vertex_count, &begin, &end);)
        for (int64_t v = begin, i = 3 * v; v < end; v++, i += 3) { /* written out: a loop of three is slower */
            const double x = u[i] + (u[i] - u_prev[i]) + mobility[v] * f[i];
            const double y = u[i + 1] + (u[i + 1] - u_prev[i + 1]) + mobility[v] * f[i + 1];
            const double z = u[i + 2] + (u[i + 2] - u_prev[i + 2]) + mobility[v] * f[i + 2];
            u_next[i] = x, u_next[i + 1] = y, u_next[i + 2] = z;
        }
}

void tm_stage_integrate_damped_run(void *self, tm_world *world) {
    (void)self;
    const double *TM_RESTRICT u = world->state.u_m, *TM_RESTRICT u_prev = world->state.u_prev_m;
    const double *TM_RESTRICT f = world->state.force_N, *TM_RESTRICT mobility = world->mobility_s2_kg;
    const double *TM_RESTRICT carry = world->carry;
    double *TM_RESTRICT u_next = world->state.u_next_m;
    const tm_force_graph *g = &world->tissue->graph;
    for (int32_t begin, end = 0; tm_next_run(g->living, g->vertex_count, &begin, &end);)
        for (int64_t v = begin, i = 3 * v; v < end; v++, i += 3) { /* written out: a loop of three is slower */
            const double x = u[i] + carry[v] * (u[i] - u_prev[i]) + mobility[v] * f[i];
            const double y = u[i + 1] + carry[v] * (u[i + 1] - u_prev[i + 1]) + mobility[v] * f[i + 1];
            const double z = u[i + 2] + carry[v] * (u[i + 2] - u_prev[i + 2]) + mobility[v] * f[i + 2];
            u_next[i] = x, u_next[i + 1] = y, u_next[i + 2] = z;
        }
}

static void refresh(tm_world *world, int32_t v) {
    const double dt = world->state.dt_s;
    const double inertia = world->tissue->mass_kg[v] / (dt * dt);
    const double drag = world->damped ? world->tissue->damping_kg_s[v] / (2 * dt) : 0;
    const double weight = inertia + drag;
    world->mobility_s2_kg[v] = weight > 0 ? 1 / weight : 0;
    if (world->carry) world->carry[v] = weight > 0 ? (inertia - drag) / weight : 0;
    if (weight > 0) return;
    for (int32_t i = 3 * v; i < 3 * v + 3; i++)
        world->state.u_next_m[i] = world->state.u_prev_m[i] = world->state.u_m[i];
}

void tm_stage_integrate_changed(void *self, tm_world *world) {
    (void)self;
    for (int32_t v = 0; v < world->tissue->mesh->vertex_count; v++) refresh(world, v);
}

void tm_stage_integrate_refresh(tm_world *world, const int32_t *vertex, int32_t count) {
    for (int32_t i = 0; i < count; i++) refresh(world, vertex[i]);
}

void tm_stage_integrate_still(tm_world *world) {
    const tm_force_graph *g = &world->tissue->graph;
    const tm_state *s = &world->state;
    for (int32_t v = 0; v < g->vertex_count; v++) {
        v = tm_bit_from(g->living, g->vertex_count, v, ~UINT64_C(0));
        for (int32_t i = 3 * v; i < 3 * v + 3 && v < g->vertex_count; i++) s->u_next_m[i] = s->u_prev_m[i] = s->u_m[i];
    }
}
