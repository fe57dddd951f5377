/* tm-accuracy --scene: what each setting of one's own scene does to the force at the hand, and what it costs here.
 * study.c is the whole, in order; run_matrix.c says what is run, on meshes of study_mesh.c; study_measure.c runs one,
 * within the time of study_time.c; rendered_force.c runs the rates of samples; study_store.c keeps what is done;
 * error_estimate.c holds it against the finest; study_recommend.c chooses; verification.c tries the choice out and
 * holds it to its promise, written by study_yaml.c; machine_speed.c tells a slower machine from a costlier setting. */
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
    STUDY_CARRIED = 4 /* supports by vertex number that other meshes can have */
};

/* How a run's mesh relates to the scene's. */
typedef enum study_form { STUDY_AS_IT_IS, STUDY_OTHER_VOLUME } study_form;

/* Share of frames that may be costlier, or later, than promised: what was promised is a 95th percentile. */
#define STUDY_OVER 0.05
/* Errors of the force that are the same to a hand, and to rounding. */
#define STUDY_ALIKE 1e-4

/* One setting, run along the hand's path in lockstep without haptics. */
typedef struct study_run {
    char key[17]; /* hash of the program's version, the scene, its files and the settings */
    char knob[16], name[80], why[400];
    char *set[STUDY_SETS]; /* as --set takes them; the first `edits_from` are of every run */
    int set_count, edits_from;
    int mesh; /* of study.mesh */
    study_form form;
    bool foreign;              /* another mesh's vertices: no shape to compare */
    bool done, failed, reused; /* failed: cannot be, `why` says so */
    bool left_out;             /* not done: the study's limit does not hold it, `why` says so */
    double frame_s, dt_s, setup_s;
    double cpu_s, cpu_p95_s, wall_s; /* a frame: processor time, mean and 95th percentile; mean wall time */
    double busy_p95_s;               /* how long a frame takes: processor time on one thread, wall time on several */
    int frames, instruments, tets, substeps, points, threads;
    double *force_N;         /* [frames][instruments][3] on the tools */
    double *u_m;             /* [STUDY_MOMENTS][points][3] of the scene's own vertices, which refined meshes keep */
    double felt[STUDY_LATE]; /* of an extrapolator: error at the hand with samples 0, 1, 2 of their periods late */
    bool felt_known;
    bool felt_first; /* its recorded samples serve those after it that have the same rate and carry as much */
    int law;         /* the extrapolator */
    int times;       /* force samples of a frame */
    sim_sends sends; /* what goes with each */
    /* judged, relative to the truth's root mean square; NAN: not to be had */
    double force_error, shape_error;
    double change, peak_change; /* against the scene as it is: RMS, and of the peak with its sign; of an extrapolator
                                   what its sample rate changes at the frames' ends */
} study_run;

/* What the study has of its limit. */
typedef struct study_time {
    double began_s;
    double run_began_s, run_allowed_s; /* of the run at hand; allowed: INFINITY of the scene as it is */
    int cut_at;                        /* frames of the scene as it is after which its path is broken off; 0: not */
    double *path;                      /* [frames of run 0] share of its time after each frame; null: even */
    double expected_s, took_s;         /* of runs that were made: what they were expected to take, and took */
    double last_s;                     /* of the recommendation: what it still takes; 0: not come to it */
    int made;
} study_time;

typedef struct study_mesh {
    char name[80], path[1024], fibres[1024];
    int tets;
    double step;  /* of the scene's, in proportion to the smallest height; 0: no finer than the scene's */
    bool made;    /* of the scene's: in metres, with its supports as groups */
    bool foreign; /* other vertices */
} study_mesh;

/* Where the force goes as tetrahedra shrink: Richardson's estimate along the better of the two forms. */
typedef struct study_truth {
    bool extrapolated;
    int coarse, fine; /* runs */
    double order;     /* observed with three meshes, else assumed */
    bool order_observed;
    double uncertainty; /* relative: what other orders, and the other form's limit, would give */
    double *force_N, *u_m, rms_N;
    int frames, instruments;
} study_truth;

/* Of frames that are held to a price. */
typedef struct study_speed {
    double slower;   /* the machine, against when that was promised: 95th percentile of the frames, 1 at least */
    double over;     /* share of frames that took more processor time than the budget */
    double costlier; /* and of those that would have on a machine no slower than then */
} study_speed;

typedef struct study_choice {
    bool wanted, fits, kept, real_time;
    bool untried;                        /* the scene as it is, for the limit let nothing be tried */
    int mesh_run, extra[5], extra_count; /* runs whose settings it takes */
    int felt_run;                        /* extrapolator and sample rate, 0: the scene's */
    double frame_s;
    sim_sends sends;                   /* what that asks for */
    double predicted;                  /* error, from runs of one change each */
    double error, cost_s, share, busy; /* promised: measured before; 95th percentile: of a processor, of the frame */
    double work_s;                     /* what study_work_s took then */
    double held_error, held_share, held_wall_s;
    study_speed held;
    int held_frames, held_late;
    char file[1100];
} study_choice;

typedef struct study {
    const char *file, *json, *page;
    char *set[STUDY_SETS / 2]; /* of the command line */
    int set_count;
    const char *other_mesh[4]; /* --mesh */
    int other_count;
    double duration_s, limit_s, budget, frame_Hz, hold_s; /* below 0: not asked for; limit: of the whole study */
    double asked_s;                                       /* of the path; duration_s: what of it is studied */
    double finest;                                        /* tetrahedra of a finer mesh at most */
    bool quick, feels;                                    /* feels: the scene names haptics */
    int sends;                                            /* sim_sends that it names, -1: none */
    int own_law, own_times;                               /* its extrapolator and samples of a frame; -1: no haptics */
    uint64_t scene_hash, files;                           /* files: of the scene, its mesh and fibres */
    int own_vertices;                                     /* of the scene's mesh */
    char folder[1024];                                    /* of refined meshes and turned fibres */
    study_mesh mesh[STUDY_MESHES];
    int mesh_count;
    study_run run[STUDY_RUNS];
    int run_count;
    cJSON *old; /* of a study that was broken off, or null */
    study_time time;
    study_truth truth;
    study_choice choice;
    double slower; /* the machine now, against what its runs were priced on */
    int worse;     /* settings that came out worse than was predicted of them, and lost by that */
} study;

/* All of it: 0 or an exit code, having complained. */
int study_whole(study *t);

/* --- run_matrix.c --- */
/* The run "as it is", then all others; those need it done. */
int study_plan_own(study *t);
int study_plan(study *t);

void study_make_key(const study *t, study_run *r);

/* --- study_time.c --- */
/* Starts the clock and, where stderr is no terminal, the line of every ten seconds. */
void study_time_begin(study *t);
void study_time_end(study *t);
/* What is done at present, and how much of it; below 0: not known. */
void study_doing(const study *t, const char *what, double share);
/* Seconds that a single run may take, and those that are left for runs. */
double study_run_limit_s(const study *t);
double study_left_s(const study *t);
/* Wall time that a run, or all extrapolators together, is expected to take, by the scene as it is and runs made. */
double study_expected_s(const study *t, const study_run *r);
double study_expected_felt_s(const study *t);
/* Of those that `first` serves. */
double study_expected_group_s(const study *t, const study_run *first);
/* Before a run: false, and it is left out, where it is expected to take too long. */
bool study_may_start(study *t, study_run *r, double expected_s);
/* After frame k of a run: false where the rest of it would take too long; then it is left out. Of the scene as it is:
 * false where the path is to end here. */
bool study_goes_on(study *t, study_run *r, int k);
/* The same of one of several parts of a run, which began at `began_s`. */
bool study_part_goes_on(study *t, study_run *r, double began_s, int k, int frames);
void study_leave_out(study_run *r, const char *whose, double needs_s, double has_s);
void study_run_took(study *t, double expected_s);
/* What trying and holding a recommendation is expected to take. */
double study_try_s(const study *t);
double study_verify_s(const study *t);
/* Whether the limit holds another run of the choice before the last one, in real time. */
bool study_may_try(const study *t);
double study_end_s(const study *t); /* to the end of the limit */
/* "1 min 20 s". */
const char *study_span(double seconds, char text[24]);
/* "the path", or "the first 1.6 s of the path's 8 s". */
void study_path_words(const study *t, char *text, size_t size);

/* --- study_mesh.c --- */
/* Makes coarser meshes, refined ones by bisection as far as `limit_s` allows, and takes --mesh ones. */
int study_make_meshes(study *t, const sim *own);
/* Files with every fibre turned by +-angle about an axis across fibres and hand. */
bool study_turn_fibres(study *t, const sim *own, double angle_rad, char path[1024]);

/* --- group_transfer.c --- */
/* How many supports name vertices by their numbers. */
int study_carried(const sim *own);
/* Those become groups in this run, whose mesh has them. */
void study_set_carried(study_run *r, const sim *own);
/* The scene's mesh in metres, with them as groups. */
bool study_write_carried(const sim *own, const char *path);
/* `mesh`, made anew of the same organ, with its regions, groups and fibres [3*tet_count]. False: a region or group
 * found no place in it. */
bool study_transfer(const sim *own, const tm_mesh *mesh, const char *path, double *fibre);

/* --- study_measure.c --- */
study_run *study_add(study *t, const char *knob, const char *name);
void study_set(study_run *r, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Runs it, unless the file has it; 0, or an exit code after Ctrl-C. What cannot be is r->failed, no error. */
int study_measure(study *t, study_run *r);
/* Mean and 95th percentile of frames; sorts both. */
void study_measure_cost(study_run *r, double *cost_s, double *busy_s, int frames);
/* Among how many threads its step is divided. */
int study_threads(const sim *s);
/* Builds with stderr turned into `why`; null: it cannot be. */
sim *study_build(const char *file, char *const *set, int set_count, char *why, size_t size);

/* Called before and after each force sample of a frame; null: not. */
typedef struct study_each {
    void (*before)(void *user, int sample);
    void (*after)(void *user, const sim *s, int sample);
    void *user;
} study_each;
/* Runs frame k along the hand's path, sample by sample. cost_s: processor time of its samples and of `after`. Returns
 * false if it went unstable or was broken off. */
bool study_frame(sim *s, int k, const study_each *each, double *cost_s);
/* How many samples before a frame's last one the force lies that one sample a frame would average. */
double study_back(const sim *s);
/* out_N [frames][width]: of samples_N [frames*samples][width] the force at each frame's end, so far back. */
void study_at_frames(const double *samples_N, int frames, int samples, size_t width, double back, double *out_N);

/* --- rendered_force.c --- */
/* Runs for each extrapolator at each rate of force samples; those of one rate are measured together. */
void study_plan_felt(study *t, const sim *own);
int study_measure_felt(study *t);

/* --- study_rate.c --- */
/* Whether it is judged by the error at the hand between samples. */
bool study_is_felt(const study_run *r);
double study_rate_Hz(const study *t, const study_run *r);
/* The best extrapolator of those with so many samples a frame, whatever they cost; 0: none. */
int study_best_at(const study *t, int times);
/* Table of them. */
void study_print_rates(const study *t);
/* Why the recommended rate: a sentence; empty where there is none. */
void study_rate_reason(const study *t, char *text, size_t size);
/* Processor time of a second of the path over that of the scene as it is. */
double study_times_dearer(const study *t, const study_run *r);
/* Errors of a force that no hand tells apart. */
double study_alike(double error);
/* Of extrapolators and rates that cost no more than `dearer_max` times the scene as it is, and are not excluded
 * [run_count], the truest at the hand; of alike ones the cheapest, and of those the scene's own. 0: none. */
int study_choose_felt(const study *t, double dearer_max, const bool *excluded);

/* --- study_store.c --- */
void study_open(study *t);
bool study_find(const study *t, study_run *r);
/* What of the path an earlier call with this limit took; `asked_s` where there was none. */
double study_old_span_s(const study *t, double asked_s);
int study_save(const study *t, bool whole);

/* --- error_estimate.c --- */
void study_judge(study *t);
/* Root mean square of a - b over that of b, frames and components of the force. */
double study_distance(const double *a, const double *b, size_t count);

/* --- study_recommend.c --- */
int study_recommend(study *t);
void study_say(const study *t);

/* --- verification.c --- */
/* Written, and built; null: that, or `rc`. */
sim *study_build_choice(study *t, char *why, size_t size, int *rc);
/* Both end the simulation. */
/* The choice's scene along the path, frame after frame: its error, price and work in `out`; false: went unstable. */
bool study_price(study *t, sim *s, study_choice *out);
/* The same in real time, for `hold_s` at least, held to what was promised, built anew for every time round. */
void study_verify(study *t, sim *s);

/* --- machine_speed.c --- */
/* Processor time, s, of a fixed piece of work. One thread's. */
double study_work_s(void);
/* cost_s, work_s [frames]: what each frame and the work beside it took; work_then_s: the work when the price was
 * promised, 0: not known; allowed_s: a frame's budget. */
study_speed study_judge_pace(const double *cost_s, const double *work_s, int frames, double work_then_s,
                             double allowed_s);
/* Whether the promise was kept, in words, and what the machine has to do with it. */
void study_verdict(const study_choice *c, char *text, size_t size);

/* --- study_yaml.c --- */
/* The scene with `edit` (as --set takes them) laid over its text, after the comment `evidence`. */
int study_write_yaml(const study *t, const char *path, char *const *edit, int edit_count, const char *evidence);

#endif
