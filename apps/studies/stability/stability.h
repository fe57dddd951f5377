/* tm-stability: every hard case and its verdict. One row of a table a case; groups are files. */
#ifndef TM_STABILITY_H
#define TM_STABILITY_H

#include "bench.h"
#include "tensormass.h"
#include "tensormass/cut.h"
#include "tensormass/grasp.h"

/* What became of a case. Anything else than the row expects is a failure of the project. */
typedef enum verdict {
    ACCURATE = 0, /* stays accurate: the figure is an error, and within the row's bound */
    STABLE = 1,   /* stays stable with a stated loss: the figure says how large */
    REFUSED = 2,  /* refused, with the message quoted */
    BROKEN = 3    /* NaN, blow-up, silent reset, or a figure above its bound */
} verdict;

#define SERIES_MAX 400

typedef struct outcome {
    verdict verdict;
    double figure;
    char text[640]; /* the figure in words, or the message of a refusal */
    int count;      /* of the series, for the plot: 0 none */
    const char *x_name, *y_name;
    double x[SERIES_MAX], y[SERIES_MAX];
} outcome;

typedef struct hard_case {
    const char *group, *name, *what;
    verdict expected;
    double bound;            /* on the figure; ignored for REFUSED */
    const char *figure_name; /* "energy drift", "force over limit" ... */
    void (*run)(bool quick, double argument, outcome *o);
    double argument; /* lets one function serve a row of cases */
} hard_case;

/* Every group of cases: a table cases_NAME of its own file, in the order in which they run. */
#define CASE_GROUPS(ROW)                                                                                               \
    ROW(tissue)                                                                                                        \
    ROW(volume)                                                                                                        \
    ROW(tool)                                                                                                          \
    ROW(cut)                                                                                                           \
    ROW(energy)                                                                                                        \
    ROW(link)                                                                                                          \
    ROW(torture)                                                                                                       \
    ROW(rotation)                                                                                                      \
    ROW(viscosity)                                                                                                     \
    ROW(relax)                                                                                                         \
    ROW(friction)

#define CASES_DECLARED(name)                                                                                           \
    extern const hard_case cases_##name[];                                                                             \
    extern const int cases_##name##_count;
CASE_GROUPS(CASES_DECLARED)

/* --- helpers of the cases --- */

/* 4x4x4 cells of 10 mm, E = 5 kPa, nu = 0.45, undamped, bottom held, 0.95 of the guaranteed step. */
app_bench_def bench_default(void);
/* On failure the outcome is REFUSED with the message, and false comes back. Closed by app_bench_close. */
bool bench_open(const app_bench_def *def, app_bench *b, outcome *o);
/* The same on a mesh that is in `b` already, its lowest layer of vertices first. */
bool bench_start(const app_bench_def *def, app_bench *b, outcome *o);

/* A bench with instruments of 2.5 mm, whose contact every case here presses, and what was felt of it. */
enum { RIG_TOOLS = 2 };
typedef struct rig {
    app_bench b;
    tm_contact *contact;
    tm_grasp *grasp;
    tm_friction *friction;
    int tools;
    tm_tool_pose at[RIG_TOOLS];
    double force_N[RIG_TOOLS][3]; /* of the last frame */
    bool finite;                  /* no step failed, no force was not finite */
    outcome *o;
} rig;

typedef struct rig_def {
    app_bench_def bench; /* cuttable: with the stage that cuts */
    int tools;
    tm_instrument_def tool[RIG_TOOLS];
    double row_compliance_m_N;
    const tm_friction_def *friction; /* or null */
    bool jaws, energy;
} rig_def;

/* `tools` probes that stand upright above where they start. */
rig_def rig_default(int tools, const tm_tool_pose *start);
/* As bench_open; closed by app_bench_close(&r->b). `force_name` is of the curve's axis. */
bool rig_open(const rig_def *def, rig *r, const char *force_name, outcome *o);
/* Runs one frame of so many steps in which tools go to r->at, or jump there; forces are means over `window` of them. */
void rig_steps(rig *r, int32_t steps, int32_t window, bool jump);
void rig_frame(rig *r, double frame_s, int32_t window);
/* Tools go on to the k-th of `frames` equal parts of the way; roll and grip are those of its end. */
void rig_lead(rig *r, const tm_tool_pose *from, const tm_tool_pose *to, int k, int frames);
/* Of the stations of a tool: how far its worst is outside its cone, and whether one slips; adds up, where wanted, what
 * is borne along the surface and presses. */
double rig_over_cone(const rig *r, int tool, bool *slips, double *along_N, double *normal_force_N);

void accurate(outcome *o, double figure, const char *format, ...) __attribute__((format(printf, 3, 4)));
void stable(outcome *o, double figure, const char *format, ...) __attribute__((format(printf, 3, 4)));
void refused(outcome *o, const tm_error *error);
void broken(outcome *o, const char *format, ...) __attribute__((format(printf, 2, 3)));
void series_add(outcome *o, double x, double y);

/* Random velocities, then `steps` undamped steps: the scheme's own energy must stay. Returns its largest relative
 * change; negative: the run broke. Adds energy to the series. */
double energy_drift(app_bench *b, int64_t steps, outcome *o);
/* The scheme's own energy: v.Mv/2 at n+1/2 plus u_n.K u_(n+1)/2, from the world's u_prev and u. */
double scheme_energy(app_bench *b, double *scratch);
/* Of turning tissue: puts each vertex anywhere in a box of half the size. */
void turn_inside_out(app_bench *b);
/* Leaves turning tissue alone for `seconds` and says what energy is left of what it had. */
void come_back(app_bench *b, double seconds, outcome *o);
void random_velocities(app_bench *b, uint64_t seed, double speed_m_s);
double random_unit(uint64_t *state); /* -1..1 */

#endif
