/* What a controller makes of a simulation's samples, replayed: a recording is a tool's way with the true force at every
 * tick and the samples that a simulation of some rate would have sent; through an extrapolator it gives errors. Shared
 * by tm-evaluate (whose models and paths it is of) and tm-accuracy (a scene of one's own). */
#ifndef TM_REPLAY_H
#define TM_REPLAY_H

#include <cjson/cJSON.h>

#include "hrt.h"
#include "scene/sim.h"
#include "sim/publish.h"

enum { TICK_US = 2000 };

/* --- cuts --- */

/* Tetrahedra removed along a path, in the order of their times (on the path's clock). */
typedef struct cut_list {
    int count, capacity;
    double *time_s;
    int32_t *tet;
} cut_list;
/* Whether anything went in (from_s, to_s]. */
bool cut_list_between(const cut_list *list, double from_s, double to_s);
/* How many of `a` are in `b`. */
int cut_list_shared(const cut_list *a, const cut_list *b);

/* From now on frames of a dynamic model remove the list's tetrahedra at their times. Free it after sim_destroy. */
typedef struct cut_replay {
    const cut_list *list;
    int next;
    double begin_s; /* on the world's clock, when the path began; nothing goes before */
} cut_replay;
void cut_replay_begin(cut_replay *replay, const cut_list *list, sim *s);

/* --- recordings --- */

typedef struct sampled {
    hrt_sample sample; /* t_us = t_n; positions relative to the trocar */
    int64_t ready_us;  /* end of the frame that made it */
    hrt_patch *patch;  /* null: none */
} sampled;

/* What a hand does at a tick, by the truth: named after what happened last where two go together. */
typedef enum phase {
    PHASE_FREE,
    PHASE_TOUCH, /* a tenth of a second after contact is made or lost */
    PHASE_PRESS,
    PHASE_SLIDE,
    PHASE_GRASP, /* just after jaws close */
    PHASE_LIFT,  /* held */
    PHASE_CUT,   /* in touch, and tissue went within the last tenth of a second */
    PHASE_LET_GO,
    PHASE_COUNT
} phase;
extern const char *const phase_name[PHASE_COUNT];
/* What happened to an instrument up to a tick; phase_watch_begin sets it. */
typedef struct phase_watch {
    bool closed, touching;
    double touched_s, closed_s, opened_s, cut_s;
    float tip_m[3];
} phase_watch;

typedef struct recording {
    char name[64];
    int ticks;
    float *tip_m;   /* [3*ticks] relative to the trocar, as the encoders say */
    float *truth_N; /* [3*ticks]; NaN: not known at this tick, which is then not judged */
    uint8_t *phase; /* [ticks] phase; null: not told apart */
    phase_watch watch;
    int samples;
    sampled *sample;
    double frame_s, peak_N;
    double processor_share; /* seconds of processor for a simulated second, of record_scene */
    bool interpolated;      /* the truth is the paper's: samples interpolated afterwards */
    int64_t first_us;       /* of a log: its first tick on the controller's clock */
    int sessions;           /* of the controller in the log it was read from; the longest is this one */
    hrt_params params;
    tm_tool_mode mode;
    int instrument;         /* whose tip, samples and truth these are; the first unless said */
    cut_list cuts;          /* what the model cut along the path */
    const cut_list *replay; /* null: cauteries cut; else they do not, and these go at their times */
} recording;
void recording_free(recording *r);

/* Room for so many samples and ticks of r->instrument, of which one kind is made by a run; samples of before go. */
void recording_begin(recording *r, const sim *s, int samples, int ticks);
/* Takes sample k as messages carry the instrument's force after it, and as the controller takes that. */
void recording_sample(recording *r, sim_publisher *p, const sim *s, int k);
/* Who leads the instruments along a path. */
typedef struct leader {
    void (*pose)(void *user, const sim *s, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]);
    bool (*after)(void *user, const sim *s,
                  int k); /* frame or tick k is simulated; false: that will do. Null: nothing */
    void *user;
} leader;
/* Runs the path frame by frame for samples, or for the truth at every tick, into `hands` of out[]. */
tm_status record_samples(sim *s, int frames, int hands, const leader *by, recording *out);
tm_status record_ticks(sim *s, int ticks, int hands, const leader *by, recording *out);
/* The device as the models' scenes hold it: world to trocar, and through its encoders. */
void device_see(const sim *s, int instrument, const hrt_params *params, const double tip_m[3], bool encoders,
                float seen_m[3]);

/* A scene's own hands as recordings, one an instrument. */
typedef struct scene_record {
    const char *scene;      /* file */
    const char *const *set; /* further "path=value", null-terminated, or null */
    double duration_s;      /* 0: the scene's own */
    bool force_alone;       /* samples without stiffness and patch */
} scene_record;
/* Fills frame_s, params, mode, samples, processor_share and cuts (the first's) of out[TM_MAX_INSTRUMENTS] from frames
 * of `rate_Hz`. Returns 0, or an exit code after a complaint: APP_BAD_INPUT for a scene without instruments. */
int record_scene(const scene_record *of, double rate_Hz, recording *out, int *instruments);
/* Fills ticks, tip, truth, phases and mode of out[] from the scene run at every tick. Returns as record_scene. */
int record_scene_truth(const scene_record *of, recording *out);

/* --- replay --- */

typedef struct conditions {
    int latency_frames;
    double jitter; /* of the frame's end, share of a frame, uniform */
    double loss;
    uint64_t seed;
} conditions;

typedef struct errors {
    double rms, peak;           /* of the vector error over the true peak */
    double jump_peak, jump_p99; /* change of the force from tick to tick over the true peak */
    double jump_arrival;        /* the largest in a tick at which a sample arrived, or the two ticks after it */
    double jump_true;           /* the largest of the true force */
    double direction_rad;       /* RMS angle where the true force exceeds a tenth of its peak */
    double largest;             /* force over the true peak */
    double over_limit;          /* largest force over the device's limit, before any limiter */
    int judged;                 /* ticks */
    double off_patch;           /* share of ticks in contact that `local_model` had to leave to `tangent` */
    double cut_since_error2;    /* share of the squared error in ticks before which, after the sample in use, tissue was
                                   cut: nobody at the hand can know of it */
    double cut_since_ticks;     /* those ticks' share */
    double worst_error2;        /* share of the squared error in the worst fiftieth of the ticks */
    double ns_per_tick;         /* mean */
    double phase_rms[PHASE_COUNT]; /* as rms, in the ticks of one phase */
    int phase_ticks[PHASE_COUNT];
} errors;

/* Beside the controller's laws: SOFA's way (frozen.h), for comparison. */
enum { REPLAY_FROZEN = HRT_EXTRAPOLATOR_COUNT, REPLAY_LAWS };
/* Name of a hrt_extrapolator or REPLAY_FROZEN. */
const char *replay_law_name(int law);

/* `which`: an extrapolator, or REPLAY_FROZEN. */
errors replay(const recording *r, hrt_extrapolator which, const conditions *c, float *force_N /* [3*ticks] or null */);
/* A row of their own. */
cJSON *errors_add(cJSON *rows, const errors *e);

#endif
