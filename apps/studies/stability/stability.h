/* tm-stability: the hard cases and their verdicts. Each case is a row of a table; each group of cases is a file. */
#ifndef TM_STABILITY_H
#define TM_STABILITY_H

#include "bench.h"
#include "tensormass.h"
#include "tensormass/cut.h"
#include "tensormass/grasp.h"

/* Outcome of a case. Any other than the expected one is a defect of the project. */
typedef enum verdict {
    ACCURATE = 0, /* remains accurate: the figure is an error within the row's bound */
    STABLE = 1,   /* remains stable with a loss, which the figure gives */
    REFUSED = 2,  /* refused, with the message quoted */
    BROKEN = 3    /* NaN, blow-up, silent reset, or a figure above its bound */
} verdict;

#define SERIES_MAX 400

typedef struct outcome {
    verdict verdict;
    double figure;
    char text[640]; /* the figure in a sentence, or the message of a refusal */
    int count;      /* length of the plotted series; 0: none */
    const char *x_name, *y_name;
    double x[SERIES_MAX], y[SERIES_MAX];
} outcome;

typedef struct hard_case {
    const char *group, *name, *what;
    verdict expected;
    double bound;            /* bound of the figure; ignored for REFUSED */
    const char *figure_name; /* "energy drift", "force over limit" ... */
    void (*run)(bool quick, double argument, outcome *o);
    double argument; /* parameter, so that one function serves several cases */
} hard_case;

/* All groups of cases in their order: the table cases_NAME of each file. */
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

/* Returns the default: 4x4x4 cells of 10 mm, E = 5 kPa, nu = 0.45, undamped, bottom fixed, 0.95 times the guaranteed
 * step. */
app_bench_def bench_default(void);
/* Opens a block. On failure sets the outcome to REFUSED with the message and returns false. Close it by
 * app_bench_close. */
bool bench_open(const app_bench_def *def, app_bench *b, outcome *o);
/* Builds the same on the mesh that `b` already has, its lowest layer of vertices first. */
bool bench_start(const app_bench_def *def, app_bench *b, outcome *o);

/* A block with instruments of 2.5 mm that press it, and their forces. */
enum { RIG_TOOLS = 2 };
typedef struct rig {
    app_bench b;
    tm_contact *contact;
    tm_grasp *grasp;
    tm_friction *friction;
    int tools;
    tm_tool_pose at[RIG_TOOLS];
    double force_N[RIG_TOOLS][3]; /* in the last frame */
    bool finite;                  /* no step failed and all forces were finite */
    outcome *o;
} rig;

typedef struct rig_def {
    app_bench_def bench; /* cuttable: adds the cutting stage */
    int tools;
    tm_instrument_def tool[RIG_TOOLS];
    double row_compliance_m_N;
    const tm_friction_def *friction; /* or null */
    bool jaws, energy;
} rig_def;

/* Returns `tools` probes that stand upright above their start. */
rig_def rig_default(int tools, const tm_tool_pose *start);
/* Opens a rig like bench_open; close it by app_bench_close(&r->b). `force_name` labels the curve. */
bool rig_open(const rig_def *def, rig *r, const char *force_name, outcome *o);
/* Runs one frame of `steps` steps in which the tools move to r->at, or jump there. Forces are means over the last
 * `window` steps. */
void rig_steps(rig *r, int32_t steps, int32_t window, bool jump);
void rig_frame(rig *r, double frame_s, int32_t window);
/* Moves the tools to the k-th of `frames` equal parts of the way, with the roll and grip of its end. */
void rig_lead(rig *r, const tm_tool_pose *from, const tm_tool_pose *to, int k, int frames);
/* Returns the largest excess of a tool's stations over their friction cones and whether one slips. Adds up tangential
 * and normal forces if requested. */
double rig_over_cone(const rig *r, int tool, bool *slips, double *along_N, double *normal_force_N);

void accurate(outcome *o, double figure, const char *format, ...) __attribute__((format(printf, 3, 4)));
void stable(outcome *o, double figure, const char *format, ...) __attribute__((format(printf, 3, 4)));
void refused(outcome *o, const tm_error *error);
void broken(outcome *o, const char *format, ...) __attribute__((format(printf, 2, 3)));
void series_add(outcome *o, double x, double y);

/* Runs `steps` undamped steps from random velocities, in which the scheme's energy must be conserved. Returns its
 * largest relative change, negative if the run broke. Adds the energy to the series. */
double energy_drift(app_bench *b, int64_t steps, outcome *o);
/* Returns the scheme's energy: v.Mv/2 at n+1/2 plus u_n.K u_(n+1)/2, from the world's u_prev and u. */
double scheme_energy(app_bench *b, double *scratch);
/* Places each vertex of corotated tissue at random in a box of half the size. */
void turn_inside_out(app_bench *b);
/* Leaves corotated tissue free for `seconds` and reports the remaining share of its energy. */
void come_back(app_bench *b, double seconds, outcome *o);
void random_velocities(app_bench *b, uint64_t seed, double speed_m_s);
double random_unit(uint64_t *state); /* -1..1 */

#endif
