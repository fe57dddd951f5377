/* tm-accuracy: error and time of each setting. A knob (studied parameter) is a row in the table of main.c. */
#ifndef TM_ACCURACY_H
#define TM_ACCURACY_H

#include "json_file.h"
#include "tensormass.h"

/* The pressed quarter block of apps/studies/accuracy/reference/make_inp.py, on `cells`^3 cubes of six Kuhn tetrahedra.
 */
#define BLOCK_M 0.03
#define INDENTER_M 0.02
#define PROBES 27

typedef struct problem {
    int cells;
    double depth; /* depth of the press, as a share of BLOCK_M */
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    tm_rotation *rotation; /* or null */
} problem;

typedef struct problem_def {
    int cells;
    double depth;
    tm_material material;
    const double *fibre; /* one direction for all, or null */
    tm_precision precision;
    bool volume; /* strain smoothing is on */
    double smoothed_shear_share;
    bool pressed;    /* false: only the bottom is clamped and the symmetry planes hold; the block vibrates freely */
    double rotation; /* |grad u| above which tetrahedra are corotated; 0: linear */
    const tm_viscosity_def *viscosity; /* viscosity of the effect of that name; null: none */
    bool fixed;                        /* [true] false: no component is fixed */
    double dt_s;                       /* 0: the guaranteed step times step_fraction */
    double step_fraction;
} problem_def;

/* Returns the default: isotropic liver, undamped, pressed by 5 %. */
problem_def problem_default(int cells);
tm_status problem_create(const problem_def *def, problem *p, tm_error *error);
void problem_destroy(problem *p);
/* Fixes `count` components at `value_m`; frees both arrays. */
tm_status problem_hold(tm_world *world, int32_t count, int32_t *dof, double *value_m, tm_error *error);

/* Quantities compared at static equilibrium. */
typedef struct measured {
    double probe_u_m[3 * PROBES]; /* at 1/3, 2/3 and 1 of the edge (cells must be a multiple of 3) */
    double force_z_N;             /* force on the indenter's patch */
    double energy_J;
} measured;
tm_status problem_settle(problem *p, double tolerance, measured *m, tm_error *error);

/* Largest difference of a probe over the largest probe displacement; relative differences of force and energy. */
typedef struct differences {
    double displacement, reaction, energy;
} differences;
differences compare(const measured *m, const measured *truth);

/* Returns the material of the reference. */
tm_material material_liver(void);
tm_material material_fibre(void);

/* Measures the median seconds per step of each of `count` worlds. Runs are interleaved, so a slow spell of the machine
 * affects all alike. */
void time_steps(tm_world **world, int count, int rounds, double *seconds_per_step);

/* Returns the number of CalculiX references in reference.json; the second function reads the `index`-th. `name`: "iso",
 * "fibre" or "neo". */
int reference_cases(const cJSON *truth, const char *name);
bool reference_case(const cJSON *truth, const char *name, int index, double *depth, measured *m);

/* Settings common to all knobs. */
typedef struct run {
    bool quick;         /* the short form: fewer and smaller meshes */
    int rounds;         /* rounds of interleaved timing */
    const cJSON *truth; /* the references */
    const cJSON *laws;  /* those of nonlinear laws; null: none */
    void (*progress)(const char *knob, double fraction);
} run;

/* Reads the case of the reference. Returns an error if the file lacks it. */
tm_status reference_take(const run *r, const char *name, int index, double *depth, measured *m, tm_error *error);

/* A block of the run matrix: pressed as defined, at static equilibrium, compared with the reference solution, and timed
 * together with the others. */
typedef struct solved {
    problem p;
    measured m;
    differences off;
    double seconds_per_step;
} solved;
enum { MATRIX = 16 };
/* Solves all `count` of them; `truth` null: the first is the reference. Free with matrix_free in every case. */
tm_status matrix_solve(const run *r, const char *knob, const problem_def *def, int count, double tolerance,
                       const measured *truth, solved *out, tm_error *error);
void matrix_free(solved *s, int count);
/* Adds the differences of displacement, reaction and energy. */
cJSON *differences_add(cJSON *to, const differences *d);
/* Adds the cost of a step. */
cJSON *cost_add(cJSON *to, const solved *s);
/* Scales the solution of linear tissue. */
measured measured_scaled(const measured *m, double scale);

/* Measures one knob into `out` and its "rows". */
typedef tm_status knob_measure(const run *r, cJSON *out, cJSON *rows, tm_error *error);
knob_measure knob_mesh, knob_strain_smoothing, knob_step, knob_mass, knob_precision, knob_model, knob_rotation,
    knob_viscosity, knob_friction, knob_fibre, knob_law;

#endif
