/* tm-evaluate: errors of extrapolated forces. A recording is a tool path with the true force at every tick and the
 * samples of a simulation of some rate. Replaying it through an extrapolator gives the errors. */
#ifndef TM_EVALUATE_H
#define TM_EVALUATE_H

#include "app.h"
#include "io/node.h"
#include "studies/replay/replay.h"

/* --- the hand's path --- */

/* Paths: the surgeon's tour; short strokes to and fro; two hands at tissue that is cut or grasped. The latter are the
 * tour while a cautery in the other hand cuts a slit nearby, a cautery's own path, and a grasper's. Last, two cauteries
 * press, slide, cut and lift off at random. */
typedef enum path_kind {
    PATH_TOUR,
    PATH_REVERSALS,
    PATH_OTHER_HAND_CUTS,
    PATH_SAME_HAND_CUTS,
    PATH_GRASPED,
    PATH_RANDOM,
    PATH_COUNT,
    PATH_NAMED = PATH_RANDOM /* the earlier kinds have fixed way points and can be selected by name */
} path_kind;
extern const char *const path_name[PATH_COUNT];

/* Values of a way point; maximum number of way points of a random path. */
enum { PATH_FIELDS = 5, PATH_RANDOM_POINTS = 28, PATH_HANDS = 2 };

typedef struct path {
    path_kind kind;
    double entry_m[3]; /* point where the tip's sphere touches the surface */
    double speed_m_s;  /* mean along each stroke */
    double depth_m;    /* depth of the deepest press; strokes scale with it */
    double tremor_m; /* 0: a steady hand; else three incommensurate tones about 9 Hz, RMS about half of this along each
                        axis */
    double random[PATH_HANDS][PATH_RANDOM_POINTS][PATH_FIELDS]; /* way points of a random path */
    int random_points;
} path;

/* Returns a path of minimum-jerk strokes. The tour: touch, press, slide, slide across, reverse, pause, press deeper,
 * lift off, touch again. */
path path_make(path_kind kind, double speed_m_s, double tremor_m);
/* Returns random paths of both hands with 3 to PATH_RANDOM_POINTS way points, equal for equal seeds. */
path path_make_random(uint64_t seed, int points, double speed_m_s, double tremor_m);
double path_length_s(const path *p);
/* Returns the pose that a hand (1: the other, without tremor) demands. Pedals change only at multiples of 0.05 s, so
 * models of different frame rates see the same. */
tm_tool_pose path_pose(const path *p, int hand, double time_s);

/* --- models --- */

typedef enum model { MODEL_PRECOMPUTED, MODEL_ISOTROPIC, MODEL_FIBRED, MODEL_CUT, MODEL_HYBRID, MODEL_COUNT } model;
extern const char *const model_name[MODEL_COUNT];
/* Opens the model's scene at a frame rate. Returns null after an error message. `settings`: further "path=value",
 * null-terminated, or null. */
sim *model_open(model m, double rate_Hz, const char *const *settings);

/* --- recordings --- */

/* Records the model at `rate_Hz` along the path. `encoders`: the tool is measured by encoder counts. The truth is
 * copied from `truth`, or left to be filled if null. */
int record(model m, const path *p, double rate_Hz, bool encoders, bool patches, recording *out);
/* Fills ticks, tip and truth of `out` from the model run at 500 Hz. */
int record_truth(model m, const path *p, bool encoders, recording *out);
/* Records the first `hands` instruments in one run, each into its own element of `out`, which names its instrument.
 * Cuts are stored in the first. Random paths only, on which every hand is measured by its encoders. */
int record_hands(model m, const path *p, double rate_Hz, bool encoders, bool patches, int hands, recording *out);
int record_hands_truth(model m, const path *p, bool encoders, int hands, recording *out);
/* Computes the paper's truth: linear interpolation between samples, afterwards. It is unknown before the first sample,
 * after the last, and in gaps of more than three frames and stale_us, where the controller ramps down. */
void truth_by_interpolation(recording *r);
/* --- logs --- */

enum { LOG_INSTRUMENTS = 2 };

/* Writes a session as a plain LCM log: TOOL_i every tick, FORCE_i and PATCH_i every frame, TRUTH_0 (force_sample_t)
 * every tick with a known truth. */
int log_write(const char *file, const recording *r, const double trocar_m[3]);
/* Reads one instrument of a log, on its controller's clock. TOOL_i has the log's and the controller's times, from which
 * the arrival of samples follows. Returns 0, with no ticks or samples if the log has none, else an exit code after an
 * error message. */
int log_read(const char *file, int instrument, recording *out);

/* --- tissue under the closed loop --- */

typedef struct loop_tissue loop_tissue;
/* Opens a model on a coarse mesh, `factor` times as stiff. Returns null after an error message. */
loop_tissue *loop_tissue_open(model m, double rate_Hz, double factor);
void loop_tissue_close(loop_tissue *tissue);
/* Insertion at which a tip straight below the trocar touches; the device's axes. */
double loop_tissue_touch_m(const loop_tissue *tissue);
hrt_pose loop_tissue_pose(const loop_tissue *tissue);
/* Simulates a frame that ends at the tool's present pose and fills its messages. Returns true if there is a patch. */
bool loop_tissue_frame(loop_tissue *tissue, const tensormass_tool_state_t *tool, int64_t now_us,
                       tensormass_force_sample_t *sample, tensormass_contact_patch_t *patch);

/* --- studies --- */

typedef struct study_run {
    bool quick;
    bool model[MODEL_COUNT], path[PATH_COUNT]; /* selected models and paths */
} study_run;

/* Measures a part of the study into `out`, as rows or an object. Returns 0, or an exit code after an error message. */
typedef int study_part_maker(const study_run *run, cJSON *out);
/* Parts of the study:
 *   operating    every law at every rate on scenes that are pressed, held, lifted and cut, by phase, with the cost
 *   roughness    second difference of the force itself
 *   rates        rate, speed, latency, jitter, loss, encoders, models, reversals, figure 5
 *   hands        tissue cut by the other hand or the same, grasped and pulled
 *   loop         closed loop on a model surface
 *   tissue_loop  closed loop on simulated tissue, complete and cut
 *   ready        wall-clock time until patches are exact; empty without the solver
 *   cutting      two cauteries at random: maximum rendered by `local_model` over the truth's peak */
study_part_maker study_operating, study_roughness, study_rates, study_hands, study_loop, study_devices,
    study_tissue_loop, study_ready, study_cutting;

/* Copies ticks, tip and truth of `truth` to `out`. */
void copy_truth(const recording *truth, recording *out);
void progress(const char *what, double fraction);

#endif
