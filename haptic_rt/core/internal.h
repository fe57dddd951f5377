/* Shared by the files of the core, not by its users. */
#ifndef HRT_INTERNAL_H
#define HRT_INTERNAL_H

#include <math.h>

#include "hrt.h"

/* The contact law in this precision; in flash once. */
#define LAW_REAL float
#define LAW_CALL __attribute__((noinline, unused))
#include "libtensormass/numeric/number.h"
#include "libtensormass/numeric/vec.h"

/* Three numbers a point, three corners a triangle; as wide as a pointer's offset. */
static const ptrdiff_t HRT_XYZ = 3;

/* 0 leaves the patch out of a small part's flash: `local_model` then runs as `tangent`. */
#ifndef HRT_WITH_PATCHES
#define HRT_WITH_PATCHES 1
#endif

static inline int32_t hrt_joints(const hrt_params *params) {
#ifdef HRT_ONE_DEVICE
    (void)params;
    return HRT_JOINTS;
#else
    return params->device->joints;
#endif
}
static inline int32_t hrt_motors(const hrt_params *params) {
#ifdef HRT_ONE_DEVICE
    (void)params;
    return HRT_MOTORS;
#else
    return params->device->motors;
#endif
}

/* y = M x, row-major 3x3. */
static inline void hrt_apply(const float m[9], const float x[3], float y[3]) {
    for (int i = 0; i < 3; i++) y[i] = m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2];
}
/* y = M^T x. */
static inline void hrt_apply_transposed(const float m[9], const float x[3], float y[3]) {
    for (int i = 0; i < 3; i++) y[i] = m[i] * x[0] + m[3 + i] * x[1] + m[6 + i] * x[2];
}
/* Without string.h, which the core does not use. */
static inline bool hrt_same_name(const char *a, const char *b) {
    while (*a && *a == *b) a++, b++;
    return *a == *b;
}
static inline float hrt_clamp(float value, float low, float high) {
    return value < low ? low : value > high ? high : value;
}
static inline float hrt_norm9(const float m[9]) {
    float s = 0.0f;
    for (int i = 0; i < 9; i++) s += m[i] * m[i];
    return sqrtf(s);
}
/* Not by isfinite: the firmware build may be told that no NaN exists. */
static inline bool hrt_finite(float x) { return x >= -3.0e38f && x <= 3.0e38f; }
static inline bool hrt_finite_n(const float *x, int32_t n) {
    bool good = true;
    for (int32_t i = 0; i < n; i++) good = good && hrt_finite(x[i]);
    return good;
}
/* A difference of times as a float; saturates at half an hour (time.c). */
float hrt_us(int64_t us);
static inline float hrt_seconds(int64_t us) { return 1.0e-6f * hrt_us(us); }
static inline bool hrt_older(int64_t us, float limit_us) { return hrt_us(us) > limit_us; }

#if HRT_WITH_ADAPTIVE
/* adaptive.c: nothing is known of any law. */
void hrt_adaptive_reset(hrt_adaptive *a);
/* What a blend of said_N gives now; keeps said_N for the verdict. with_patch: the patch's is one of them. */
void hrt_adaptive_blend(hrt_adaptive *a, int64_t now_us, bool with_patch, float said_N[HRT_ADAPTIVE_LAWS][3],
                        float force_N[3]);
/* A sample of the true force at t_us came, interval_s after the one before. */
void hrt_adaptive_judge(hrt_adaptive *a, int64_t t_us, float interval_s, const float force_N[3]);
#endif

/* faults.c: latches the first. */
void hrt_latch(hrt_controller *c, int64_t now_us, hrt_fault fault, int32_t detail);

/* encoders.c: counts to joints, tip and velocity; plausibility. */
void hrt_read_device(hrt_controller *c, int64_t now_us, const hrt_input *in);

/* torques.c: force to render -> force within every limit and its torques. dt_s: since the last tick. */
void hrt_limit_force(hrt_controller *c, float dt_s, const float wanted_N[3]);

/* passivity.c */
void hrt_passivity_observe(hrt_controller *c, int64_t now_us, float dt_s, const float moved_m[3]);
void hrt_passivity_control(hrt_controller *c, float dt_s, float force_N[3]);

/* coupling.c: force at the tip, by the extrapolation itself or through a coupled proxy. */
void hrt_render(hrt_controller *c, int64_t now_us, bool coupling, float force_N[3]);

/* local_model.c: force of the tool at `tip_m` against a patch; false when the tool has left it. */
bool hrt_contact_force(const hrt_patch *patch, hrt_touch *touch, int64_t now_us, const float tip_m[3],
                       float force_N[3]);
/* Forgets the reactions. */
void hrt_local_model_clear(hrt_touch *touch);
/* Carries the reactions over to a new patch. */
void hrt_local_model_warm(hrt_touch *touch, const hrt_patch *old, const hrt_patch *fresh);

/* evidence.c: the share of a received stiffness that came true of late, 0 to 1; that of the sample before is judged by
 * the newest; whether the newest patch gives its sample's force, to a half; and what the force on it has drifted since,
 * added to `force_N`. */
float hrt_evidence_trust(const hrt_extrapolation *x);
void hrt_evidence_judge(hrt_extrapolation *x);
bool hrt_evidence_patch(hrt_extrapolation *x, bool same_tissue);
void hrt_drift_follow(hrt_extrapolation *x, int64_t now_us, float force_N[3]);

/* patch_response.c: shift[a] := the sum of C_ab x over `count` places b, of which C's upper triangle is there. */
void hrt_patch_respond(const hrt_patch *patch, uint32_t a, const uint8_t *b, const law_v3 *x, int32_t count,
                       float *shift_m);

#if HRT_WITH_FRICTION
/* One station of the tool in this tick: friction's force on the tissue, and what it hangs on. */
typedef struct hrt_friction_station {
    hrt_friction_state is;
    float load_N, normal_force_N, normal[3]; /* sum of its rows' reactions, what of them presses along `normal` */
    float compliance_sum_m_N, slipped_m;
} hrt_friction_station;

typedef struct hrt_friction {
    const hrt_patch *patch;
    hrt_friction_history *history; /* of the last tick; hrt_friction_settle makes it this one */
    law_v3 tip;
    int32_t count;
    hrt_friction_station station[HRT_CONTACT_ROWS];
    float u_m[HRT_PATCH_DOFS]; /* displacements of the vertices in this round */
} hrt_friction;

/* patch_friction.c: friction of a tick, from what it was in the last one; of the shape, as shifted, that the rows are
 * found against; at those rows, once they are solved: to be added to the residual; and the end of the tick. */
void hrt_friction_begin(hrt_friction *friction, const hrt_patch *patch, hrt_friction_history *was,
                        const float tip_m[3]);
void hrt_friction_shape(hrt_friction *friction, const float *shift_m);
void hrt_friction_iterate(hrt_friction *friction, const hrt_contact_row *row, int32_t count, float *residual_N);
void hrt_friction_settle(hrt_friction *friction, float passed_s);
/* Which stations bear, by these rows. */
void hrt_friction_load(hrt_friction *friction, const hrt_contact_row *row, int32_t count);
/* The forces as these rows hand them on to the vertices. */
void hrt_friction_add(const hrt_friction *friction, const hrt_contact_row *row, int32_t count, float sign,
                      float *force_N);
/* Of the row's station; null: it bears nothing. */
const hrt_friction_station *hrt_friction_station_of(const hrt_friction *friction, const hrt_contact_row *row);
#endif

/* Features that stations of the tool were found near. count < 0: to be looked for. */
enum { HRT_HITS_MAX = 64 };
typedef struct hrt_hits {
    int32_t count;
    struct {
        uint8_t station, kind, index; /* kind 0 face, 1 edge, 2 vertex */
    } at[HRT_HITS_MAX];
} hrt_hits;

/* patch_rows.c: rows of the tool's axis from `tip_m` towards the trocar against the patch shifted by `shift_m`, those
 * with a gap of at most a fifth of the radius. `before`: the rows of the shape before, which let a station stay in
 * touch with a surface that it has sunk through. `hits`: looked for and left there, or, on a shape that hardly differs,
 * the only ones to look at. Returns the count, at most HRT_CONTACT_ROWS. */
int32_t hrt_contact_rows(const hrt_patch *patch, const float *shift_m, const float tip_m[3],
                         const hrt_contact_row *before, int32_t before_count, hrt_hits *hits, hrt_contact_row *row);

/* topology.c; false: too many edges for a piece of surface. */
bool hrt_patch_topology_build(hrt_patch *patch);

#endif
