/* Replays a simulation's samples through an extrapolator and measures the errors. A recording is a tool path with the
 * true force at every tick and the samples of a simulation of some rate. Used by tm-evaluate (its own models and paths)
 * and tm-accuracy (a user's scene). */
#ifndef TM_REPLAY_H
#define TM_REPLAY_H

#include <cjson/cJSON.h>

#include "hrt.h"
#include "scene/sim.h"
#include "sim/publish.h"

enum { TICK_US = 2000 };

/* --- cuts --- */

/* Tetrahedra removed along a path, ordered by time (on the path's clock). */
typedef struct cut_list {
    int count, capacity;
    double *time_s;
    int32_t *tet;
} cut_list;
/* Returns whether an entry has a time in (from_s, to_s]. */
bool cut_list_between(const cut_list *list, double from_s, double to_s);
/* Returns how many of `a` are in `b`. */
int cut_list_shared(const cut_list *a, const cut_list *b);

/* Makes frames of a dynamic model remove the list's tetrahedra at their times. Free it after sim_destroy. */
typedef struct cut_replay {
    const cut_list *list;
    int next;
    double begin_s; /* start of the path on the world's clock; nothing is removed earlier */
} cut_replay;
void cut_replay_begin(cut_replay *replay, const cut_list *list, sim *s);

/* --- recordings --- */

typedef struct sampled {
    hrt_sample sample; /* t_us = t_n; positions relative to the trocar */
    int64_t ready_us;  /* end of the frame that computed it */
    hrt_patch *patch;  /* null: none */
} sampled;

/* Activity of a hand at a tick, by the truth. If two activities overlap, the later one counts. */
typedef enum phase {
    PHASE_FREE,
    PHASE_TOUCH, /* within 0.1 s after contact begins or ends */
    PHASE_PRESS,
    PHASE_SLIDE,
    PHASE_GRASP, /* just after the jaws close */
    PHASE_LIFT,  /* grasped */
    PHASE_CUT,   /* in contact, with tissue removed within the last 0.1 s */
    PHASE_LET_GO,
    PHASE_COUNT
} phase;
extern const char *const phase_name[PHASE_COUNT];
/* Recent events of an instrument, for its phase; phase_watch_begin initialises it. */
typedef struct phase_watch {
    bool closed, touching;
    double touched_s, closed_s, opened_s, cut_s;
    float tip_m[3];
} phase_watch;

typedef struct recording {
    char name[64];
    int ticks;
    float *tip_m;   /* [3*ticks] relative to the trocar, measured by the encoders */
    float *truth_N; /* [3*ticks]; NaN: unknown at this tick, which is then not judged */
    uint8_t *phase; /* [ticks] phase; null: not distinguished */
    phase_watch watch;
    int samples;
    sampled *sample;
    double frame_s, peak_N;
    double processor_share; /* processor time per simulated time, from record_scene */
    bool interpolated;      /* the truth is the paper's: samples interpolated afterwards */
    int64_t first_us;       /* of a log: its first tick on the controller's clock */
    int sessions;           /* number of the controller's sessions in the log; the longest is this one */
    hrt_params params;
    tm_tool_mode mode;
    int instrument;         /* instrument of the tip, samples and truth; the first by default */
    cut_list cuts;          /* tetrahedra that the model removed along the path */
    const cut_list *replay; /* null: cauteries cut; else they do not, and these tetrahedra are removed at their times */
} recording;
void recording_free(recording *r);

/* Allocates for this many samples and ticks of r->instrument; a run fills one of both. Frees previous samples. */
void recording_begin(recording *r, const sim *s, int samples, int ticks);
/* Stores sample k: the instrument's force after it, encoded as a message and decoded as by the controller. */
void recording_sample(recording *r, sim_publisher *p, const sim *s, int k);
/* Moves the instruments along a path. */
typedef struct leader {
    void (*pose)(void *user, const sim *s, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]);
    bool (*after)(void *user, const sim *s,
                  int k); /* called after frame or tick k; returns false to stop. Null: not called */
    void *user;
} leader;
/* Runs the path, frame by frame for samples or tick by tick for the truth, into `hands` of out[]. */
tm_status record_samples(sim *s, int frames, int hands, const leader *by, recording *out);
tm_status record_ticks(sim *s, int ticks, int hands, const leader *by, recording *out);
/* Computes the device's tip in the models' scenes: world to trocar, and through its encoders. */
void device_see(const sim *s, int instrument, const hrt_params *params, const double tip_m[3], bool encoders,
                float seen_m[3]);

/* Recordings of a scene's own hands, one per instrument. */
typedef struct scene_record {
    const char *scene;      /* file */
    const char *const *set; /* further "path=value", null-terminated, or null */
    double duration_s;      /* 0: the scene's */
    bool force_alone;       /* samples without stiffness and patch */
} scene_record;
/* Fills frame_s, params, mode, samples, processor_share and cuts (of the first) of out[TM_MAX_INSTRUMENTS], from frames
 * at `rate_Hz`. Returns 0, or an exit code after an error message: APP_BAD_INPUT for a scene without instruments. */
int record_scene(const scene_record *of, double rate_Hz, recording *out, int *instruments);
/* Fills ticks, tip, truth, phases and mode of out[] from the scene run at every tick. Returns the same codes as
 * record_scene. */
int record_scene_truth(const scene_record *of, recording *out);

/* --- replay --- */

typedef struct conditions {
    int latency_frames;
    double jitter; /* of the frame's end, as a share of a frame, uniformly distributed */
    double loss;
    uint64_t seed;
} conditions;

typedef struct errors {
    double rms, peak;           /* vector error over the true peak */
    double jump_peak, jump_p99; /* change of the force per tick over the true peak */
    double jump_arrival;        /* maximum in the tick at which a sample arrived and in the two after it */
    double jump_true;           /* maximum of the true force */
    double direction_rad;       /* RMS angle where the true force exceeds 0.1 of its peak */
    double largest;             /* maximum force over the true peak */
    double over_limit;          /* maximum force over the device's limit, before any limiter */
    int judged;                 /* number of judged ticks */
    double off_patch;           /* share of ticks in contact in which `local_model` fell back to `tangent` */
    double cut_since_error2; /* share of the squared error in ticks with tissue cut since the sample in use: unknowable
                                at the controller */
    double cut_since_ticks;  /* share of those ticks */
    double worst_error2;     /* share of the squared error in the worst 2 % of the ticks */
    double ns_per_tick;      /* mean time */
    double phase_rms[PHASE_COUNT]; /* as rms, within the ticks of one phase */
    int phase_ticks[PHASE_COUNT];
} errors;

/* SOFA's method (frozen.h), for comparison with the controller's laws. */
enum { REPLAY_FROZEN = HRT_EXTRAPOLATOR_COUNT, REPLAY_LAWS };
/* Returns the name of a hrt_extrapolator or of REPLAY_FROZEN. */
const char *replay_law_name(int law);

/* Replays a recording. `which`: an extrapolator, or REPLAY_FROZEN. */
errors replay(const recording *r, hrt_extrapolator which, const conditions *c, float *force_N /* [3*ticks] or null */);
/* Appends a row with these errors. */
cJSON *errors_add(cJSON *rows, const errors *e);

#endif
