/* tm-accuracy: what each choice costs in error and in time. A knob is a row in the table of main.c. */
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
    double depth; /* of the press, as a share of BLOCK_M */
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
    bool volume; /* the effect of that name */
    double smoothed_shear_share;
    bool pressed;    /* false: bottom clamped and the symmetry planes, nothing else: free to vibrate */
    double rotation; /* threshold of the effect; 0: linear */
    const tm_viscosity_def *viscosity; /* the effect of that name; null: none */
    bool fixed;                        /* [true] false: nothing is */
    double dt_s;                       /* 0: the guaranteed step times step_fraction */
    double step_fraction;
} problem_def;

/* Isotropic liver, undamped, pressed by 5 %. */
problem_def problem_default(int cells);
tm_status problem_create(const problem_def *def, problem *p, tm_error *error);
void problem_destroy(problem *p);
/* Holds `count` components at `value_m`; frees both arrays. */
tm_status problem_hold(tm_world *world, int32_t count, int32_t *dof, double *value_m, tm_error *error);

/* What is compared, at rest. */
typedef struct measured {
    double probe_u_m[3 * PROBES]; /* at 1/3, 2/3 and 1 of the edge (cells must be a multiple of 3) */
    double force_z_N;             /* on the indenter's patch */
    double energy_J;
} measured;
tm_status problem_settle(problem *p, double tolerance, measured *m, tm_error *error);

/* Largest probe difference over the largest probe displacement; relative differences of force and energy. */
typedef struct differences {
    double displacement, reaction, energy;
} differences;
differences compare(const measured *m, const measured *truth);

/* Materials of the reference. */
tm_material material_liver(void);
tm_material material_fibre(void);

/* Median seconds of one step of each of `count` worlds, runs interleaved so that a slow spell of the machine hits all
 * alike. */
void time_steps(tm_world **world, int count, int rounds, double *seconds_per_step);

/* The references of CalculiX, from reference.json. `name`: "iso", "fibre" or "neo"; `index`-th case. */
int reference_cases(const cJSON *truth, const char *name);
bool reference_case(const cJSON *truth, const char *name, int index, double *depth, measured *m);

/* Settings shared by all knobs. */
typedef struct run {
    bool quick;         /* the short form: fewer and smaller meshes */
    int rounds;         /* of interleaved timing */
    const cJSON *truth; /* the references */
    void (*progress)(const char *knob, double fraction);
} run;

/* The case, or an error that says that the file has none. */
tm_status reference_take(const run *r, const char *name, int index, double *depth, measured *m, tm_error *error);

/* A block of the run matrix: pressed as its definition says, at rest, held against the truth, and timed beside the
 * others. */
typedef struct solved {
    problem p;
    measured m;
    differences off;
    double seconds_per_step;
} solved;
enum { MATRIX = 16 };
/* All `count` of them; `truth` null: the first. Free with matrix_free whatever is returned. */
tm_status matrix_solve(const run *r, const char *knob, const problem_def *def, int count, double tolerance,
                       const measured *truth, solved *out, tm_error *error);
void matrix_free(solved *s, int count);
/* Adds displacement, reaction and energy. */
cJSON *differences_add(cJSON *to, const differences *d);
/* Adds what a step costs. */
cJSON *price_add(cJSON *to, const solved *s);
/* Linear tissue scales. */
measured measured_scaled(const measured *m, double scale);

/* One knob: measures into `out` and its "rows". */
typedef tm_status knob_measure(const run *r, cJSON *out, cJSON *rows, tm_error *error);
knob_measure knob_mesh, knob_volume, knob_step, knob_mass, knob_precision, knob_model, knob_rotation, knob_viscosity,
    knob_friction, knob_fibre;

#endif
