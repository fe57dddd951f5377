/* Inner loops of the coupling. Sums use a fixed number of lanes, since serial sums would be latency-bound. Compiled
 * twice with AVX2: wider registers, equal sums. */
#include "coupling.h"

#include <string.h>

#if defined(__x86_64__) && !defined(_WIN32)
#define HAS_WIDE 1
#define WIDE __attribute__((target("avx2")))
#endif
#define INLINE static inline __attribute__((always_inline))

enum { LANES = 8, FLOATS = 16, TOGETHER = 4 };

INLINE double sum_lanes(const double lane[LANES]) {
    double sum = 0;
    for (int k = 0; k < LANES; k++) sum += lane[k];
    return sum;
}

INLINE double dot(const double *restrict a, const double *restrict b, int32_t n) {
    double lane[LANES] = {0}, rest = 0;
    int32_t i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++) lane[k] += a[i + k] * b[i + k];
    for (; i < n; i++) rest += a[i] * b[i];
    return rest + sum_lanes(lane);
}

INLINE void weighted_dots(const double *a, const double *weight, const double *b, int32_t n, double out[9]) {
    enum { FEW = 4 }; /* SIMD lanes, for each of nine sums */
    double lane[9][FEW] = {{0}}, rest[9] = {0};
    const double *restrict x0 = a, *restrict x1 = a + n, *restrict x2 = a + 2 * (int64_t)n;
    const double *restrict y0 = b, *restrict y1 = b + n, *restrict y2 = b + 2 * (int64_t)n;
    int32_t i = 0;
    for (; i + FEW <= n; i += FEW)
        for (int k = 0; k < FEW; k++) {
            const double w = weight[i + k], x[3] = {x0[i + k] * w, x1[i + k] * w, x2[i + k] * w};
            const double y[3] = {y0[i + k], y1[i + k], y2[i + k]};
            for (int j = 0; j < 9; j++) lane[j][k] += x[j / 3] * y[j % 3];
        }
    for (; i < n; i++) {
        const double w = weight[i], x[3] = {x0[i] * w, x1[i] * w, x2[i] * w}, y[3] = {y0[i], y1[i], y2[i]};
        for (int j = 0; j < 9; j++) rest[j] += x[j / 3] * y[j % 3];
    }
    for (int j = 0; j < 9; j++) out[j] = rest[j] + (lane[j][0] + lane[j][1]) + (lane[j][2] + lane[j][3]);
}

INLINE void add_times(double f, const double *restrict a, int32_t n, double *restrict out) {
    for (int32_t i = 0; i < n; i++) out[i] += f * a[i];
}

/* push -= r * x, and the sum of r * at; r in double or in single, sums in double. */
#define BOTH_HALVES(name, real)                                                                                        \
    INLINE double name(const real *restrict r, double x, const double *restrict at, double *restrict push,             \
                       int32_t n) {                                                                                    \
        double lane[LANES] = {0}, rest = 0;                                                                            \
        int32_t j = 0;                                                                                                 \
        for (; j + LANES <= n; j += LANES)                                                                             \
            for (int k = 0; k < LANES; k++) {                                                                          \
                lane[k] += (double)r[j + k] * at[j + k];                                                               \
                push[j + k] -= (double)r[j + k] * x;                                                                   \
            }                                                                                                          \
        for (; j < n; j++) {                                                                                           \
            rest += (double)r[j] * at[j];                                                                              \
            push[j] -= (double)r[j] * x;                                                                               \
        }                                                                                                              \
        return rest + sum_lanes(lane);                                                                                 \
    }
BOTH_HALVES(both_halves, double)
BOTH_HALVES(both_halves_single, float)

INLINE void whole_force(const double *schur, const double *given, const double *at, int32_t n, double *force) {
    memcpy(force, given, 8 * (size_t)n);
    for (int32_t i = 0; i < n; schur += n - i, i++)
        force[i] -= schur[0] * at[i] + both_halves(schur + 1, at[i], at + i + 1, force + i + 1, n - i - 1);
}

INLINE void whole_change(const float *single, const double *moved, int32_t n, double *force) {
    for (int32_t i = 0; i < n; single += n - i, i++)
        force[i] -= (double)single[0] * moved[i] +
                    both_halves_single(single + 1, moved[i], moved + i + 1, force + i + 1, n - i - 1);
}

typedef float four __attribute__((vector_size(16)));
typedef float eight __attribute__((vector_size(32)));

/* Adds lower and upper half. A macro, since the calling convention for 32 bytes differs between processors. */
#define FOLD(x) (__builtin_shufflevector(x, x, 0, 1, 2, 3) + __builtin_shufflevector(x, x, 4, 5, 6, 7))

/* answer := K moved, two blocks at a time. */
INLINE void near_part(const tms_coupling *c) {
    for (int32_t v = 0; v < c->n / 3; v++)
        for (int i = 0; i < 3; i++) c->spread[4 * v + i] = c->moved[3 * v + i];
    for (int32_t v = 0; v < c->n / 3; v++) {
        eight sum = {0};
        for (int32_t k = c->begin[v]; k < c->begin[v + 1]; k += 2) {
            const eight *block = (const eight *)(c->block + 12 * (int64_t)k);
            const four a = *(const four *)(c->spread + 4 * c->neighbour[k]),
                       b = *(const four *)(c->spread + 4 * c->neighbour[k + 1]);
            const eight x = __builtin_shufflevector(a, b, 0, 0, 0, 0, 4, 4, 4, 4),
                        y = __builtin_shufflevector(a, b, 1, 1, 1, 1, 5, 5, 5, 5),
                        z = __builtin_shufflevector(a, b, 2, 2, 2, 2, 6, 6, 6, 6);
            sum += block[0] * x + block[1] * y + block[2] * z;
        }
        const four both = FOLD(sum);
        memcpy(c->answer + 3 * v, &both, sizeof both); /* the next vertex overwrites the fourth */
    }
}

/* Sums each vector. */
INLINE four sums_of(four a, four b, four c, four d) {
    const four ab = __builtin_shufflevector(a, b, 0, 1, 4, 5) + __builtin_shufflevector(a, b, 2, 3, 6, 7),
               cd = __builtin_shufflevector(c, d, 0, 1, 4, 5) + __builtin_shufflevector(c, d, 2, 3, 6, 7);
    return __builtin_shufflevector(ab, cd, 0, 2, 4, 6) + __builtin_shufflevector(ab, cd, 1, 3, 5, 7);
}

/* along := W^T moved, four columns at a time. */
INLINE void gather_smooth(const tms_coupling *c) {
    const eight *d = (const eight *)c->moved;
    const int32_t n = c->padded / 8;
    for (int32_t j = 0; j < c->rank; j += TOGETHER) {
        const eight *w = (const eight *)(c->smooth + (int64_t)j * c->padded);
        eight lane[TOGETHER][2] = {{{0}}};
        for (int32_t i = 0; i < n; i += 2)
            for (int t = 0; t < TOGETHER; t++)
                for (int k = 0; k < 2; k++) lane[t][k] += w[t * n + i + k] * d[i + k];
        four sum[TOGETHER];
        for (int t = 0; t < TOGETHER; t++) {
            const eight both = lane[t][0] + lane[t][1];
            sum[t] = FOLD(both);
        }
        *(four *)(c->along + j) = sums_of(sum[0], sum[1], sum[2], sum[3]);
    }
}

/* answer -= W along. */
INLINE void spread_smooth(const tms_coupling *c) {
    eight *answer = (eight *)c->answer;
    const int32_t n = c->padded / 8;
    for (int32_t j = 0; j < c->rank; j += TOGETHER) {
        const eight *w = (const eight *)(c->smooth + (int64_t)j * c->padded);
        const float *a = c->along + j;
        for (int32_t i = 0; i < n; i++)
            answer[i] -= (w[i] * a[0] + w[n + i] * a[1]) + (w[2 * n + i] * a[2] + w[3 * n + i] * a[3]);
    }
}

INLINE void follow(const tms_coupling *c) {
    near_part(c);
    gather_smooth(c);
    spread_smooth(c);
}

INLINE void rows_times(const float *restrict rows, int32_t count, int32_t width, const float *restrict x,
                       float *restrict out) {
    for (int32_t i = 0; i < count; i++, rows += width) {
        float lane[FLOATS] = {0}, sum = 0;
        for (int32_t j = 0; j < width; j += FLOATS)
            for (int k = 0; k < FLOATS; k++) lane[k] += rows[j + k] * x[j + k];
        for (int k = 0; k < FLOATS; k++) sum += lane[k];
        out[i] = sum;
    }
}

#ifdef HAS_WIDE
WIDE static double dot_wide(const double *restrict a, const double *restrict b, int32_t n) { return dot(a, b, n); }
WIDE static void dots_wide(const double *a, const double *weight, const double *b, int32_t n, double out[9]) {
    weighted_dots(a, weight, b, n, out);
}
WIDE static void add_wide(double f, const double *restrict a, int32_t n, double *restrict out) {
    add_times(f, a, n, out);
}
WIDE static void whole_wide(const double *schur, const double *given, const double *at, int32_t n, double *force) {
    whole_force(schur, given, at, n, force);
}
WIDE static void change_wide(const float *single, const double *moved, int32_t n, double *force) {
    whole_change(single, moved, n, force);
}
WIDE static void follow_wide(const tms_coupling *c) { follow(c); }
WIDE static void rows_wide(const float *rows, int32_t count, int32_t width, const float *x, float *out) {
    rows_times(rows, count, width, x, out);
}
#define CHOOSE(wide, plain) (__builtin_cpu_supports("avx2") ? (wide) : (plain))
#else
#define CHOOSE(wide, plain) (plain)
#endif

static double dot_plain(const double *restrict a, const double *restrict b, int32_t n) { return dot(a, b, n); }
static void dots_plain(const double *a, const double *weight, const double *b, int32_t n, double out[9]) {
    weighted_dots(a, weight, b, n, out);
}
static void add_plain(double f, const double *restrict a, int32_t n, double *restrict out) { add_times(f, a, n, out); }
static void whole_plain(const double *schur, const double *given, const double *at, int32_t n, double *force) {
    whole_force(schur, given, at, n, force);
}
static void change_plain(const float *single, const double *moved, int32_t n, double *force) {
    whole_change(single, moved, n, force);
}
static void follow_plain(const tms_coupling *c) { follow(c); }
static void rows_plain(const float *rows, int32_t count, int32_t width, const float *x, float *out) {
    rows_times(rows, count, width, x, out);
}

double tms_dot(const double *restrict a, const double *restrict b, int32_t n) {
    return CHOOSE(dot_wide, dot_plain)(a, b, n);
}
void tms_weighted_dots(const double *a, const double *weight, const double *b, int32_t n, double out[9]) {
    CHOOSE(dots_wide, dots_plain)(a, weight, b, n, out);
}
void tms_add_times(double f, const double *restrict a, int32_t n, double *restrict out) {
    CHOOSE(add_wide, add_plain)(f, a, n, out);
}
void tms_whole_force(const double *schur, const double *given, const double *at, int32_t n, double *force) {
    CHOOSE(whole_wide, whole_plain)(schur, given, at, n, force);
}
void tms_whole_change(const float *single, const double *moved, int32_t n, double *force) {
    CHOOSE(change_wide, change_plain)(single, moved, n, force);
}
void tms_rows_times(const float *rows, int32_t count, int32_t width, const float *x, float *out) {
    CHOOSE(rows_wide, rows_plain)(rows, count, width, x, out);
}
void tms_follow(tms_coupling *c) { CHOOSE(follow_wide, follow_plain)(c); }
