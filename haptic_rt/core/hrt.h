/* The controller: one pure function of time, device input and the newest force sample. No thread, clock, heap, lock,
 * log or operating system; `float` only; every loop bounded. The same code runs under the Linux loop, on a virtual
 * clock, and on a microcontroller.
 *
 * Time is int64 microseconds of one clock, the caller's; floats hold only differences. Positions are metres relative to
 * the trocar, forces newtons acting on the tool, both along the scene's world axes; the caller moves the origin
 * (io/node.h does). States, transitions, faults, limits: docs/controller.md.
 *
 * Over 400 lines: it is the one header that a firmware includes. */
#ifndef HRT_H
#define HRT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The most joints and driven joints of any device; its description (hrt_device_type) says how many it has. What it has
 * not stays zero. The driven ones come first. */
#ifdef HRT_ONE_DEVICE /* firmware for the Impulse Engine alone */
enum { HRT_JOINTS = 5, HRT_MOTORS = 3 };
#else
enum { HRT_JOINTS = 7, HRT_MOTORS = 3 };
#endif
/* The Impulse Engine's joints in their order. */
enum { HRT_PITCH, HRT_YAW, HRT_INSERTION, HRT_ROLL, HRT_GRIP };

/* boot -> self_test -> idle -> engaged <-> stale -> idle; idle -> boot when the device goes; any -> fault; fault ->
 * boot by reset alone. */
typedef enum hrt_state {
    HRT_BOOT = 0,      /* no word from the device yet */
    HRT_SELF_TEST = 1, /* device alive; encoders watched at rest, zero force */
    HRT_IDLE = 2,      /* healthy; zero force; waits for a fresh sample and permission */
    HRT_ENGAGED = 3,   /* forces rendered, ramped in */
    HRT_STALE = 4,     /* the simulation went silent: force fades to zero */
    HRT_FAULT = 5,     /* latched; zero force; left by explicit reset */
    HRT_STATE_COUNT
} hrt_state;

typedef enum hrt_fault {
    HRT_FAULT_NONE = 0,
    HRT_FAULT_PARAMETER,        /* a parameter outside its table's range */
    HRT_FAULT_DEVICE_SILENT,    /* no encoder frame for device_timeout_us while in use */
    HRT_FAULT_DEVICE_REPORTED,  /* the device's own fault */
    HRT_FAULT_DEVICE_RESTARTED, /* it started anew while in use */
    HRT_FAULT_BUS_OFF,          /* the bus driver reports bus-off or down */
    HRT_FAULT_ENCODER_RANGE,    /* joint outside the workspace */
    HRT_FAULT_ENCODER_JUMP,     /* faster than a hand or the device can move */
    HRT_FAULT_ENCODER_STUCK,    /* count frozen while torque should move it */
    HRT_FAULT_CLOCK,            /* time went backwards */
    HRT_FAULT_TICK_LATE,        /* the caller's loop stood still for longer than tick_timeout_us while in use */
    HRT_FAULT_SELF_TEST,        /* self test not passed within its time */
    HRT_FAULT_INTERNAL,         /* a force that is not finite reached the last stage */
    HRT_FAULT_BUS_CONFLICT,     /* somebody else sends this controller's frames on the bus */
    HRT_FAULT_COUNT
} hrt_fault;

/* Bits: a limit is active in this tick. Not faults, not latched. */
typedef enum hrt_limit {
    HRT_LIMIT_HORIZON = 1, /* sample or displacement beyond the horizon: extrapolation held there */
    HRT_LIMIT_FORCE = 2,   /* vector sum */
    HRT_LIMIT_AXIS = 4,    /* a joint's torque */
    HRT_LIMIT_SLEW = 8,
    HRT_LIMIT_POWER = 16,
    HRT_LIMIT_STIFFNESS = 32, /* received or estimated stiffness bounded */
    HRT_LIMIT_PASSIVITY = 64, /* the passivity controller dissipates */
    HRT_LIMIT_COUPLING = 128, /* the virtual coupling carries the force */
    HRT_LIMIT_RAMP = 256,     /* engaging */
    HRT_LIMIT_PATCH = 512,    /* `local_model` has no usable patch and runs as `tangent` or `position` */
    HRT_LIMIT_PAUSE = 1024, /* a late tick, a late encoder frame or the device's watchdog: forces dropped, will ramp in
                               again */
    HRT_LIMIT_UNSTABLE = 2048,  /* the newest sample says that the simulation's step failed: the force fades */
    HRT_LIMIT_REPEATED = 4096,  /* the newest sample repeats an older reaction: it does not count as fresh */
    HRT_LIMIT_FORCE_ONLY = 8192 /* of the newest sample the force alone is used */
} hrt_limit;

/* The extrapolators, one row each: name in C, name in words, law (core/extrapolate.c). Messages carry their numbers, so
 * that a new one goes to the end. */
#define HRT_EXTRAPOLATORS(ROW)                                                                                         \
    ROW(HOLD, "hold", law_hold)                                                                                        \
    ROW(TIME, "time", law_time)                                                                                        \
    ROW(POSITION, "position", law_position)                                                                            \
    ROW(BROYDEN, "broyden", law_broyden)                                                                               \
    ROW(TANGENT, "tangent", law_tangent)                                                                               \
    ROW(LOCAL_MODEL, "local_model", law_off_patch)            /* off its patch; on it: core/local_model.c */           \
    ROW(PAPER_POSITION, "paper_position", law_paper_position) /* unsigned ratio as printed; for comparison only */     \
    ROW(ADAPTIVE, "adaptive", law_off_patch)                  /* a blend of the others: core/adaptive.c */
#define HRT_EXTRAPOLATOR_VALUE(id, name, law) HRT_##id,
typedef enum hrt_extrapolator { HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_VALUE) HRT_EXTRAPOLATOR_COUNT } hrt_extrapolator;
/* All names in a string literal, in the order of their numbers, each after a blank or after a bar. */
#define HRT_EXTRAPOLATOR_BLANK(id, name, law) " " name
#define HRT_EXTRAPOLATOR_BAR(id, name, law) "|" name
#define HRT_EXTRAPOLATOR_NAMES HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_BLANK)
#define HRT_EXTRAPOLATOR_CHOICE (&HRT_EXTRAPOLATORS(HRT_EXTRAPOLATOR_BAR)[1]) /* without the first bar */

/* ------------------------------------------------------------------------------------------------ parameters */

typedef struct hrt_device_type hrt_device_type;

/* 0 leaves names of devices and joints, and what no such device says, out of a small part's flash: they are then null
 * and 0. */
#ifndef HRT_WITH_WORDS
#define HRT_WITH_WORDS 1
#endif

/* Range, unit and default of each float stand in params.c, the profile's defaults in the device's description. Filled
 * by hrt_params_default() or hrt_params_of_device(), changed by a profile file. Joint units: rad, m, or 1 for a grip.
 */
typedef struct hrt_params {
    const hrt_device_type *device;
    /* the device's profile */
    float counts_per_unit[HRT_JOINTS]; /* 1/joint unit */
    float count_zero[HRT_JOINTS];
    float joint_min[HRT_JOINTS], joint_max[HRT_JOINTS];
    float speed_max[HRT_JOINTS];  /* joint unit/s: faster is a jump */
    float torque_max[HRT_MOTORS]; /* N m of a turning joint, N of a sliding one */
    float force_max_N;            /* vector sum at the tip */
    /* what is rendered */
    float axis_power_max_W;  /* handed to the hand by one joint */
    float power_max_W;       /* by all */
    float slew_max_N_s;      /* of the vector */
    float axis_slew_max_N_s; /* of one world axis */
    float stiffness_max_N_m; /* Frobenius norm of K, received or estimated */
    /* extrapolation */
    float horizon_us;     /* of time, beyond t_n */
    float horizon_m;      /* of displacement, from P_n */
    float ratio_max;      /* largest multiple of the last difference */
    float standstill_m;   /* displacement below which differences say nothing: about one count */
    float blend_us;       /* bridge from no force to the whole of it; a smaller difference takes its share */
    float patch_stale_us; /* age of t_n of the patch */
    /* watchdogs and ramps */
    float stale_us; /* age of t_n at which `engaged` becomes `stale` */
    float fade_us, ramp_us;
    float device_pause_us, tick_pause_us;     /* silence that drops the force, to be ramped in anew */
    float device_timeout_us, tick_timeout_us; /* silence that is a fault */
    float self_test_us, self_test_timeout_us;
    float stuck_us, stuck_torque; /* stuck: no count for so long while the torque varied by this share of torque_max */
    /* passivity and coupling */
    float passivity_damping_max_N_s_m;
    float passivity_reset_us; /* without force for so long: the account starts anew */
    float coupling_N_m;       /* 0: off. Stiffness above which the coupling carries the force */
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

/* Of the first device of the table (hrt_device_types). */
void hrt_params_default(hrt_params *params);
void hrt_params_of_device(hrt_params *params, const hrt_device_type *device);
/* How many values of a row the device has: its joints, its motors, or one. */
int32_t hrt_param_values(const hrt_params *params, const hrt_param_range *row);
/* The row of the first parameter that is not finite or outside its range (or whose min is not below its max), -1 if all
 * are good. */
int32_t hrt_params_check(const hrt_params *params);

/* ------------------------------------------------------------------------------------------------ samples */

/* 0 leaves friction out of a small part's flash and memory: a patch with coefficients is then no patch. */
#ifndef HRT_WITH_FRICTION
#define HRT_WITH_FRICTION 1
#endif

/* 0 leaves out of a small part's flash what samples say of a patch: whether it gives their force, and how fast that
 * drifts. */
#ifndef HRT_WITH_EVIDENCE
#define HRT_WITH_EVIDENCE 1
#endif

/* 0 leaves the law `adaptive` and the 8 kB of its memory out: it then runs as `local_model`. */
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
    HRT_PATCH_EDGES = 2 * HRT_PATCH_MAX_TRIANGLES, /* a piece of surface has fewer: vertices + triangles - 1 */
    HRT_NO_FACE = 255
};

/* Which triangles share what, and how far their normals blend; filled by hrt_patch_prepare, so that the tick finds it
 * ready. */
typedef struct hrt_patch_topology {
    uint8_t edge_count;
    uint8_t edge_vertex[HRT_PATCH_EDGES][2];       /* as its first triangle runs along it, and the second against it */
    uint8_t edge_face[HRT_PATCH_EDGES][2];         /* HRT_NO_FACE: the patch ends there */
    uint8_t face_edge[HRT_PATCH_MAX_TRIANGLES][3]; /* edge j: corner j to corner j+1 */
    uint8_t fan_begin[HRT_PATCH_MAX_VERTICES + 1], fan_face[3 * HRT_PATCH_MAX_TRIANGLES]; /* triangles at each vertex */
    uint32_t border;  /* bit v: vertex v is on the patch's edge */
    uint32_t creased; /* bit v: not all triangles at vertex v are smooth to each other */
    uint8_t smooth[HRT_PATCH_MAX_TRIANGLES * (HRT_PATCH_MAX_TRIANGLES - 1) / 2 +
                   1]; /* of f and g < f at f (f-1)/2 + g; 255: the undeformed surface is smooth */
} hrt_patch_topology;

/* A piece of the tissue's surface near the tool and its compliance. Immutable once it has passed hrt_patch_prepare.
 *
 * A grasper's holds what lies between its jaws. Then it has one place more than vertices, and the tip stands there:
 * vertex_m has P_n, rest_m the force of the hold on the tool at P_n without rows of contact (N), and the last three
 * rows and columns of compliance_m_N are how the vertices follow the tip (m/m) and the stiffness of the hold (N/m,
 * negative semidefinite); the others are the compliance of the tissue as it is held. */
typedef struct hrt_patch {
    uint32_t seq; /* of its sample */
    int32_t topology_revision;
    int32_t vertex_count, triangle_count;
    uint32_t grasped; /* bit v: vertex v is between the jaws: rows on such alone are no obstacle; bit vertex_count, the
                      tip's, is set; 0: there is no hold */
    float vertex_m[HRT_PATCH_DOFS];                /* without this tool's contact, relative to the trocar */
    float rest_m[HRT_PATCH_DOFS];                  /* undeformed; all zero: as vertex_m */
    int32_t face[HRT_PATCH_MAX_TRIANGLES];         /* persistent ids of the triangles; all zero: their numbers */
    uint8_t triangle[3 * HRT_PATCH_MAX_TRIANGLES]; /* normal outward */
    float compliance_m_N[HRT_PATCH_COMPLIANCE];    /* upper triangle, row by row, of (3 places)^2 */
    float contact_compliance_m_N;                  /* of a station: a sphere of the tool (docs/contact.md) */
    float force_cap_N;                             /* of one row; 0: 50 */
    float radius_m;
    float contact_length_m;
    float drag_s_m; /* drag between tool and tissue, of the reaction and the speed of sliding (docs/contact.md) */
    float radiation_N_s_m, radiation_s; /* dashpot of what waves carry off, on the speed less its mean of so long */
    float friction_static, friction_kinetic; /* coefficients of what has rested and of what has slid; 0: no friction */
    hrt_patch_topology topology;
} hrt_patch;

static inline bool hrt_patch_grasps(const hrt_patch *patch) { return patch->grasped != 0; }
/* Where the tip's place begins in vertex_m and rest_m. */
static inline int32_t hrt_patch_tip(const hrt_patch *patch) { return 3 * patch->vertex_count; }
/* Vertices, and the tip where something is held. */
static inline int32_t hrt_patch_nodes(const hrt_patch *patch) {
    return patch->vertex_count + (hrt_patch_grasps(patch) ? 1 : 0);
}

/* What the simulation says of a sample; the bits of force_sample_t.flags. */
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
    HRT_FLAG_CUTTING = 1024 /* a cautery at work: what it touches may go at any time */
} hrt_flag;

/* What the controller does about it, in rising order: of several flags the highest rule holds. */
typedef enum hrt_flag_rule {
    HRT_RULE_TAKE = 0,   /* used whole */
    HRT_RULE_FORCE_ONLY, /* the force is used, stiffness and patch are not */
    HRT_RULE_NOT_FRESH,  /* nothing of it is used, and the sample before goes on growing old */
    HRT_RULE_FADE,       /* the same, and the force fades at once, as when the simulation falls silent */
    HRT_RULE_REFUSE      /* a flag that this controller does not know: no sample */
} hrt_flag_rule;
hrt_flag_rule hrt_flags_rule(uint32_t flags);

/* (t_n, P_n, F_n) and what comes with it. `patch` must stay unchanged for as long as extrapolation.patch points to it.
 */
typedef struct hrt_sample {
    int64_t session;      /* of the simulation */
    int64_t tool_session; /* echoed: must be this controller's */
    int64_t t_us;         /* echoed, this controller's clock */
    uint32_t seq;         /* modulo 2^32 */
    int32_t topology_revision;
    int32_t stiffness_kind; /* 0 none, 1 estimated, 2 exact */
    bool unilateral;        /* a probe: tissue pushes, never pulls */
    bool stiffness_bounded; /* set by hrt_sample_check when it scaled the stiffness down */
    uint16_t flags;         /* hrt_flag */
    float tip_m[3];
    float force_N[3];
    float stiffness_N_m[9]; /* dF/dP, row-major */
    const hrt_patch *patch; /* null: none */
} hrt_sample;

/* seq a after b, modulo 2^32. */
static inline bool hrt_seq_after(uint32_t a, uint32_t b) { return (int32_t)(a - b) > 0; }

typedef enum hrt_reject {
    HRT_ACCEPT = 0,
    HRT_REJECT_NOT_FINITE,
    HRT_REJECT_HUGE,       /* force, stiffness or position beyond any sense */
    HRT_REJECT_ASYMMETRIC, /* compliance cannot be: counts or indices wrong, or not positive semidefinite within
                              rounding */
    HRT_REJECT_INDEX,
    HRT_REJECT_FOREIGN, /* other tool session or instrument */
    HRT_REJECT_FUTURE,  /* t_n later than now */
    HRT_REJECT_OLD,     /* doubled, or overtaken by a newer one */
    HRT_REJECT_COUNT
} hrt_reject;
const char *hrt_reject_text(hrt_reject reject);

/* Outside the tick: finite and bounded. Stiffness is scaled down to stiffness_max (not refused). */
hrt_reject hrt_sample_check(hrt_sample *sample, const hrt_params *params);
/* Outside the tick: indices, finite, positive semidefinite within rounding (Cholesky in `scratch`); fills the topology.
 */
hrt_reject hrt_patch_prepare(hrt_patch *patch, float scratch[HRT_PATCH_COMPLIANCE]);

/* ------------------------------------------------------------------------------------------------ kinematics */
/* A device's geometry and its numbers stand in core/device_NAME.h; motion/kinematics.h declares the same geometry in
 * the simulation's precision. */

/* How the device hangs in the scene: r is row-major, its columns are the device's x, y, z along world axes. z is the
 * shaft's direction into the body at rest; y is `up`. */
typedef struct hrt_axes {
    float r[9];
    const hrt_device_type *device;
} hrt_axes;

typedef struct hrt_joint_type {
    /* the profile's defaults */
    float counts_per_unit, min, max, speed_max; /* 1/unit, unit, unit, unit/s */
#if HRT_WITH_WORDS
    /* what no such device says, whatever its profile: a message with more is wrong */
    float reach_min, reach_max;
    const char *name; /* as columns of tables call it, with its unit: pitch_rad */
#endif
} hrt_joint_type;

struct hrt_device_type {
#if HRT_WITH_WORDS
    const char *name, *text;
    const char *torque_name[HRT_MOTORS]; /* as columns call the torques, with their units */
#endif
    int32_t joints, motors; /* 1..HRT_JOINTS; 1..HRT_MOTORS of them, the first, are driven and move the tip */
    hrt_joint_type joint[HRT_JOINTS];
    float torque_max[HRT_MOTORS], force_max_N;
    float rounding_m; /* two tips of the same joints within reach, one of each precision, are no farther apart */
    int32_t insertion, roll, grip; /* which joint slides along the shaft (then joints 0 and 1 are its pitch and yaw),
                                      turns about it, closes the jaws; -1: none */
#ifndef HRT_ONE_DEVICE
    /* Tip relative to the trocar, m; d tip / d (driven joints), row-major 3x3, columns of motors it has not are zero;
     * the driven joints that put the tip there, false where none do. */
    void (*tip)(const hrt_axes *axes, const float joint[HRT_JOINTS], float tip_m[3]);
    void (*jacobian)(const hrt_axes *axes, const float joint[HRT_JOINTS], float jacobian[9]);
    bool (*inverse)(const hrt_axes *axes, const float tip_m[3], float joint3[3]);
#endif
};

/* All that this build knows; the first is the default. Messages carry their numbers, so that a new one goes to the end.
 */
extern const hrt_device_type *const hrt_device_types[];
extern const int32_t hrt_device_type_count;
/* Its row; -1: no such name. */
int32_t hrt_device_type_find(const char *name);
int32_t hrt_device_type_number(const hrt_device_type *device);

/* From a direction and an up vector of any length; false when they are parallel, zero or not finite (the axes are then
 * the identity). */
bool hrt_axes_along(hrt_axes *axes, const hrt_device_type *device, const float axis[3], const float up[3]);
void hrt_tip(const hrt_axes *axes, const float joint[HRT_JOINTS], float tip_m[3]);
/* d tip / d (driven joints), row-major 3x3. */
void hrt_jacobian(const hrt_axes *axes, const float joint[HRT_JOINTS], float jacobian[9]);
/* The driven joints that put the tip there; false where none do (at the trocar itself, for one that turns about it). */
bool hrt_inverse(const hrt_axes *axes, const float tip_m[3], float joint3[3]);
void hrt_counts_to_joint(const hrt_params *params, const int32_t count[HRT_JOINTS], float joint[HRT_JOINTS]);
/* The count of joint `j` at a value, not rounded. */
float hrt_count_of_joint(const hrt_params *params, int j, float value);

/* ------------------------------------------------------------------------------------------------ extrapolation alone
 */

enum { HRT_CONTACT_ROWS = 16 };

/* A station of the tool's axis (0 the tip, one radius apart) against a feature of the patch. */
typedef struct hrt_contact_row {
    uint8_t triangle, station, feature; /* feature: 0 the face, 1+j edge j, 4+j corner j */
    float share;                        /* of the station's skin */
    float weight[3], normal[3];         /* normal from tool to tissue */
    float gap_m;
    float lambda_N;
} hrt_contact_row;

enum { HRT_ANDERSON_DEPTH = 2 };

/* What the rounds of `local_model` remember of each other (contact_law/anderson.h). */
typedef struct hrt_anderson {
    bool used; /* not all zero */
    uint8_t next;
    float residual_change_N[HRT_ANDERSON_DEPTH][HRT_PATCH_DOFS], step_N[HRT_ANDERSON_DEPTH][HRT_PATCH_DOFS];
} hrt_anderson;

/* Friction at a station of the tool, from tick to tick (contact_law/friction.h). */
typedef struct hrt_friction_state {
    uint8_t station;
    float force_N[3];   /* on the tissue */
    float stretch_N[3]; /* of its skin, by the skin's compliance: where the force goes while it sticks */
    float stick_state;  /* 1 has rested .. 0 has slid */
} hrt_friction_state;

typedef struct hrt_friction_history {
    uint32_t known; /* bit v: u_m of vertex v is there; 0: tip_m is not either */
    int32_t count;
    hrt_friction_state at[HRT_CONTACT_ROWS];
    float u_m[HRT_PATCH_DOFS], tip_m[3]; /* displacements of the vertices, and the tip, in the last tick */
} hrt_friction_history;

/* Of an earlier sample. */
typedef struct hrt_past {
    int64_t t_us;
    float tip_m[3], force_N[3];
#if HRT_WITH_EVIDENCE
    float stiffness_N_m[9]; /* zero: none */
#endif
} hrt_past;

/* The laws that `adaptive` blends: `hold`, `position`, the sample's or the estimated stiffness, and the patch. */
enum { HRT_ADAPTIVE_HOLD, HRT_ADAPTIVE_POSITION, HRT_ADAPTIVE_STIFFNESS, HRT_ADAPTIVE_PATCH, HRT_ADAPTIVE_LAWS };
enum { HRT_ADAPTIVE_RECORDS = 128 }; /* of 2 ms: longer than a sample of 25 Hz is late by three */

/* What each law said in one tick. */
typedef struct hrt_adaptive_record {
    int64_t t_us;
    bool with_patch;
    float force_N[HRT_ADAPTIVE_LAWS][3];
} hrt_adaptive_record;

typedef struct hrt_adaptive {
    float loss[HRT_ADAPTIVE_LAWS];   /* forgotten sums of squared errors, over the square of recent_peak_N */
    float weight[HRT_ADAPTIVE_LAWS]; /* in the last tick, sum 1 */
    float recent_peak_N;             /* the largest force of the last samples */
    int32_t count, newest;           /* of the ring of records */
    hrt_adaptive_record record[HRT_ADAPTIVE_RECORDS];
} hrt_adaptive;

/* The tool on a patch, from tick to tick. */
typedef struct hrt_touch {
    int64_t drag_us;     /* when the tool was last solved against a patch */
    float drag_tip_m[3]; /* and where it was */
    float mean_m_s[3];   /* speed of the tip in touch, over radiation_s */
    int32_t row_count;
    hrt_contact_row row[HRT_CONTACT_ROWS];
    float patch_force_N[HRT_PATCH_DOFS]; /* what the rows do to the patch */
    hrt_anderson anderson;
#if HRT_WITH_FRICTION
    hrt_friction_history friction;
#endif
} hrt_touch;

typedef struct hrt_extrapolation {
    hrt_extrapolator which;
    int32_t have; /* 0: no sample; 1: `now`; 2: `before` too, and the difference is of motion alone */
    hrt_sample now;
    hrt_past previous; /* the sample that differences are taken from */
#if HRT_WITH_EVIDENCE
    hrt_past candidate; /* the next that will be, once it is far enough back */
#endif
    float broyden_N_m[9];
    bool broyden_bounded;
    float blend_offset_N[3]; /* while it goes over: what the last force was more than the new law's */
    int64_t blend_us_left;   /* the last tick */
    float recent_peak_N;     /* the largest force of the last seconds */
    uint8_t blending;        /* 1: to another law, 2: to another tissue */
    uint8_t changed;         /* ticks for which what the force was more is measured anew */
    bool patch_left;         /* the tool went off the newest patch, or that denies its sample */
    bool on_patch;
    const hrt_patch *patch; /* of the newest sample that brought one */
    int64_t patch_us;
#if HRT_WITH_EVIDENCE
    float interval_s;              /* between the last two samples */
    float foretold_N2, came_N2;    /* how a received stiffness fared: squares of its changes, and of those that came */
    float drift_N_s[3];            /* of the force on a patch, without motion */
    float drift_lasted, drift_was; /* of drifts, N^2/s^2: how much of each went on in the next */
    float patch_N[3];              /* the patch's force in the last tick */
    float tick_tip_m[3];           /* where the tool was in the tick before, and when that was */
    int64_t tick_us;
    bool cutting;        /* the newest sample is of a cautery at work */
    uint8_t patch_ticks; /* in a row on patches of this tissue, up to two */
#endif
#if HRT_WITH_ADAPTIVE
    hrt_adaptive adaptive;
#endif
    bool cut; /* between the last two samples */
    float last_N[3];
    bool last_valid;
    uint32_t limits; /* hrt_limit bits of the last evaluation */
    hrt_touch touch;
} hrt_extrapolation;

void hrt_extrapolation_reset(hrt_extrapolation *x, hrt_extrapolator which);
/* Change the law while running: bridged. */
void hrt_extrapolation_select(hrt_extrapolation *x, hrt_extrapolator which);
/* A newer sample (order already checked; see hrt_tick). Stiffness and patch are left out where its flags say so. */
void hrt_extrapolation_sample(hrt_extrapolation *x, const hrt_params *params, const hrt_sample *sample);
/* Force on the tool at `tip_m`, N. Zero when there is no sample. */
void hrt_extrapolation_force(hrt_extrapolation *x, const hrt_params *params, int64_t now_us, const float tip_m[3],
                             float force_N[3]);
const char *hrt_extrapolator_name(hrt_extrapolator which);
/* False for an unknown name. */
bool hrt_extrapolator_find(const char *name, hrt_extrapolator *which);

/* ------------------------------------------------------------------------------------------------ the tick */

typedef struct hrt_input {
    int64_t encoder_us; /* when the newest encoder frame was received; 0: none ever */
    int32_t count[HRT_JOINTS];
    uint32_t device_session; /* changes when the device starts anew; 0 unknown */
    uint8_t device_fault;    /* the device's own code, 0 none */
    int64_t bus_conflict_us; /* when somebody else's frame under our ids was heard; 0: never */
    bool device_watchdog;    /* its watchdog dropped the torque and wants to hear "motors off" first */
    bool pedal;              /* cautery */
    bool bus_ok;
    bool enable; /* permission to engage */
    bool reset;  /* true in one tick: leave `fault` */
    bool passivity;
    bool coupling;
    hrt_extrapolator extrapolator;
} hrt_input;

typedef struct hrt_result {
    hrt_state state;
    hrt_fault fault;      /* the first, latched */
    int32_t fault_detail; /* joint, parameter row or device code */
    uint32_t limits;      /* hrt_limit bits of this tick */
    bool motors_on;
    float torque[HRT_MOTORS]; /* N m or N: what the motors shall push with */
    float force_N[3];         /* the same at the tip, world axes */
    float joint[HRT_JOINTS];
    float tip_m[3]; /* relative to the trocar */
    float velocity_m_s[3];
    float gain;            /* ramp and fade, 0..1 */
    float passivity_J;     /* handed to the hand since engaging, more than received; negative: absorbed */
    int64_t sample_age_us; /* of t_n; -1: no sample */
    hrt_extrapolator extrapolator;
    bool pedal;
} hrt_result;

typedef struct hrt_counters {
    uint32_t ticks;
    uint32_t samples_received, samples_late, samples_lost, samples_rejected;
} hrt_counters;

/* Caller-owned; nothing in it points into itself. Read it for tests and logs, change it through hrt_tick alone. */
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
    float torque_low[HRT_MOTORS], torque_high[HRT_MOTORS]; /* commanded since the last change of count */
    float joint[HRT_JOINTS], tip_m[3], velocity_m_s[3], joint_velocity[HRT_JOINTS];
    float joint_rate[HRT_JOINTS], joint_next[HRT_JOINTS]; /* over the last frame, and as it goes on, unfiltered */
    /* simulation */
    bool sample_seen;
    uint8_t sample_rule; /* hrt_flag_rule of the newest */
    uint32_t sample_seq;
    int64_t sim_session;
    int64_t sample_us; /* t_n of the newest that counts as fresh */
    hrt_extrapolation extrapolation;
    /* force to torques */
    float gain;
    uint32_t limits;
    float force_N[3]; /* last commanded */
    float torque[HRT_MOTORS];
    float energy_J; /* absorbed from the hand */
    float debt_J;   /* handed to the hand beyond power_max_W, and not yet made good */
    int64_t force_free_since_us;
    bool proxy_valid;
    float proxy_m[3];
    hrt_counters counters;
} hrt_controller;

/* Puts a controller into `boot`. Bad parameters end in `fault` at the first tick. session: new at every start, echoed
 * by the simulation. */
void hrt_init(hrt_controller *controller, const hrt_params *params, const hrt_axes *axes, int64_t session);
/* Once every 2 ms. `newest`: a sample that passed hrt_sample_check, or null when none came since the last tick. */
void hrt_tick(hrt_controller *controller, int64_t now_us, const hrt_input *input, const hrt_sample *newest,
              hrt_result *result);

const char *hrt_state_name(hrt_state state);
const char *hrt_fault_name(hrt_fault fault);
/* A sentence for people: what happened, what to do. */
const char *hrt_fault_text(hrt_fault fault);

#ifdef __cplusplus
}
#endif
#endif
