/* Public header of the controller: one pure function of time, device input and the newest force sample. It uses no
 * thread, clock, heap, lock, log or operating system. It computes in `float` only, and every loop is bounded. The same
 * code runs under the Linux loop, on a virtual clock and on a microcontroller.
 *
 * Times are int64 microseconds of the caller's clock; floats hold only differences. Positions are metres relative to
 * the trocar (of a free instrument: its origin), forces are newtons on the tool. Both are along the scene's world axes;
 * the caller moves the origin (io/node.h). States, transitions, faults and limits: docs/controller.md.
 *
 * Over 400 lines: firmware includes this one header. */
#ifndef HRT_H
#define HRT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Maximum numbers of joints and of driven joints of any device; hrt_device_type holds a device's own. Unused entries
 * stay zero. Driven joints come first. */
#ifdef HRT_ONE_DEVICE /* firmware for the Impulse Engine alone */
enum { HRT_JOINTS = 5, HRT_MOTORS = 3 };
#else
enum { HRT_JOINTS = 7, HRT_MOTORS = 3 };
#endif
/* The Impulse Engine's joints, in order. */
enum { HRT_PITCH, HRT_YAW, HRT_INSERTION, HRT_ROLL, HRT_GRIP };
enum { HRT_TILT = 5 }; /* first of the two joints of a device that `tilts` */

/* boot -> self_test -> idle -> engaged <-> stale -> idle. A lost device leads from idle to boot. Any state may enter
 * fault; only a reset leaves it, to boot. */
typedef enum hrt_state {
    HRT_BOOT = 0,      /* no frame from the device yet */
    HRT_SELF_TEST = 1, /* device sends; encoders are checked at rest, zero force */
    HRT_IDLE = 2,      /* zero force; waits for a fresh sample and permission to engage */
    HRT_ENGAGED = 3,   /* forces are rendered, after a ramp */
    HRT_STALE = 4,     /* no fresh sample: the force ramps down to zero */
    HRT_FAULT = 5,     /* latched, zero force; only an explicit reset leaves it */
    HRT_STATE_COUNT
} hrt_state;

typedef enum hrt_fault {
    HRT_FAULT_NONE = 0,
    HRT_FAULT_PARAMETER,        /* a parameter outside its table's range */
    HRT_FAULT_DEVICE_SILENT,    /* no encoder frame for device_timeout_us while in use */
    HRT_FAULT_DEVICE_REPORTED,  /* the device reports a fault of its own */
    HRT_FAULT_DEVICE_RESTARTED, /* the device restarted while in use */
    HRT_FAULT_BUS_OFF,          /* the bus driver reports bus-off or down */
    HRT_FAULT_ENCODER_RANGE,    /* a joint is outside its workspace */
    HRT_FAULT_ENCODER_JUMP,     /* faster than a hand or the device can move */
    HRT_FAULT_ENCODER_STUCK,    /* the count stays constant while the torque varies */
    HRT_FAULT_CLOCK,            /* time went backwards */
    HRT_FAULT_TICK_LATE,        /* the caller's loop paused for longer than tick_timeout_us while in use */
    HRT_FAULT_SELF_TEST,        /* self test not passed within self_test_timeout_us */
    HRT_FAULT_INTERNAL,         /* a non-finite force reached the last stage */
    HRT_FAULT_BUS_CONFLICT,     /* another sender uses this controller's frame ids on the bus */
    HRT_FAULT_COUNT
} hrt_fault;

/* Bits: limits active in this tick. They are neither faults nor latched. */
typedef enum hrt_limit {
    HRT_LIMIT_HORIZON = 1, /* sample age or displacement beyond the horizon, and clamped to it */
    HRT_LIMIT_FORCE = 2,   /* force vector at the tip */
    HRT_LIMIT_AXIS = 4,    /* torque of a joint */
    HRT_LIMIT_SLEW = 8,
    HRT_LIMIT_POWER = 16,
    HRT_LIMIT_STIFFNESS = 32, /* received or estimated stiffness scaled down */
    HRT_LIMIT_PASSIVITY = 64, /* the passivity controller dissipates */
    HRT_LIMIT_COUPLING = 128, /* the virtual coupling carries the force */
    HRT_LIMIT_RAMP = 256,     /* engaging */
    HRT_LIMIT_PATCH = 512,    /* `local_model` has no usable patch and falls back to `tangent` or `position` */
    HRT_LIMIT_PAUSE =
        1024, /* late tick, late encoder frame or the device's watchdog: forces drop to zero and ramp up again */
    HRT_LIMIT_UNSTABLE = 2048,  /* the newest sample reports a failed simulation step: the force ramps down */
    HRT_LIMIT_REPEATED = 4096,  /* the newest sample repeats an older reaction and does not count as fresh */
    HRT_LIMIT_FORCE_ONLY = 8192 /* only the force of the newest sample is used */
} hrt_limit;

/* The extrapolators, one row each: name in C, name in text, law (core/extrapolate.c). Messages carry their numbers, so
 * append new ones at the end. */
#define HRT_EXTRAPOLATORS(ROW)                                                                                         \
    ROW(HOLD, "hold", law_hold)                                                                                        \
    ROW(TIME, "time", law_time)                                                                                        \
    ROW(POSITION, "position", law_position)                                                                            \
    ROW(BROYDEN, "broyden", law_broyden)                                                                               \
    ROW(TANGENT, "tangent", law_tangent)                                                                               \
    ROW(LOCAL_MODEL, "local_model", law_off_patch)            /* used off the patch; on it: core/local_model.c */      \
    ROW(PAPER_POSITION, "paper_position", law_paper_position) /* unsigned ratio as published; for comparison only */   \
    ROW(ADAPTIVE, "adaptive", law_off_patch)                  /* blend of the others: core/adaptive.c */
#define HRT_EXTRAPOLATOR_VALUE(id, name, law) HRT_##id,
typedef enum hrt_extrapolator { HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_VALUE) HRT_EXTRAPOLATOR_COUNT } hrt_extrapolator;
/* String literals of all names in the order of their numbers, each after a blank or a bar. */
#define HRT_EXTRAPOLATOR_BLANK(id, name, law) " " name
#define HRT_EXTRAPOLATOR_BAR(id, name, law) "|" name
#define HRT_EXTRAPOLATOR_NAMES HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_BLANK)
#define HRT_EXTRAPOLATOR_CHOICE (&HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_BAR)[1]) /* without the first bar */

/* ------------------------------------------------------------------------------------------------ parameters */

typedef struct hrt_device_type hrt_device_type;

/* 0 omits device and joint names and reach limits from firmware; they are then null and 0. */
#ifndef HRT_WITH_WORDS
#define HRT_WITH_WORDS 1
#endif

/* 0 omits tools without a trocar from firmware. */
#ifndef HRT_WITH_FREE
#ifdef HRT_ONE_DEVICE
#define HRT_WITH_FREE 0
#else
#define HRT_WITH_FREE 1
#endif
#endif

/* Parameters of a controller. params.c holds range, unit and default of each; the device's description holds the
 * profile's defaults. hrt_params_default or hrt_params_of_device fills them, a profile file changes them. Joint units:
 * rad, m, or 1 for a grip. */
typedef struct hrt_params {
    const hrt_device_type *device;
    float period_us; /* of the ticks, set by their caller and not by a profile; default 2000 */
    /* the device's profile */
    float counts_per_unit[HRT_JOINTS]; /* 1/joint unit */
    float count_zero[HRT_JOINTS];
    float joint_min[HRT_JOINTS], joint_max[HRT_JOINTS];
    float speed_max[HRT_JOINTS];  /* joint unit/s; a faster change is an encoder jump */
    float torque_max[HRT_MOTORS]; /* N m of a rotary joint, N of a sliding one */
    float force_max_N;            /* vector sum at the tip */
#if HRT_WITH_FREE
    float handle_torque_max_Nm; /* vector sum at the handle of a free instrument; 0: no torque there */
    float arm_m;                /* from the handle's point to the tip, along the shaft */
#endif
    /* rendered force */
    float axis_power_max_W;  /* delivered to the hand by one joint */
    float power_max_W;       /* delivered by all joints */
    float slew_max_N_s;      /* of the force vector */
    float axis_slew_max_N_s; /* along one world axis */
    float stiffness_max_N_m; /* Frobenius norm of a received or estimated K */
    /* extrapolation */
    float horizon_us;     /* maximum extrapolation in time beyond t_n */
    float horizon_m;      /* maximum displacement from P_n */
    float ratio_max;      /* maximum multiple of the last force difference */
    float standstill_m;   /* displacement below which differences carry no information: about one count */
    float blend_us;       /* blend time from zero to the recent peak force; smaller steps take proportionally less */
    float patch_stale_us; /* maximum age of a patch's t_n */
    /* watchdogs and ramps */
    float stale_us; /* age of t_n at which `engaged` becomes `stale` */
    float fade_us, ramp_us;
    float device_pause_us, tick_pause_us;     /* silence that drops the force, which then ramps up again */
    float device_timeout_us, tick_timeout_us; /* silence that raises a fault */
    float self_test_us, self_test_timeout_us;
    float stuck_us,
        stuck_torque; /* stuck: no new count for stuck_us while the torque varied by this share of torque_max */
    /* passivity and coupling */
    float passivity_damping_max_N_s_m;
    float passivity_reset_us; /* the energy account restarts after this time without force */
    float coupling_N_m;       /* stiffness above which the coupling carries the force; 0: off */
    float coupling_N_s_m;
    float velocity_filter_us; /* time constant of the velocity estimate */
} hrt_params;

typedef struct hrt_param_range {
    uint16_t offset; /* bytes into hrt_params */
    uint8_t count;
    float min, max;
} hrt_param_range;

typedef struct hrt_param_words {
    const char *name, *unit, *text;
} hrt_param_words;

extern const hrt_param_range hrt_param_table[];
extern const hrt_param_words hrt_param_text[]; /* row by row of the same parameters */
extern const int32_t hrt_param_count;

/* Sets the defaults of the first device in hrt_device_types. */
void hrt_params_default(hrt_params *params);
void hrt_params_of_device(hrt_params *params, const hrt_device_type *device);
/* Returns how many values of a row the device has: its joints, its motors, or one. */
int32_t hrt_param_values(const hrt_params *params, const hrt_param_range *row);
/* Returns the row of the first invalid parameter, -1 if all are valid. Invalid: not finite, outside its range, or a min
 * not below its max. */
int32_t hrt_params_check(const hrt_params *params);

/* ------------------------------------------------------------------------------------------------ samples */

/* 0 omits friction from firmware; patches with friction coefficients are then not used. */
#ifndef HRT_WITH_FRICTION
#define HRT_WITH_FRICTION 1
#endif

/* 0 omits the checks of patches against samples (core/evidence.c) from firmware: agreement of the force, and its drift.
 */
#ifndef HRT_WITH_EVIDENCE
#define HRT_WITH_EVIDENCE 1
#endif

/* 0 omits the law `adaptive` and its 8 kB of memory; it then runs as `local_model`. */
#ifndef HRT_WITH_ADAPTIVE
#define HRT_WITH_ADAPTIVE 1
#endif

#ifndef HRT_PATCH_MAX_VERTICES
#define HRT_PATCH_MAX_VERTICES 24
#define HRT_PATCH_MAX_TRIANGLES 32
#endif
enum {
    HRT_PATCH_DOFS = 3 * HRT_PATCH_MAX_VERTICES,
    HRT_PATCH_COMPLIANCE = HRT_PATCH_DOFS * (HRT_PATCH_DOFS + 1) / 2,
    HRT_PATCH_EDGES = 2 * HRT_PATCH_MAX_TRIANGLES, /* upper bound; a connected surface has vertices + triangles - 1 */
    HRT_NO_FACE = 255
};

/* Edges of a patch, triangles around each vertex, and blending of normals. hrt_patch_prepare computes it, outside the
 * tick. */
typedef struct hrt_patch_topology {
    uint8_t edge_count;
    uint8_t edge_vertex[HRT_PATCH_EDGES][2];       /* direction of the first triangle; the second runs against it */
    uint8_t edge_face[HRT_PATCH_EDGES][2];         /* HRT_NO_FACE: boundary of the patch */
    uint8_t face_edge[HRT_PATCH_MAX_TRIANGLES][3]; /* edge j: from corner j to corner j+1 */
    uint8_t fan_begin[HRT_PATCH_MAX_VERTICES + 1],
        fan_face[3 * HRT_PATCH_MAX_TRIANGLES]; /* triangles around each vertex */
    uint32_t boundary;                         /* bit v: vertex v is on the boundary */
    uint32_t creased;                          /* bit v: a crease passes through vertex v */
    uint8_t smooth[HRT_PATCH_MAX_TRIANGLES * (HRT_PATCH_MAX_TRIANGLES - 1) / 2 +
                   1]; /* smoothness between f and g < f, at f (f-1)/2 + g; 255: no crease */
} hrt_patch_topology;

/* The tissue's surface near the tool and its compliance. Immutable after hrt_patch_prepare.
 *
 * A grasper's patch holds the grasped vertices and one more node than vertices: the tip. For the tip, vertex_m is P_n,
 * and rest_m is the grasp's force on the tool at P_n without contact rows, N. The last three rows and columns of
 * compliance_m_N hold the vertex motion per tip motion (m/m) and the grasp's stiffness (N/m, negative semidefinite).
 * The others are the compliance of the grasped tissue. */
typedef struct hrt_patch {
    uint32_t seq; /* seq of its sample */
    int32_t topology_revision;
    int32_t vertex_count, triangle_count;
    uint32_t grasped; /* bit v: vertex v is grasped, and rows on grasped vertices alone are ignored; bit vertex_count,
                         the tip, is set too; 0: no grasp */
    float vertex_m[HRT_PATCH_DOFS];                /* positions without this tool's contact, relative to the trocar */
    float rest_m[HRT_PATCH_DOFS];                  /* undeformed positions; all zero: equal to vertex_m */
    int32_t face[HRT_PATCH_MAX_TRIANGLES];         /* persistent ids; all zero: the triangles' numbers */
    uint8_t triangle[3 * HRT_PATCH_MAX_TRIANGLES]; /* corners; normal outward */
    float compliance_m_N[HRT_PATCH_COMPLIANCE];    /* upper triangle, row by row, of a matrix with 3 rows per node */
    float contact_compliance_m_N;                  /* contact compliance of one station (docs/contact.md) */
    float force_cap_N;                             /* maximum force of one row; 0: 50 */
    float radius_m;
    float contact_length_m;
    float drag_s_m; /* drag per reaction and sliding speed (docs/contact.md) */
    float radiation_N_s_m,
        radiation_s; /* radiation damping, acting on the tip's speed less its mean over radiation_s */
    float friction_static, friction_kinetic; /* Coulomb coefficients; 0: no friction */
    hrt_patch_topology topology;
} hrt_patch;

static inline bool hrt_patch_grasps(const hrt_patch *patch) { return patch->grasped != 0; }
/* Returns the index of the tip in vertex_m and rest_m. */
static inline int32_t hrt_patch_tip(const hrt_patch *patch) { return 3 * patch->vertex_count; }
/* Returns the number of nodes: vertices, and the tip if there is a grasp. */
static inline int32_t hrt_patch_nodes(const hrt_patch *patch) {
    return patch->vertex_count + (hrt_patch_grasps(patch) ? 1 : 0);
}

/* Status of a sample from the simulation; the bits of force_sample_t.flags. */
typedef enum hrt_flag {
    HRT_FLAG_CAPPED = 1,
    HRT_FLAG_OVERFLOWED = 2,
    HRT_FLAG_OVERRAN = 4,
    HRT_FLAG_PATCH = 8,
    HRT_FLAG_UNCONVERGED = 16,
    HRT_FLAG_REPEATED = 32,
    HRT_FLAG_UNSTABLE = 64,
    HRT_FLAG_TOO_FAST = 128,
    HRT_FLAG_INSIDE = 256,
    HRT_FLAG_RELEASING = 512,
    HRT_FLAG_CUTTING = 1024 /* an active cautery: tissue may be removed at any time */
} hrt_flag;

/* Treatment of a sample by its flags, in rising order: the highest rule of all flags applies. */
typedef enum hrt_flag_rule {
    HRT_RULE_TAKE = 0,   /* all of it is used */
    HRT_RULE_FORCE_ONLY, /* force used; stiffness and patch ignored */
    HRT_RULE_NOT_FRESH,  /* ignored; the previous sample continues to age */
    HRT_RULE_FADE,       /* ignored, and the force ramps down at once, as without samples */
    HRT_RULE_REFUSE      /* rejected: it has an unknown flag */
} hrt_flag_rule;
hrt_flag_rule hrt_flags_rule(uint32_t flags);

/* Force sample (t_n, P_n, F_n) with stiffness and patch. `patch` must stay unchanged while extrapolation.patch points
 * to it. */
typedef struct hrt_sample {
    int64_t session;      /* session of the simulation */
    int64_t tool_session; /* session of the controller, echoed */
    int64_t t_us;         /* t_n on this controller's clock, echoed */
    uint32_t seq;         /* modulo 2^32 */
    int32_t topology_revision;
    int32_t stiffness_kind; /* 0 none, 1 estimated, 2 exact */
    bool unilateral;        /* probe: tissue pushes but never pulls */
    bool stiffness_bounded; /* hrt_sample_check scaled the stiffness down */
    uint16_t flags;         /* hrt_flag */
    float tip_m[3];
    float force_N[3];
    float stiffness_N_m[9]; /* dF/dP, row-major */
    const hrt_patch *patch; /* null: none */
} hrt_sample;

/* Returns whether seq a is after b, modulo 2^32. */
static inline bool hrt_seq_after(uint32_t a, uint32_t b) { return (int32_t)(a - b) > 0; }

typedef enum hrt_reject {
    HRT_ACCEPT = 0,
    HRT_REJECT_NOT_FINITE,
    HRT_REJECT_HUGE,       /* force, stiffness or position out of plausible bounds */
    HRT_REJECT_ASYMMETRIC, /* invalid compliance: wrong counts or indices, or not positive semidefinite within rounding
                            */
    HRT_REJECT_INDEX,
    HRT_REJECT_FOREIGN, /* another tool session or instrument */
    HRT_REJECT_FUTURE,  /* t_n later than now */
    HRT_REJECT_OLD,     /* duplicate, or older than the newest */
    HRT_REJECT_COUNT
} hrt_reject;
const char *hrt_reject_text(hrt_reject reject);

/* Checks that a sample is finite and bounded; call it outside the tick. Scales a stiffness above stiffness_max_N_m down
 * instead of rejecting it. */
hrt_reject hrt_sample_check(hrt_sample *sample, const hrt_params *params);
/* Checks a patch and computes its topology; call it outside the tick. Indices must be valid, values finite, the
 * compliance positive semidefinite within rounding (Cholesky in `scratch`). */
hrt_reject hrt_patch_prepare(hrt_patch *patch, float scratch[HRT_PATCH_COMPLIANCE]);

/* ------------------------------------------------------------------------------------------------ kinematics */
/* core/device_NAME.h holds a device's geometry and parameters; motion/kinematics.h declares the same geometry in the
 * simulation's precision. */

/* Mounting of the device in the scene. The columns of r (row-major) are the device's x, y, z along world axes. z is the
 * shaft's direction into the body at rest; y is `up`. */
typedef struct hrt_axes {
    float r[9];
    const hrt_device_type *device;
    bool is_free; /* the instrument has no trocar: positions are relative to its origin, and hrt_direction is its
                     shaft's */
} hrt_axes;

typedef struct hrt_joint_type {
    /* defaults of the profile */
    float counts_per_unit, min, max, speed_max; /* 1/unit, unit, unit, unit/s */
#if HRT_WITH_WORDS
    /* limits for any profile: a message beyond them is rejected */
    float reach_min, reach_max;
    const char *name; /* column name with unit, as in pitch_rad */
#endif
} hrt_joint_type;

struct hrt_device_type {
#if HRT_WITH_WORDS
    const char *name, *text;
    const char *torque_name[HRT_MOTORS]; /* column names of the torques, with units */
#endif
    int32_t joints, motors; /* joints 1..HRT_JOINTS; the first `motors`, 1..HRT_MOTORS, are driven and move the tip */
    hrt_joint_type joint[HRT_JOINTS];
    float torque_max[HRT_MOTORS], force_max_N;
    float rounding_m; /* maximum distance within reach between the tips that both precisions compute from the same
                         joints */
    int32_t insertion, roll, grip;     /* joint that slides along the shaft (joints 0 and 1 are then its pitch and yaw),
                                          rotates about it, closes the jaws; -1: none */
    bool tilts;                        /* joints 5 and 6 are the tilt of the shaft from z towards x and y, rad */
    float handle_torque_max_Nm, arm_m; /* defaults of the parameters; 0: the device renders no torque at its handle */
    bool slides; /* the first two motors slide too: CAN frames carry their forces by the millinewton, as the third's */
#ifndef HRT_ONE_DEVICE
    /* tip: position relative to the trocar, m. jacobian: d tip / d (driven joints), row-major 3x3; columns without a
     * motor are zero. inverse: driven joints for a tip position; returns false if there are none. */
    void (*tip)(const hrt_axes *axes, const float joint[HRT_JOINTS], float tip_m[3]);
    void (*jacobian)(const hrt_axes *axes, const float joint[HRT_JOINTS], float jacobian[9]);
    bool (*inverse)(const hrt_axes *axes, const float tip_m[3], float joint3[3]);
#endif
};

/* The devices of this build; the first is the default. Messages carry their numbers, so append new ones at the end. */
extern const hrt_device_type *const hrt_device_types[];
extern const int32_t hrt_device_type_count;
/* Returns the device's number, -1 for an unknown name. */
int32_t hrt_device_type_find(const char *name);
int32_t hrt_device_type_number(const hrt_device_type *device);

/* Sets the axes of an instrument in a trocar from a direction and an up vector of any length. Returns false, with the
 * identity, if they are parallel, zero or not finite. */
bool hrt_axes_along(hrt_axes *axes, const hrt_device_type *device, const float axis[3], const float up[3]);
void hrt_tip(const hrt_axes *axes, const float joint[HRT_JOINTS], float tip_m[3]);
/* Computes d tip / d (driven joints), row-major 3x3. */
void hrt_jacobian(const hrt_axes *axes, const float joint[HRT_JOINTS], float jacobian[9]);
/* Computes the driven joints for a tip position. Returns false if there are none (at the trocar itself, for a gimbal).
 */
bool hrt_inverse(const hrt_axes *axes, const float tip_m[3], float joint3[3]);
/* Computes the unit direction of a free instrument's shaft, towards the tip: the handle's, or `axis` if the device has
 * no tilt. */
void hrt_direction(const hrt_axes *axes, const float joint[HRT_JOINTS], float direction[3]);
void hrt_counts_to_joint(const hrt_params *params, const int32_t count[HRT_JOINTS], float joint[HRT_JOINTS]);
/* Returns the count of joint `j` at a value, not rounded. */
float hrt_count_of_joint(const hrt_params *params, int j, float value);

/* ------------------------------------------------------------------------------------------------ extrapolation alone
 */

enum { HRT_CONTACT_ROWS = 16 };

/* Contact row: a station of the tool's axis (0 the tip, one radius apart) against a feature of the patch. */
typedef struct hrt_contact_row {
    uint8_t triangle, station, feature; /* feature: 0 the face, 1+j edge j, 4+j corner j */
    float share;                        /* share of the station's contact compliance */
    float weight[3], normal[3];         /* normal points from tool to tissue */
    float gap_m;
    float lambda_N;
} hrt_contact_row;

enum { HRT_ANDERSON_DEPTH = 2 };

/* Anderson acceleration of the fixed-point iterations of `local_model` (contact_law/anderson.h). */
typedef struct hrt_anderson {
    bool used; /* some entry is not zero */
    uint8_t next;
    float residual_change_N[HRT_ANDERSON_DEPTH][HRT_PATCH_DOFS], step_N[HRT_ANDERSON_DEPTH][HRT_PATCH_DOFS];
} hrt_anderson;

/* State of friction at a station, kept between ticks (contact_law/friction.h). */
typedef struct hrt_friction_state {
    uint8_t station;
    float force_N[3];   /* force on the tissue */
    float stretch_N[3]; /* stretch of the contact compliance over that compliance: the force while sticking */
    float stick_state;  /* 1 stuck .. 0 slid */
} hrt_friction_state;

typedef struct hrt_friction_history {
    uint32_t known; /* bit v: u_m of vertex v is valid; 0: tip_m is invalid too */
    int32_t count;
    hrt_friction_state at[HRT_CONTACT_ROWS];
    float u_m[HRT_PATCH_DOFS], tip_m[3]; /* displacements of the vertices and position of the tip in the last tick */
    float direction[3];                  /* of a free tool's shaft in the last tick */
} hrt_friction_history;

/* An earlier sample, for differences. */
typedef struct hrt_past {
    int64_t t_us;
    float tip_m[3], force_N[3];
#if HRT_WITH_EVIDENCE
    float stiffness_N_m[9]; /* all zero: none */
#endif
} hrt_past;

/* The laws that `adaptive` blends: `hold`, `position`, the received or estimated stiffness, and the patch. */
enum { HRT_ADAPTIVE_HOLD, HRT_ADAPTIVE_POSITION, HRT_ADAPTIVE_STIFFNESS, HRT_ADAPTIVE_PATCH, HRT_ADAPTIVE_LAWS };
enum { HRT_ADAPTIVE_RECORDS = 128 }; /* one per 2 ms at most: more than three periods of a 25 Hz sample */

/* Force of each law in one tick. */
typedef struct hrt_adaptive_record {
    int64_t t_us;
    bool with_patch;
    float force_N[HRT_ADAPTIVE_LAWS][3];
} hrt_adaptive_record;

typedef struct hrt_adaptive {
    float loss[HRT_ADAPTIVE_LAWS];   /* decayed sums of squared errors, over the square of recent_peak_N */
    float weight[HRT_ADAPTIVE_LAWS]; /* weights in the last tick; their sum is 1 */
    float recent_peak_N;             /* decayed maximum force of recent samples */
    int32_t count, newest;           /* number of records in the ring buffer, index of the newest */
    hrt_adaptive_record record[HRT_ADAPTIVE_RECORDS];
} hrt_adaptive;

/* Shaft of a tool without a trocar. With one it runs from the origin through the tip. */
typedef struct hrt_shaft {
    bool is_free;
    float direction[3]; /* unit, towards the tip; unused with a trocar */
} hrt_shaft;

/* State of the tool's contact with a patch, kept between ticks. */
typedef struct hrt_touch {
    hrt_shaft shaft;     /* set before each tick's force */
    int64_t drag_us;     /* time of the last solve against a patch */
    float drag_tip_m[3]; /* tip position at that time */
    float mean_m_s[3];   /* mean tip velocity in contact, over radiation_s */
    int32_t row_count;
    hrt_contact_row row[HRT_CONTACT_ROWS];
    float patch_force_N[HRT_PATCH_DOFS]; /* forces of the rows on the patch */
    hrt_anderson anderson;
#if HRT_WITH_FRICTION
    hrt_friction_history friction;
#endif
} hrt_touch;

typedef struct hrt_extrapolation {
    hrt_extrapolator which;
    int32_t have; /* 0: no sample; 1: `now`; 2: `previous` too, and the difference is caused by motion alone */
    hrt_sample now;
    hrt_past previous; /* reference sample for differences */
#if HRT_WITH_EVIDENCE
    hrt_past candidate; /* next reference, once it is old enough */
#endif
    float broyden_N_m[9];
    bool broyden_bounded;
    float blend_offset_N[3]; /* during a blend: last force less the new law's force */
    int64_t blend_us_left;   /* time of the last blended tick */
    float recent_peak_N;     /* decayed maximum force of recent seconds */
    uint8_t blending;        /* blend in progress, 1: to another law, 2: to another tissue */
    uint8_t changed;         /* ticks left in which the offset is measured again */
    bool patch_left;         /* the tool left the newest patch, or the patch contradicts its sample */
    bool on_patch;
    const hrt_patch *patch; /* patch of the newest sample that had one */
    int64_t patch_us;
#if HRT_WITH_EVIDENCE
    float interval_s;              /* between the last two samples */
    float foretold_N2, came_N2;    /* predicted changes squared, and actual times predicted changes */
    float drift_N_s[3];            /* drift of the patch's force without motion */
    float drift_lasted, drift_was; /* decayed sums, N^2/s^2: correlation of successive drifts, and their squares */
    float patch_N[3];              /* force of the patch in the last tick */
    float tick_tip_m[3];           /* tip position in the previous tick; tick_us is its time */
    int64_t tick_us;
    bool cutting;        /* the newest sample is of an active cautery */
    uint8_t patch_ticks; /* consecutive ticks on patches of this tissue, up to 2 */
#endif
#if HRT_WITH_ADAPTIVE
    hrt_adaptive adaptive;
#endif
    bool cut; /* the tissue was cut between the last two samples */
    float last_N[3];
    bool last_valid;
    uint32_t limits; /* hrt_limit bits of the last evaluation */
    hrt_touch touch;
} hrt_extrapolation;

void hrt_extrapolation_reset(hrt_extrapolation *x, hrt_extrapolator which);
/* Selects another law while running; the force blends over without a jump. */
void hrt_extrapolation_select(hrt_extrapolation *x, hrt_extrapolator which);
/* Takes over a newer sample; hrt_tick has checked the order. Stiffness and patch are ignored where its flags require
 * that. */
void hrt_extrapolation_sample(hrt_extrapolation *x, const hrt_params *params, const hrt_sample *sample);
/* Computes the force on the tool at `tip_m`, N. It is zero without a sample. */
void hrt_extrapolation_force(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3],
                             float force_N[3]);
const char *hrt_extrapolator_name(hrt_extrapolator which);
/* Returns false for an unknown name. */
bool hrt_extrapolator_find(const char *name, hrt_extrapolator *which);

/* ------------------------------------------------------------------------------------------------ the tick */

typedef struct hrt_input {
    int64_t encoder_us; /* time of reception of the newest encoder frame; 0: none yet */
    int32_t count[HRT_JOINTS];
    uint32_t device_session; /* changes when the device restarts; 0: unknown */
    uint8_t device_fault;    /* fault code of the device; 0: none */
    int64_t bus_conflict_us; /* time of the last frame of another sender with our ids; 0: never */
    bool device_watchdog;    /* the device's watchdog dropped the torque and needs "motors off" first */
    bool pedal;              /* pedal of the cautery */
    bool bus_ok;
    bool enable; /* permission to engage */
    bool reset;  /* true in one tick: leave `fault` */
    bool passivity;
    bool coupling;
    hrt_extrapolator extrapolator;
} hrt_input;

typedef struct hrt_result {
    hrt_state state;
    hrt_fault fault;      /* first fault, latched */
    int32_t fault_detail; /* joint, parameter row or device code */
    uint32_t limits;      /* hrt_limit bits of this tick */
    bool motors_on;
    float torque[HRT_MOTORS]; /* commanded torque, N m or N */
    float force_N[3];         /* commanded force at the tip, world axes */
#if HRT_WITH_FREE
    float handle_torque_Nm[3]; /* commanded torque about the handle's point, along the device's axes as a cursor's
                                  `torque` */
#endif
    float joint[HRT_JOINTS];
    float tip_m[3]; /* relative to the trocar */
    float velocity_m_s[3];
    float gain;            /* gain of the ramps up and down, 0..1 */
    float passivity_J;     /* energy delivered to the hand since engaging, net; negative: absorbed */
    int64_t sample_age_us; /* age of t_n; -1: no sample */
    hrt_extrapolator extrapolator;
    bool pedal;
} hrt_result;

typedef struct hrt_counters {
    uint32_t ticks;
    uint32_t samples_received, samples_late, samples_lost, samples_rejected;
} hrt_counters;

/* State of a controller, owned by the caller; it holds no pointer into itself. Read it for tests and logs; change it
 * only through hrt_tick. */
typedef struct hrt_controller {
    hrt_params params;
    hrt_axes axes;
    int64_t session;
    hrt_state state;
    hrt_fault fault;
    int32_t fault_detail;
    int64_t state_since_us, last_tick_us, good_since_us;
    bool ticked;
    /* device */
    bool device_seen;
    uint32_t device_session;
    int64_t encoder_us;
    int32_t count[HRT_JOINTS];
    int64_t count_changed_us[HRT_JOINTS];
    float torque_low[HRT_MOTORS],
        torque_high[HRT_MOTORS]; /* range of commanded torque since the last change of count */
    float joint[HRT_JOINTS], tip_m[3], velocity_m_s[3], joint_velocity[HRT_JOINTS];
    float joint_rate[HRT_JOINTS],
        joint_next[HRT_JOINTS]; /* velocity over the last frame, and its linear prediction, unfiltered */
    /* simulation */
    bool sample_seen;
    uint8_t sample_rule; /* hrt_flag_rule of the newest sample */
    uint32_t sample_seq;
    int64_t sim_session;
    int64_t sample_us; /* t_n of the newest fresh sample */
    hrt_extrapolation extrapolation;
    /* force to torques */
    float gain;
    uint32_t limits;
    float force_N[3]; /* last commanded force */
    float torque[HRT_MOTORS];
#if HRT_WITH_FREE
    float handle_torque_Nm[3]; /* world axes */
#endif
    float energy_J; /* energy absorbed from the hand */
    float debt_J;   /* energy delivered beyond power_max_W and not yet compensated */
    int64_t force_free_since_us;
    bool proxy_valid;
    float proxy_m[3];
    hrt_counters counters;
} hrt_controller;

/* Initialises a controller in `boot`. Invalid parameters lead to `fault` at the first tick. session: new at every
 * start; the simulation echoes it. */
void hrt_init(hrt_controller *controller, const hrt_params *params, const hrt_axes *axes, int64_t session);
/* Computes one tick; call it every params.period_us. `newest`: a sample that passed hrt_sample_check, or null if none
 * came since the last tick. */
void hrt_tick(hrt_controller *controller, int64_t now_us, const hrt_input *input, const hrt_sample *newest,
              hrt_result *result);

const char *hrt_state_name(hrt_state state);
const char *hrt_fault_name(hrt_fault fault);
/* Returns a sentence for the operator: what happened, what to do. */
const char *hrt_fault_text(hrt_fault fault);

#ifdef __cplusplus
}
#endif
#endif
