/* Internal functions of the core, shared by its files. */
#ifndef HRT_INTERNAL_H
#define HRT_INTERNAL_H

#include <math.h>

#include "hrt.h"

/* Compiles the contact law for float; noinline keeps one copy in flash. */
#define LAW_REAL float
#define LAW_CALL __attribute__((noinline, unused))
#include "libtensormass/numeric/number.h"
#include "libtensormass/numeric/vec.h"

/* Values per point and corners per triangle; ptrdiff_t, as pointer offsets need. */
static const ptrdiff_t HRT_XYZ = 3;

/* 0 omits patches from firmware: `local_model` then runs as `tangent`. */
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
/* Compares two names; the core does not use string.h. */
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
/* Returns whether x is finite; isfinite may be optimised away in a firmware build. */
static inline bool hrt_finite(float x) { return x >= -3.0e38f && x <= 3.0e38f; }
static inline bool hrt_finite_n(const float *x, int32_t n) {
    bool good = true;
    for (int32_t i = 0; i < n; i++) good = good && hrt_finite(x[i]);
    return good;
}
/* Converts a time difference to float; it saturates at half an hour (time.c). */
float hrt_us(int64_t us);
static inline float hrt_seconds(int64_t us) { return 1.0e-6f * hrt_us(us); }
static inline bool hrt_older(int64_t us, float limit_us) { return hrt_us(us) > limit_us; }

static inline bool hrt_is_free(const hrt_shaft *shaft) { return HRT_WITH_FREE && shaft->is_free; }

#if HRT_WITH_ADAPTIVE
/* adaptive.c: Resets the errors of all laws. */
void hrt_adaptive_reset(hrt_adaptive *a);
/* Blends the forces said_N of the laws and records them for hrt_adaptive_judge. with_patch: the patch's force is one of
 * them. */
void hrt_adaptive_blend(hrt_adaptive *a, int64_t now_us, bool with_patch, float said_N[HRT_ADAPTIVE_LAWS][3],
                        float force_N[3]);
/* Updates the laws' errors from a sample of the true force at t_us, interval_s after the one before. */
void hrt_adaptive_judge(hrt_adaptive *a, int64_t t_us, float interval_s, const float force_N[3]);
#endif

/* Returns the smallest time difference to divide by, s: a tick or frame after a late one comes early. */
static inline float hrt_dt_min_s(const hrt_params *params) { return 1.0e-6f * (0.25f * params->period_us); }

/* faults.c: Latches the first fault. */
void hrt_latch(hrt_controller *c, int64_t now_us, hrt_fault fault, int32_t detail);

/* encoders.c: Converts counts to joints, tip and velocity, and checks their plausibility. */
void hrt_read_device(hrt_controller *c, int64_t now_us, const hrt_input *in);

/* torques.c: Limits the force to render and computes its torques. dt_s: time since the last tick. */
void hrt_limit_force(hrt_controller *c, float dt_s, const float wanted_N[3]);

/* passivity.c: Updates the energy account; adds damping where it is negative. */
void hrt_passivity_observe(hrt_controller *c, int64_t now_us, float dt_s, const float moved_m[3]);
void hrt_passivity_control(hrt_controller *c, float dt_s, float force_N[3]);

/* coupling.c: Computes the force at the tip, from the extrapolation directly or through a coupled proxy. */
void hrt_render(hrt_controller *c, int64_t now_us, bool coupling, float force_N[3]);

/* local_model.c: Computes the force on the tool at `tip_m` against a patch. Returns false if the tool has left it. */
bool hrt_contact_force(const hrt_patch *patch, hrt_touch *touch, int64_t now_us, const float tip_m[3],
                       float force_N[3]);
/* Clears the reactions. */
void hrt_local_model_clear(hrt_touch *touch);
/* Transfers the reactions to a new patch. */
void hrt_local_model_warm(hrt_touch *touch, const hrt_patch *old, const hrt_patch *fresh);

/* evidence.c: hrt_evidence_trust returns the share of a received stiffness's predictions that recent samples confirmed,
 * 0 to 1; _judge updates it from the newest sample. _patch returns whether the newest patch reproduces its sample's
 * force, within a half. hrt_drift_follow adds the drift of the patch's force since the sample to `force_N`. */
float hrt_evidence_trust(const hrt_extrapolation *x);
void hrt_evidence_judge(hrt_extrapolation *x);
bool hrt_evidence_patch(hrt_extrapolation *x, bool same_tissue);
void hrt_drift_follow(hrt_extrapolation *x, int64_t now_us, float force_N[3]);

/* patch_response.c: Computes shift[a] = sum of C_ab x over `count` nodes b; the patch stores the upper triangle of C.
 */
void hrt_patch_respond(const hrt_patch *patch, uint32_t a, const uint8_t *b, const law_v3 *x, int32_t count,
                       float *shift_m);

#if HRT_WITH_FRICTION
/* Friction at one station in this tick: its force on the tissue, and the load that it depends on. */
typedef struct hrt_friction_station {
    hrt_friction_state is;
    float load_N, normal_force_N, normal[3]; /* sum of its rows' reactions, and their resultant along `normal` */
    float compliance_sum_m_N, slipped_m;
} hrt_friction_station;

typedef struct hrt_friction {
    const hrt_patch *patch;
    hrt_friction_history *history; /* state of the last tick; hrt_friction_settle updates it */
    law_v3 tip;
    const hrt_shaft *shaft;
    int32_t count;
    hrt_friction_station station[HRT_CONTACT_ROWS];
    float u_m[HRT_PATCH_DOFS]; /* displacements of the vertices in this iteration */
} hrt_friction;

/* patch_friction.c: Friction of one tick. _begin starts from the state of the last tick. _shape sets the shape,
 * shifted, that rows are detected against. _iterate computes friction at the solved rows and adds it to the residual.
 * _settle ends the tick. */
void hrt_friction_begin(hrt_friction *friction, const hrt_patch *patch, hrt_friction_history *was, const float tip_m[3],
                        const hrt_shaft *shaft);
void hrt_friction_shape(hrt_friction *friction, const float *shift_m);
void hrt_friction_iterate(hrt_friction *friction, const hrt_contact_row *row, int32_t count, float *residual_N);
void hrt_friction_settle(hrt_friction *friction, float passed_s);
/* Updates the list of loaded stations from these rows. */
void hrt_friction_load(hrt_friction *friction, const hrt_contact_row *row, int32_t count);
/* Adds the friction forces to the vertices, distributed by these rows. */
void hrt_friction_add(const hrt_friction *friction, const hrt_contact_row *row, int32_t count, float sign,
                      float *force_N);
/* Returns the friction of the row's station; null if it carries no load. */
const hrt_friction_station *hrt_friction_station_of(const hrt_friction *friction, const hrt_contact_row *row);
#endif

/* Features near the tool's stations. count < 0: not searched yet. */
enum { HRT_HITS_MAX = 64 };
typedef struct hrt_hits {
    int32_t count;
    struct {
        uint8_t station, kind, index; /* kind: 0 face, 1 edge, 2 vertex */
    } at[HRT_HITS_MAX];
} hrt_hits;

/* patch_rows.c: Detects the contact rows of the tool's axis, from `tip_m` along the shaft, against the patch shifted
 * by `shift_m`. Keeps rows with a gap of at most a fifth of the radius. `before`: the rows of the previous shape; they
 * keep contact where a station has sunk through the surface. `hits`: filled by a search, or, on a shape that hardly
 * differs, the only features checked. Returns the count, at most HRT_CONTACT_ROWS. */
int32_t hrt_contact_rows(const hrt_patch *patch, const float *shift_m, const float tip_m[3], const hrt_shaft *shaft,
                         const hrt_contact_row *before, int32_t before_count, hrt_hits *hits, hrt_contact_row *row);

/* topology.c: Builds the topology. Returns false if there are too many edges for a surface. */
bool hrt_patch_topology_build(hrt_patch *patch);

#endif
