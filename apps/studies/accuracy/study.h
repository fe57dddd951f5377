/* tm-accuracy --scene: effect of each setting of a user's scene on the force at the hand, and its cost on this machine.
 * Files, in the order of the study:
 *   study.c            the complete study
 *   run_matrix.c       the runs, on meshes of study_mesh.c
 *   study_measure.c    one run, within the time of study_time.c
 *   rendered_force.c   the rates of force samples
 *   study_store.c      the results file
 *   error_estimate.c   comparison with the finest runs
 *   study_recommend.c  the choice
 *   verification.c     trial of the choice against its prediction; study_yaml.c writes it
 *   machine_speed.c    distinction of a slower machine from a costlier setting */
#ifndef TM_STUDY_H
#define TM_STUDY_H

#include <cjson/cJSON.h>

#include "app.h"
#include "scene/sim.h"
#include "sim/study_summary.h"

enum {
    STUDY_SETS = 32,
    STUDY_RUNS = 128,
    STUDY_MOMENTS = 6,
    STUDY_POINTS = 32,
    STUDY_MESHES = 10,
    STUDY_LATE = 3,
    STUDY_CARRIED = 4 /* maximum number of supports by vertex number that other meshes can have */
};

/* Relation of a run's mesh to the scene's. */
typedef enum study_form { STUDY_AS_IT_IS, STUDY_OTHER_VOLUME } study_form;

/* Share of frames that may exceed the predicted cost or be late: the prediction is a 95th percentile. */
#define STUDY_OVER 0.05
/* Relative difference below which two forces count as equal: imperceptible, or rounding. */
#define STUDY_ALIKE 1e-4

/* One setting, run along the hand's path in lockstep without haptics. */
typedef struct study_run {
    char key[17]; /* hash of the program's version, the scene, its files and the settings */
    char knob[24], name[96], why[400];
    char *set[STUDY_SETS]; /* in the syntax of --set; the first `edits_from` are common to all runs */
    int set_count, edits_from;
    int mesh; /* index in study.mesh */
    study_form form;
    bool foreign;              /* vertices of another mesh: shapes cannot be compared */
    bool done, failed, reused; /* failed: not possible, for the reason in `why` */
    bool left_out;             /* not run because of the study's time limit; `why` gives the reason */
    double frame_s, dt_s, setup_s;
    double cpu_s, cpu_p95_s, wall_s; /* per frame: processor time, mean and 95th percentile; mean wall time */
    double busy_p95_s;               /* duration of a frame: processor time on one thread, wall time on several */
    int frames, instruments, tets, substeps, points, threads;
    double *force_N; /* [frames][instruments][3] on the tools */
    double *u_m; /* [STUDY_MOMENTS][points][3] displacements of the scene's own vertices, which refined meshes keep */
    double felt[STUDY_LATE]; /* of an extrapolator: error at the hand with samples 0, 1, 2 periods late */
    bool felt_known;
    bool felt_first; /* its recorded samples also serve the following runs with the same rate and contents */
    int law;         /* extrapolator */
    int times;       /* force samples per frame */
    sim_sends sends; /* contents of each sample */
    /* error relative to the reference solution's root mean square; NAN: not available */
    double force_error, shape_error;
    double change, peak_change; /* change from the scene as it is: RMS, and signed change of the peak; for an
                                   extrapolator, the change by its sample rate at the frames' ends */
} study_run;

/* Time that the study has used and may use. */
typedef struct study_time {
    double began_s;
    double run_began_s, run_allowed_s; /* of the current run; allowed: INFINITY for the scene as it is */
    int cut_at;                        /* frames of the scene as it is after which its path is cut; 0: not cut */
    double *path;                      /* [frames of run 0] share of its time after each frame; null: uniform */
    double expected_s, took_s;         /* of finished runs: expected and measured time */
    double last_s;                     /* time that the recommendation still needs; 0: not started */
    int made;
} study_time;

typedef struct study_mesh {
    char name[80], path[1024], fibres[1024];
    int tets;
    double step;  /* step over the scene's, in proportion to the smallest height; 0: mesh no finer than the scene's */
    bool made;    /* built from the scene's: in metres, with its supports as groups */
    bool foreign; /* vertices differ from the scene's */
} study_mesh;

/* Limit of the force as tetrahedra shrink: Richardson's estimate along the better of the two forms. */
typedef struct study_truth {
    bool extrapolated;
    int coarse, fine; /* indices of runs */
    double order;     /* observed with three meshes, else assumed */
    bool order_observed;
    double uncertainty; /* relative: difference to other orders and to the other form's limit */
    double *force_N, *u_m, rms_N;
    int frames, instruments;
} study_truth;

/* Speed of frames that are compared with a predicted cost. */
typedef struct study_speed {
    double slower;   /* machine time over that at the prediction: 95th percentile of the frames, at least 1 */
    double over;     /* share of frames that took more processor time than the budget */
    double costlier; /* share that would have exceeded it on a machine as fast as at the prediction */
} study_speed;

typedef struct study_choice {
    bool wanted, fits, kept, real_time;
    bool untried;                        /* the scene as it is, because the limit allowed no trial */
    int mesh_run, extra[5], extra_count; /* runs whose settings are used */
    int felt_run;                        /* extrapolator and sample rate, 0: the scene's */
    double frame_s;
    sim_sends sends;                   /* contents that the extrapolator needs */
    double predicted;                  /* error, from the runs with one change each */
    double error, cost_s, share, busy; /* measured before and predicted for the last run; cost is a 95th percentile, as
                                          a share of a processor and of the frame */
    double work_s;                     /* study_work_s at that time */
    double held_error, held_share, held_wall_s;
    study_speed held;
    int held_frames, held_late;
    char file[1100];
} study_choice;

typedef struct study {
    const char *file, *json, *page;
    char *set[STUDY_SETS / 2]; /* from the command line */
    int set_count;
    const char *other_mesh[4]; /* --mesh */
    int other_count;
    double duration_s, limit_s, budget, frame_Hz, hold_s; /* below 0: not requested; limit_s: of the complete study */
    double asked_s;             /* asked_s: length of the path; duration_s: the part that is studied */
    double finest;              /* maximum tetrahedra of a finer mesh */
    bool quick, feels;          /* feels: haptics is in the scene */
    int sends;                  /* sim_sends that the scene sets; -1: none */
    int own_law, own_times;     /* extrapolator and samples per frame of the scene; -1: no haptics */
    uint64_t scene_hash, files; /* files: hash of the scene, its mesh and fibres */
    int own_vertices;           /* vertices of the scene's mesh */
    char folder[1024];          /* for refined meshes and rotated fibres */
    study_mesh mesh[STUDY_MESHES];
    int mesh_count;
    study_run run[STUDY_RUNS];
    int run_count;
    cJSON *old; /* results of an interrupted study, or null */
    study_time time;
    study_truth truth;
    study_choice choice;
    double slower; /* machine time now over that of the runs */
    int worse;     /* number of settings rejected because their error exceeded the prediction */
} study;

/* Runs the complete study. Returns 0, or an exit code after an error message. */
int study_whole(study *t);

/* --- run_matrix.c --- */
/* Plan the run "as it is", and all others, which require the first to be done. */
int study_plan_own(study *t);
int study_plan(study *t);

void study_make_key(const study *t, study_run *r);

/* --- study_time.c --- */
/* Starts the clock and, if stderr is no terminal, a status line every ten seconds. */
void study_time_begin(study *t);
void study_time_end(study *t);
/* Sets the current activity and its progress; below 0: unknown. */
void study_doing(const study *t, const char *what, double share);
/* Returns the seconds that one run may take, and the seconds left for all runs. */
double study_run_limit_s(const study *t);
double study_left_s(const study *t);
/* Returns the expected wall time of a run, or of all extrapolators together, from the scene as it is and finished
 * runs. */
double study_expected_s(const study *t, const study_run *r);
double study_expected_felt_s(const study *t);
/* Returns the expected time of the runs that `first` serves. */
double study_expected_group_s(const study *t, const study_run *first);
/* Returns false, and leaves the run out, if it is expected to take too long. */
bool study_may_start(study *t, study_run *r, double expected_s);
/* Called after frame k of a run. Returns false, and leaves the run out, if its rest would take too long. For the scene
 * as it is, returns false if the path ends here. */
bool study_goes_on(study *t, study_run *r, int k);
/* Does the same for one of several parts of a run, which began at `began_s`. */
bool study_part_goes_on(study *t, study_run *r, double began_s, int k, int frames);
void study_leave_out(study_run *r, const char *whose, double needs_s, double has_s);
void study_run_took(study *t, double expected_s);
/* Returns the expected time to try and verify a recommendation. */
double study_try_s(const study *t);
double study_verify_s(const study *t);
/* Returns whether the limit allows another trial of the choice before the last run, in real time. */
bool study_may_try(const study *t);
double study_end_s(const study *t); /* time to the end of the limit, s */
/* Formats a duration: "1 min 20 s". */
const char *study_span(double seconds, char text[24]);
/* Formats the studied part: "the path", or "the first 1.6 s of the path's 8 s". */
void study_path_words(const study *t, char *text, size_t size);

/* --- study_mesh.c --- */
/* Makes coarser meshes and refined ones, by bisection as far as `limit_s` allows, and adds --mesh ones. */
int study_make_meshes(study *t, const sim *own);
/* Writes files with every fibre rotated by +-angle about an axis perpendicular to fibres and hand. */
bool study_turn_fibres(study *t, const sim *own, double angle_rad, char path[1024]);

/* --- group_transfer.c --- */
/* Returns how many supports name vertices by their numbers. */
int study_carried(const sim *own);
/* Replaces those supports by groups in this run, whose mesh has the groups. */
void study_set_carried(study_run *r, const sim *own);
/* Writes the scene's mesh in metres, with those supports as groups. */
bool study_write_carried(const sim *own, const char *path);
/* Transfers regions, groups and fibres [3*tet_count] to `mesh`, a new mesh of the same organ. Returns false if a region
 * or group has no element there. */
bool study_transfer(const sim *own, const tm_mesh *mesh, const char *path, double *fibre);

/* --- study_measure.c --- */
study_run *study_add(study *t, const char *knob, const char *name);
void study_set(study_run *r, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Runs it, unless the results file has it. Returns 0, or an exit code after Ctrl-C. An impossible run sets r->failed
 * and is no error. */
int study_measure(study *t, study_run *r);
/* Computes mean and 95th percentile of the frames; sorts both arrays. */
void study_measure_cost(study_run *r, double *cost_s, double *busy_s, int frames);
/* Returns the number of threads that share the scene's step. */
int study_threads(const sim *s);
/* Builds a scene with stderr redirected to `why`. Returns null if it cannot be built. */
sim *study_build(const char *file, char *const *set, int set_count, char *why, size_t size);

/* Callbacks before and after each force sample of a frame; null: not called. */
typedef struct study_each {
    void (*before)(void *user, int sample);
    void (*after)(void *user, const sim *s, int sample);
    void *user;
} study_each;
/* Runs frame k along the hand's path, sample by sample. cost_s: processor time of its samples and of `after`. Returns
 * false if the tissue became unstable or the run was stopped. */
bool study_frame(sim *s, int k, const study_each *each, double *cost_s);
/* Returns how many samples before a frame's end the single-sample force has its mean time. */
double study_back(const sim *s);
/* Computes out_N [frames][width], the force of samples_N [frames*samples][width] this far before each frame's end. */
void study_at_frames(const double *samples_N, int frames, int samples, size_t width, double back, double *out_N);

/* --- rendered_force.c --- */
/* Plans runs for each extrapolator at each rate of force samples; those of one rate are measured together. */
void study_plan_felt(study *t, const sim *own);
int study_measure_felt(study *t);

/* --- study_rate.c --- */
/* Returns whether the run is judged by the error at the hand between samples. */
bool study_is_felt(const study_run *r);
double study_rate_Hz(const study *t, const study_run *r);
/* Returns the best extrapolator with this many samples per frame, at any cost; 0: none. */
int study_best_at(const study *t, int times);
/* Prints the table of rates. */
void study_print_rates(const study *t);
/* Writes the reason for the recommended rate, one sentence; empty if there is none. */
void study_rate_reason(const study *t, char *text, size_t size);
/* Returns the processor time per second of the path over that of the scene as it is. */
double study_times_costlier(const study *t, const study_run *r);
/* Returns the difference from `error` below which no hand distinguishes two forces. */
double study_alike(double error);
/* Chooses extrapolator and rate among runs that cost at most `costlier_max` times the scene as it is and are not in
 * `excluded` [run_count]. Takes the smallest error at the hand; of equal ones the cheapest, then the scene's own.
 * Returns 0 if there is none. */
int study_choose_felt(const study *t, double costlier_max, const bool *excluded);

/* --- study_store.c --- */
void study_open(study *t);
bool study_find(const study *t, study_run *r);
/* Returns the length of the path that an earlier call with this limit studied; `asked_s` if there was none. */
double study_old_span_s(const study *t, double asked_s);
int study_save(const study *t, bool whole);

/* --- error_estimate.c --- */
void study_judge(study *t);
/* Returns the root mean square of a - b over that of b, over frames and components of the force. */
double study_distance(const double *a, const double *b, size_t count);

/* --- study_recommend.c --- */
int study_recommend(study *t);
void study_say(const study *t);

/* --- verification.c --- */
/* Writes and builds the choice. Returns null with the reason in `why` if it cannot be built, or an exit code in
 * `rc`. */
sim *study_build_choice(study *t, char *why, size_t size, int *rc);
/* Both functions destroy the simulation. */
/* Runs the choice's scene along the path, frame by frame; stores error, cost and work in `out`. Returns false if it
 * became unstable. */
bool study_cost(study *t, sim *s, study_choice *out);
/* Runs it in real time for at least `hold_s` and compares it with the prediction. Builds the scene again for every pass
 * along the path. */
void study_verify(study *t, sim *s);

/* --- machine_speed.c --- */
/* Returns the processor time, s, of a fixed piece of work on one thread. */
double study_work_s(void);
/* Compares frames with the predicted cost. cost_s, work_s [frames]: time of each frame and of the fixed work next to
 * it; work_then_s: that of the prediction, 0: unknown; allowed_s: budget of a frame. */
study_speed study_judge_pace(const double *cost_s, const double *work_s, int frames, double work_then_s,
                             double allowed_s);
/* Writes whether the prediction was right, and the influence of the machine. */
void study_verdict(const study_choice *c, char *text, size_t size);

/* --- study_yaml.c --- */
/* Writes the scene with each `edit` (in the syntax of --set) applied to its text, after the comment `evidence`. */
int study_write_yaml(const study *t, const char *path, char *const *edit, int edit_count, const char *evidence);

#endif
