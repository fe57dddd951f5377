/* Stage "integrate": central differences. Solved for the new position they read
 *   u+ = u + inertia (u - u-) + mobility f, mobility = 1/(m/dt2 + gamma/2dt), inertia = (m/dt2 - gamma/2dt) mobility,
 * where inertia is 1 without damping. */
#include "world/world_internal.h"

#include <math.h>

#include "base/intrinsics.h"
#include "base/vec.h"

/* --- travel --- */

/* Largest increment of any vertex along each axis; its norm bounds the travel of all vertices. */
typedef struct way {
    double max_m[3];
} way;

static void add_ways(way *w, const double *u, const double *u_prev, int64_t n) {
    for (int64_t i = 0; i < n; i += 3)
        for (int c = 0; c < 3; c++) w->max_m[c] = law_max(fabs(u[i + c] - u_prev[i + c]), w->max_m[c]);
}

#ifdef TM_HAS_AVX2
/* Twelve components in three vectors: the axis of a lane cycles. */
TM_AVX2 static inline void add_lanes(way *w, __m256d first, __m256d second, __m256d third) {
    double lane[12];
    _mm256_storeu_pd(lane, first);
    _mm256_storeu_pd(lane + 4, second);
    _mm256_storeu_pd(lane + 8, third);
    for (int i = 0; i < 12; i++) w->max_m[i % 3] = law_max(lane[i], w->max_m[i % 3]);
}
TM_AVX2 static inline __m256d larger_way(__m256d way_m, __m256d most_m) {
    return _mm256_max_pd(_mm256_andnot_pd(_mm256_set1_pd(-0.0), way_m), most_m);
}
#endif

static void note_way(tm_world *world, const tm_range *range, const way *w) {
    tm_partition *partition = world->partition + range->partition;
    const double way_m = vnorm(w->max_m);
    partition->max_increment_m =
        range->begin == partition->force.begin ? way_m : law_max(way_m, partition->max_increment_m);
}

/* --- the stage --- */

void tm_stage_integrate(void *self, tm_world *world, const tm_range *range) {
    (void)self;
    const double *TM_RESTRICT u = world->state.u_m, *TM_RESTRICT u_prev = world->state.u_prev_m;
    const double *TM_RESTRICT f = world->state.force_N, *TM_RESTRICT mobility = world->mobility_s2_kg;
    double *TM_RESTRICT u_next = world->state.u_next_m;
    const tm_force_graph *g = &world->tissue->graph;
    way come = {{0, 0, 0}};
    for (int32_t begin, end = range->begin; tm_next_run(g->active, range->end, &begin, &end);) {
        for (int64_t v = begin, i = 3 * v; v < end; v++, i += 3) { /* unrolled: a loop of three is slower */
            const double x = u[i] + (u[i] - u_prev[i]) + mobility[v] * f[i];
            const double y = u[i + 1] + (u[i + 1] - u_prev[i + 1]) + mobility[v] * f[i + 1];
            const double z = u[i + 2] + (u[i + 2] - u_prev[i + 2]) + mobility[v] * f[i + 2];
            u_next[i] = x, u_next[i + 1] = y, u_next[i + 2] = z;
        }
        if (world->notes_travel) add_ways(&come, u + 3 * begin, u_prev + 3 * begin, 3 * (int64_t)(end - begin));
    }
    if (world->notes_travel) note_way(world, range, &come);
}

#ifdef TM_HAS_AVX2
/* Four vertices at a time, bit-identical to one: twelve components in three vectors, with a vertex's factors repeated
 * for its three components. */
#define COMPONENTS(k, factors)                                                                                         \
    const int64_t i##k = 3 * v + 4 * k;                                                                                \
    const __m256d u##k = _mm256_loadu_pd(u + i##k), way##k = _mm256_sub_pd(u##k, _mm256_loadu_pd(u_prev + i##k));      \
    const __m256d on##k = _mm256_add_pd(u##k, _mm256_mul_pd(_mm256_permute4x64_pd(c, factors), way##k));               \
    const __m256d pushed##k = _mm256_mul_pd(_mm256_permute4x64_pd(m, factors), _mm256_loadu_pd(f + i##k));             \
    _mm256_storeu_pd(u_next + i##k, _mm256_add_pd(on##k, pushed##k));                                                  \
    if (come) most##k = larger_way(way##k, most##k)

/* Returns the first vertex left to the plain loop. Adds the others' travel to `come`, unless null. */
TM_AVX2 static inline __attribute__((always_inline)) int64_t fours(const tm_world *world, int64_t v, int64_t end,
                                                                   way *come) {
    __m256d most0 = _mm256_setzero_pd(), most1 = most0, most2 = most0;
    const double *u = world->state.u_m, *u_prev = world->state.u_prev_m, *f = world->state.force_N;
    double *u_next = world->state.u_next_m;
    for (; v + 4 <= end; v += 4) {
        const __m256d m = _mm256_loadu_pd(world->mobility_s2_kg + v), c = _mm256_loadu_pd(world->inertia + v);
        COMPONENTS(0, _MM_SHUFFLE(1, 0, 0, 0));
        COMPONENTS(1, _MM_SHUFFLE(2, 2, 1, 1));
        COMPONENTS(2, _MM_SHUFFLE(3, 3, 3, 2));
    }
    if (come) add_lanes(come, most0, most1, most2);
    return v;
}
TM_AVX2 static int64_t damped_fours(const tm_world *world, int64_t v, int64_t end) {
    return fours(world, v, end, NULL);
}
TM_AVX2 static int64_t damped_fours_tracked(const tm_world *world, int64_t v, int64_t end, way *come) {
    return fours(world, v, end, come);
}
#else
static int64_t damped_fours(const tm_world *world, int64_t v, int64_t end) {
    (void)world, (void)end;
    return v;
}
static int64_t damped_fours_tracked(const tm_world *world, int64_t v, int64_t end, way *come) {
    (void)world, (void)end, (void)come;
    return v;
}
#endif

void tm_stage_integrate_damped(void *self, tm_world *world, const tm_range *range) {
    (void)self;
    const double *TM_RESTRICT u = world->state.u_m, *TM_RESTRICT u_prev = world->state.u_prev_m;
    const double *TM_RESTRICT f = world->state.force_N, *TM_RESTRICT mobility = world->mobility_s2_kg;
    const double *TM_RESTRICT carry = world->inertia;
    double *TM_RESTRICT u_next = world->state.u_next_m;
    const tm_force_graph *g = &world->tissue->graph;
    const bool tracked = world->notes_travel;
    way come = {{0, 0, 0}};
    for (int32_t begin, end = range->begin; tm_next_run(g->active, range->end, &begin, &end);) {
        int64_t v = !world->wide ? begin
                    : tracked    ? damped_fours_tracked(world, begin, end, &come)
                                 : damped_fours(world, begin, end);
        if (tracked) add_ways(&come, u + 3 * v, u_prev + 3 * v, 3 * (end - v));
        for (int64_t i = 3 * v; v < end; v++, i += 3) {
            const double x = u[i] + carry[v] * (u[i] - u_prev[i]) + mobility[v] * f[i];
            const double y = u[i + 1] + carry[v] * (u[i + 1] - u_prev[i + 1]) + mobility[v] * f[i + 1];
            const double z = u[i + 2] + carry[v] * (u[i + 2] - u_prev[i + 2]) + mobility[v] * f[i + 2];
            u_next[i] = x, u_next[i + 1] = y, u_next[i + 2] = z;
        }
    }
    if (tracked) note_way(world, range, &come);
}

static void refresh(tm_world *world, int32_t v) {
    const double dt = world->state.dt_s;
    const double inertia = world->tissue->mass_kg[v] / (dt * dt);
    const double drag = world->damped ? world->tissue->damping_kg_s[v] / (2 * dt) : 0;
    const double weight = inertia + drag;
    world->mobility_s2_kg[v] = weight > 0 ? 1 / weight : 0;
    if (world->inertia) world->inertia[v] = weight > 0 ? (inertia - drag) / weight : 0;
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

void tm_stage_integrate_freeze_removed(tm_world *world) {
    const tm_force_graph *g = &world->tissue->graph;
    const tm_state *s = &world->state;
    for (int32_t v = 0; v < g->vertex_count; v++) {
        v = tm_bit_from(g->active, g->vertex_count, v, ~UINT64_C(0));
        for (int32_t i = 3 * v; i < 3 * v + 3 && v < g->vertex_count; i++) s->u_next_m[i] = s->u_prev_m[i] = s->u_m[i];
    }
}
