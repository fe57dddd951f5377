/* Stage "gravity": m g on every vertex. */
#include "world/world_internal.h"

#include <math.h>

#include "base/intrinsics.h"

typedef struct gravity {
    tm_pool pool;
    double g_m_s2[3];
} gravity;

#ifdef TM_HAS_AVX2
/* Processes four vertices at a time, bit-identical to one; returns the first left to the plain loop. */
TM_AVX2 static int32_t fours(const double *mass, const double g[3], double *f, int32_t v, int32_t end) {
    const __m256d a = _mm256_set_pd(g[0], g[2], g[1], g[0]), b = _mm256_set_pd(g[1], g[0], g[2], g[1]),
                  c = _mm256_set_pd(g[2], g[1], g[0], g[2]);
    for (; v + 4 <= end; v += 4) {
        const __m256d m = _mm256_loadu_pd(mass + v);
        double *at = f + 3 * (int64_t)v;
        const __m256d x = _mm256_mul_pd(_mm256_permute4x64_pd(m, _MM_SHUFFLE(1, 0, 0, 0)), a),
                      y = _mm256_mul_pd(_mm256_permute4x64_pd(m, _MM_SHUFFLE(2, 2, 1, 1)), b),
                      z = _mm256_mul_pd(_mm256_permute4x64_pd(m, _MM_SHUFFLE(3, 3, 3, 2)), c);
        _mm256_storeu_pd(at, _mm256_add_pd(_mm256_loadu_pd(at), x));
        _mm256_storeu_pd(at + 4, _mm256_add_pd(_mm256_loadu_pd(at + 4), y));
        _mm256_storeu_pd(at + 8, _mm256_add_pd(_mm256_loadu_pd(at + 8), z));
    }
    return v;
}
#else
static int32_t fours(const double *mass, const double g[3], double *f, int32_t v, int32_t end) {
    (void)mass, (void)g, (void)f, (void)end;
    return v;
}
#endif

void tm_stage_gravity_run(void *self, tm_world *world, const tm_range *range) {
    const gravity *stage = self;
    const double *TM_RESTRICT mass = world->tissue->physical_mass_kg;
    double *TM_RESTRICT f = world->state.force_N;
    const double gx = stage->g_m_s2[0], gy = stage->g_m_s2[1], gz = stage->g_m_s2[2];
    const tm_force_graph *g = &world->tissue->graph;
    for (int32_t begin, end = range->begin; tm_next_run(g->active, range->end, &begin, &end);)
        for (int32_t v = world->wide ? fours(mass, stage->g_m_s2, f, begin, end) : begin; v < end; v++) {
            f[3 * v] += mass[v] * gx;
            f[3 * v + 1] += mass[v] * gy;
            f[3 * v + 2] += mass[v] * gz;
        }
}

const double *tm_stage_gravity_m_s2(const void *self) { return ((const gravity *)self)->g_m_s2; }

const double *tm_world_gravity_m_s2(const tm_world *world) {
    static const double none[3] = {0, 0, 0};
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.range == tm_stage_gravity_run)
            return tm_stage_gravity_m_s2(world->entry[i].stage.self);
    return none;
}

static void destroy(void *self) {
    tm_pool pool = ((gravity *)self)->pool;
    tm_pool_release(&pool);
}

tm_status tm_stage_gravity(tm_world *world, const double g_m_s2[3], tm_error *error) {
    TM_REQUIRE(world && g_m_s2, "world or g_m_s2 is null", TM_ERR_ARGUMENT);
    for (int i = 0; i < 3; i++)
        if (!isfinite(g_m_s2[i]))
            return tm_fail(error, TM_ERR_ARGUMENT, i, "gravity: its %c component is %g; give a finite number", "xyz"[i],
                           g_m_s2[i]);
    tm_pool pool = {0};
    gravity *self = TM_ALLOC(&pool, gravity, 1);
    if (!self) return tm_fail_memory(error, "gravity stage");
    for (int i = 0; i < 3; i++) self->g_m_s2[i] = g_m_s2[i];
    self->pool = pool;
    const tm_stage stage = {.size = sizeof stage,
                            .name = "gravity",
                            .phase = TM_PHASE_LOAD,
                            .range = tm_stage_gravity_run,
                            .divided = true,
                            .destroy = destroy,
                            .self = self};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) destroy(self);
    return status;
}
