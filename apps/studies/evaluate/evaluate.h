/* tm-evaluate: how far extrapolated forces are from the true ones. A recording is a tool path with the true force at
 * every tick and the samples a simulation of some rate would have sent; replaying it through an extrapolator gives
 * errors. */
#ifndef TM_EVALUATE_H
#define TM_EVALUATE_H

#include "app.h"
#include "io/node.h"
#include "studies/replay/replay.h"

/* --- the hand's path --- */

/* The surgeon's tour; short strokes to and fro; and what two hands do to tissue that is cut or held:
 * the tour while a cautery in the other hand cuts a slit beside it, a cautery's own way, a grasper's; two cauteries
 * that press, slide, cut and lift off at random. */
typedef enum path_kind {
    PATH_TOUR,
    PATH_REVERSALS,
    PATH_OTHER_HAND_CUTS,
    PATH_SAME_HAND_CUTS,
    PATH_GRASPED,
    PATH_RANDOM,
    PATH_COUNT,
    PATH_NAMED = PATH_RANDOM /* those before have way points of their own and can be asked for */
} path_kind;
extern const char *const path_name[PATH_COUNT];

/* Of a way point; a random path has so many at most. */
enum { PATH_FIELDS = 5, PATH_RANDOM_POINTS = 28, PATH_HANDS = 2 };

typedef struct path {
    path_kind kind;
    double entry_m[3]; /* where the tip's sphere touches the surface */
    double speed_m_s;  /* mean along each stroke */
    double depth_m;    /* the deepest press; strokes scale with it */
    double tremor_m; /* 0: a steady hand; else three incommensurate tones about 9 Hz, RMS about half of this along each
                        axis */
    double random[PATH_HANDS][PATH_RANDOM_POINTS][PATH_FIELDS]; /* way points of a random path */
    int random_points;
} path;

/* Minimum-jerk strokes; the tour: contact made, press, slide, slide across, reverse, pause, deeper, lift off, touch
 * again. */
path path_make(path_kind kind, double speed_m_s, double tremor_m);
/* Both hands', of 3 to PATH_RANDOM_POINTS way points; the same for the same seed. */
path path_make_random(uint64_t seed, int points, double speed_m_s, double tremor_m);
double path_length_s(const path *p);
/* Where a hand (1: the other, without tremor) wants its instrument. A pedal is down or up for whole twentieths of a
 * second, so that models of different frame rates see the same. */
tm_tool_pose path_pose(const path *p, int hand, double time_s);

/* --- models --- */

typedef enum model { MODEL_PRECOMPUTED, MODEL_ISOTROPIC, MODEL_FIBRED, MODEL_CUT, MODEL_HYBRID, MODEL_COUNT } model;
extern const char *const model_name[MODEL_COUNT];
/* Opens the model's scene at a frame rate; null, having complained. `settings`: further "path=value", null-terminated
 * or null. */
sim *model_open(model m, double rate_Hz, const char *const *settings);

/* --- recordings --- */

/* The model run at `rate_Hz` along the path. `encoders`: the tool is seen through encoder counts. Truth from `truth`,
 * or null: to be filled. */
int record(model m, const path *p, double rate_Hz, bool encoders, bool patches, recording *out);
/* Fills ticks, tip and truth of `out` from the model run at 500 Hz. */
int record_truth(model m, const path *p, bool encoders, recording *out);
/* The same of the first `hands` instruments from one run, each into its own of `out`, which says whose it is; cuts are
 * in the first's. On a random path alone, where every hand is seen through its encoders. */
int record_hands(model m, const path *p, double rate_Hz, bool encoders, bool patches, int hands, recording *out);
int record_hands_truth(model m, const path *p, bool encoders, int hands, recording *out);
/* The paper's truth: forces between samples by linear interpolation, afterwards. Not known before the first sample,
 * after the last, and where two are further apart than three frames and stale_us: there the controller fades. */
void truth_by_interpolation(recording *r);
/* --- logs --- */

enum { LOG_INSTRUMENTS = 2 };

/* Sessions are plain LCM logs: TOOL_i every tick, FORCE_i and PATCH_i every frame, TRUTH_0 (force_sample_t) every tick
 * where the truth is known. */
int log_write(const char *file, const recording *r, const double trocar_m[3]);
/* One instrument of a log, on its controller's clock: when a sample came is found through the log's own times, which
 * TOOL_i carries beside the controller's. 0, with no ticks or no samples where the log holds none; else the exit code,
 * having complained. */
int log_read(const char *file, int instrument, recording *out);

/* --- tissue under the closed loop --- */

typedef struct loop_tissue loop_tissue;
/* A model on a coarse mesh, `factor` times as stiff; null, having complained. */
loop_tissue *loop_tissue_open(model m, double rate_Hz, double factor);
void loop_tissue_close(loop_tissue *tissue);
/* Insertion at which a tip straight below the trocar touches; how the device hangs. */
double loop_tissue_touch_m(const loop_tissue *tissue);
hrt_pose loop_tissue_pose(const loop_tissue *tissue);
/* A frame that ends where the tool is now, and what it says; true: with a patch. */
bool loop_tissue_frame(loop_tissue *tissue, const tensormass_tool_state_t *tool, int64_t now_us,
                       tensormass_force_sample_t *sample, tensormass_contact_patch_t *patch);

/* --- studies --- */

typedef struct study_run {
    bool quick;
    bool model[MODEL_COUNT], path[PATH_COUNT]; /* which were asked for */
} study_run;

/* Measures a part of the study into `out`, rows or an object of them. Returns 0, or an exit code after a complaint. */
typedef int study_part_maker(const study_run *run, cJSON *out);
/* operating: every law on scenes that are pressed, held, lifted and cut, at every rate, by phase, with the price of the
 * rate. rates: rate, speed, latency, jitter, loss, encoders, models, reversals, figure 5; hands adds to its rows what
 * is cut by the other hand and by the same, grasped and pulled. tissue_loop: loop on simulated tissue, whole and cut.
 * ready: by the wall clock, how soon patches are exact; empty without the solver. cutting: two cauteries at random,
 * what `local_model` renders at most, over the truth's peak. */
study_part_maker study_operating, study_roughness, study_rates, study_hands, study_loop, study_tissue_loop, study_ready,
    study_cutting;

/* `out` gets ticks, tip and truth of `truth`. */
void copy_truth(const recording *truth, recording *out);
void progress(const char *what, double fraction);

#endif
