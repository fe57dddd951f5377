/* tm-evaluate: how far extrapolated forces are from the true ones. A recording is a tool path with the true force at
 * every tick and the samples a simulation of some rate would have sent; replaying it through an extrapolator gives
 * errors. */
#ifndef TM_EVALUATE_H
#define TM_EVALUATE_H

#include <cjson/cJSON.h>

#include "hrt.h"
#include "lcm_types/tensormass_contact_patch_t.h"
#include "sim/sim.h"

enum { TICK_US = 2000 };

/* --- the hand's path --- */

typedef struct path {
    double entry_m[3]; /* where the tip's sphere touches the surface */
    double speed_m_s;  /* mean along each stroke */
    double depth_m;    /* the deepest press; strokes scale with it */
    double tremor_m; /* 0: a steady hand; else three incommensurate tones about 9 Hz, RMS about half of this along each
                        axis */
    bool reversals;  /* short strokes to and fro instead of the surgeon's tour */
} path;

/* Minimum-jerk strokes: contact made, press, slide, slide across, reverse, pause, deeper, lift off, touch again. */
path path_make(double speed_m_s, double tremor_m);
path path_reversals(double speed_m_s, double tremor_m);
double path_length_s(const path *p);
void path_tip(const path *p, double time_s, double tip_m[3]);

/* --- models --- */

typedef enum model { MODEL_PRECOMPUTED, MODEL_ISOTROPIC, MODEL_FIBRED, MODEL_CUT, MODEL_HYBRID, MODEL_COUNT } model;
extern const char *const model_name[MODEL_COUNT];
/* Opens the model's scene at a frame rate; null, having complained. `settings`: further "path=value", null-terminated
 * or null. */
sim *model_open(model m, double rate_Hz, const char *const *settings);

/* --- recordings --- */

typedef struct sampled {
    hrt_sample sample; /* t_us = t_n; positions relative to the trocar */
    int64_t ready_us;  /* end of the frame that made it */
    hrt_patch *patch;  /* null: none */
} sampled;

typedef struct recording {
    char name[64];
    int ticks;
    float *tip_m;   /* [3*ticks] relative to the trocar, as the encoders say */
    float *truth_N; /* [3*ticks]; NaN: not known at this tick, which is then not judged */
    int samples;
    sampled *sample;
    double frame_s, peak_N;
    bool interpolated; /* the truth is the paper's: samples interpolated afterwards */
    int64_t first_us;  /* of a log: its first tick on the controller's clock */
    int sessions;      /* of the controller in the log it was read from; the longest is this one */
    hrt_params params;
} recording;
void recording_free(recording *r);

/* The model run at `rate_Hz` along the path. `encoders`: the tool is seen through encoder counts. Truth from `truth`,
 * or null: to be filled. */
int record(model m, const path *p, double rate_Hz, bool encoders, bool patches, recording *out);
/* Fills ticks, tip and truth of `out` from the model run at 500 Hz. */
int record_truth(model m, const path *p, bool encoders, recording *out);
/* The paper's truth: forces between samples by linear interpolation, afterwards. Not known before the first sample,
 * after the last, and where two are further apart than three frames and stale_us: there the controller fades. */
void truth_by_interpolation(recording *r);
/* The device as the models' scenes hold it: world to trocar, and through its encoders. */
void device_see(const sim *s, const hrt_params *params, const double tip_m[3], bool encoders, float seen_m[3]);

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
    double direction_rad;       /* RMS angle where the true force exceeds a tenth of its peak */
    double over_limit;          /* largest force over the device's limit, before any limiter */
    int judged;                 /* ticks */
    double off_patch;           /* share of ticks in contact that `contact` had to leave to `tangent` */
    double ns_per_tick;         /* median */
} errors;

errors replay(const recording *r, hrt_extrapolator which, const conditions *c, float *force_N /* [3*ticks] or null */);

/* --- logs --- */

enum { LOG_INSTRUMENTS = 2 };

/* Sessions are plain LCM logs: TOOL_i every tick, FORCE_i and PATCH_i every frame, TRUTH_0 (force_sample_t) every tick
 * where the truth is known. */
int log_write(const char *file, const recording *r, const double trocar_m[3]);
/* One instrument of a log, on its controller's clock: when a sample came is found through the log's own times, which
 * TOOL_i carries beside the controller's. 0, with no ticks or no samples where the log holds none; else the exit code,
 * having complained. */
int log_read(const char *file, int instrument, recording *out);
/* Checked and prepared as the controller does it; positions relative to origin_m. False: refused. */
bool patch_from_message(const tensormass_contact_patch_t *m, const double origin_m[3], hrt_patch *p);

/* --- studies: each returns its JSON, null having complained --- */

typedef struct study_run {
    bool quick;
    bool model[MODEL_COUNT]; /* which can run in this build */
} study_run;

cJSON *study_roughness(const study_run *r);
cJSON *study_rates(const study_run *r); /* rate, speed, latency, jitter, loss, encoders, models, reversals, figure 5 */
cJSON *study_loop(const study_run *r);
cJSON *errors_json(const errors *e);
cJSON *add_row(cJSON *rows);
void progress(const char *what, double fraction);

#endif
