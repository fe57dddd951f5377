/* The on-line system: contact of all instruments and imposed vertices, on a compliance that somebody else knows.
 *
 * Unknown are the forces f on a few surface vertices (slots). The shape u = base + C f gives the contact rows of the
 * core's own finder, and the rows give forces: the skin's reaction to their depth, not below 0 and not above the cap.
 * That is the unilateral problem with regularised rows. It is solved for f = rows(base + C f) by Newton's method: the
 * force is the converged one, of today's normals and shares. How a row's force changes along its normal is known and
 * makes a matrix; all else (normals that turn, shares that pass from row to row) is felt by looking again beside the
 * shape, in a few Krylov steps preconditioned by that matrix. */
#ifndef TMS_CONTACT_SOLVER_H
#define TMS_CONTACT_SOLVER_H

#include "internal.h"
#include "tensormass/friction.h"
#include "tensormass/grasp.h"

enum {
    TMS_NEWTON_STEPS = 16,
    TMS_HALVINGS = 4,
    TMS_MAX_SOLVES = 256,
    TMS_KRYLOV = 24,
    TMS_PAIRS = 10,
    TMS_SECANT_STEPS = 10,
    TMS_GATHER_EVERY = 8 /* solves */
};
#define TMS_PATH_STEP 0.125 /* radii: of the path of a tool, solved at once */

typedef struct tms_tool {
    tm_instrument_def def;
    tm_tool_pose pose;
    tm_capsule capsule;
    bool prescribed;           /* its rows of before stay, and bear what they bore: it is not solved for */
    tm_contact_search *search; /* surface around it */
    bool near;                 /* there is some */
    tm_capsule gathered_at;    /* where it was then */
    bool overflowed;
} tms_tool;

/* What friction does at one station of a tool at one shape: rows first .. first + count - 1 of the look. */
typedef struct tms_friction_station {
    int32_t first, count;
    bool slips;
    double load_N, normal_force_N, normal[3];
    double force_N[3], stretch_N; /* on the tissue; its size before it was shortened to the cone */
} tms_friction_station;

enum { TMS_STATIONS = 256 }; /* of a tool, as rows number them */

/* What lasts from solution to solution, of one station. */
typedef struct tms_friction_state {
    double force_N[3], stick_state; /* on the tissue; 1 has rested .. 0 has slid */
} tms_friction_state;

/* Friction: there is memory for it only where it is named. */
typedef struct tms_friction {
    tm_friction_coefficient coefficient[TM_MAX_INSTRUMENTS];
    tms_friction_state state[TM_MAX_INSTRUMENTS][TMS_STATIONS];
    tm_capsule capsule[TM_MAX_INSTRUMENTS]; /* of the solution before */
    double *u_m;                            /* [3*vertex_count] shape of the solution before, where it is known */
    int32_t *known_solution, solution;      /* [vertex_count] number of the solution that u_m is of; that before */
    tms_friction_station *station[2];       /* [max_rows] of both looks */
} tms_friction;

/* What the rows of one shape do. */
typedef struct tms_contact_eval {
    tm_contact_row *row; /* [max_rows] */
    int32_t count;
    double *fc; /* [3*capacity] forces on the slots */
    double force_N[TM_MAX_INSTRUMENTS][3], resultant_N[TM_MAX_INSTRUMENTS][3];
    bool capped[TM_MAX_INSTRUMENTS];
    int32_t station_count;
    tms_friction_station *station; /* [max_rows] with friction */
} tms_contact_eval;

/* A vertex held: by hand (tool -1) or between jaws; or let go by jaws, whose spring then bears no more than a force
 * that fades. */
typedef struct tms_pin {
    int32_t vertex, tool;
    double u_m[3], compliance_m_N;
    bool fades;
    double max_N;    /* of one that fades */
    bool prescribed; /* it bears all that it can, at the shape looked at last: force_N, whose direction is the spring's
                      */
    double force_N[3], rotation_N_m;
} tms_pin;

/* What the jaws of one grasper have. */
typedef struct tms_grasp {
    tm_jaw jaw;
    tm_grasp_state state;
    bool was_closed;
    double fade;
    int32_t count, *vertex; /* [max_vertices] */
    double *offset_m;       /* [3*max_vertices] in the jaw's frame */
    double *let_go_N;       /* [3*max_vertices] */
    double *distance_m;     /* [max_vertices] scratch */
} tms_grasp;

typedef struct tms_contact_solver {
    const tm_mesh *mesh;
    tm_surface_view surface;
    tm_contact_def def; /* instrument_count 0: no contact */
    int32_t tool_count;
    tms_tool tool[TM_MAX_INSTRUMENTS];
    /* the client's */
    void *self;
    void (*compliance)(void *self, int32_t a, int32_t b,
                       double C[9]); /* of vertex a by forces on vertex b, m/N, row-major */
    void (*refresh)(void *self, const int32_t *vertex,
                    int32_t count);                        /* bring base_m up to date at these; may be null */
    bool (*passes)(void *self, const tm_contact_row *row); /* a row that is no obstacle; may be null */
    void (*update_neighbourhood)(
        void *self); /* bring u_m about up to date, before triangles are chosen by it; may be null */
    double *base_m;  /* [3*vertex_count] shape without f */
    double *u_m;     /* [3*vertex_count] shape: at the slots always, elsewhere as the client left it */
    /* slots */
    int32_t capacity, used_count, high; /* slots below `high` have been used */
    int32_t gather_every;               /* solves that what surrounds the tools is kept for */
    int32_t gathered_age;               /* solves since what surrounds the tools was looked for */
    double wandered_m;         /* how far the tissue may have moved by itself since: for the client to count; else 0 */
    int32_t *slot_of;          /* [vertex_count] -1 */
    int32_t *vertex;           /* [capacity] -1: never used */
    int32_t *used;             /* [used_count] slots of this solve, by ascending vertex */
    uint8_t *wanted;           /* [capacity] */
    int32_t *stamp, stamp_now; /* [vertex_count] */
    int32_t *list;             /* [capacity] wanted vertices, ascending */
    double *block;             /* [3*capacity][3*capacity] */
    double *f, *f_saved, *f_spare, *r, *f_kept, *du; /* [3*capacity] by slot */
    int32_t *pin_of;                                 /* [capacity] -1 */
    tms_pin *pin;                                    /* [capacity] */
    int32_t pin_count, imposed_count;                /* those by hand come first */
    tm_grasp_def grasp;                              /* max_vertices 0: graspers hold nothing */
    tms_grasp grasp_of[TM_MAX_INSTRUMENTS];
    double update_s;
    /* rows */
    tms_contact_eval now, probe; /* of the solution; of a shape beside it */
    tm_contact_row *previous;    /* [max_rows] of the solution before */
    int32_t previous_count;
    /* Newton */
    int32_t active_count, *active; /* slots with unknown forces */
    int32_t *active_of;            /* [capacity] -1 */
    double *lu;                    /* [(3*capacity)^2] */
    int32_t *pivot;
    double *step; /* [3*capacity] by act, as are the Krylov vectors */
    double *krylov[TMS_KRYLOV + 1], *preconditioned[TMS_KRYLOV];
    double *pair_f[TMS_PAIRS],
        *pair_r[TMS_PAIRS]; /* [3*capacity] by slot: changes of f and r that went together, lately */
    int32_t pair_count, pair_next;
    double loose_tolerance; /* of the largest displacement, as the tolerance of one solution of many: where a step has
                      brought it so far, the next solution goes on from there. 0: none is enough */
    bool inexact; /* Newton's method ends there too, where secant steps stall: else it goes to the tolerance */
    bool converged, nearly;
    tms_friction *friction; /* null: no friction */
    int64_t bytes;
    void *allocation;
} tms_contact_solver;

/* All memory now. `contact` null: none. The surface view's arrays must stay. */
tm_status tms_contact_solver_create(const tm_mesh *mesh, tm_surface_view surface, const tm_contact_def *contact,
                                    const tm_grasp_def *grasp, int32_t capacity, tms_contact_solver *solver,
                                    tm_error *error);
void tms_contact_solver_destroy(tms_contact_solver *solver);
/* Where a tool is now; what it touched before is still known. */
void tms_contact_solver_move(tms_contact_solver *solver, int32_t tool, const tm_tool_pose *pose);
/* A tool put there: what it touched before is forgotten. */
void tms_contact_solver_set_pose(tms_contact_solver *solver, int32_t tool, const tm_tool_pose *at);
bool tms_contact_solver_can_touch(const tms_tool *tool);
/* All compliances are asked for anew. */
void tms_contact_solver_forget(tms_contact_solver *solver);
/* Slots for everything near the tools; forces of vertices that left are dropped. Nothing is looked for again while no
 * tool has moved far and not much time has passed, unless _regather was called. */
void tms_contact_solver_gather(tms_contact_solver *solver);
void tms_contact_solver_regather(tms_contact_solver *solver);
/* The tissue may have moved so far that they are to be looked for again. */
bool tms_contact_solver_has_wandered(const tms_contact_solver *solver);
/* Newton's method from the forces there are. Returns the steps taken; `converged` tells. */
int32_t tms_contact_solver_solve(tms_contact_solver *solver);
/* contact_solver.c: after a solve that did not converge, of a system without pins; from the forces of before it. */
void tms_contact_solver_freeze(tms_contact_solver *solver, const double *f_before);
/* Moves all tools to `pose` in pieces, gathering and solving at each. */
int32_t tms_contact_solver_update(tms_contact_solver *solver, const tm_tool_pose *pose);
/* d(force at the tip)/d(tip) of the converged solution, row-major. Leaves the solution as it was. */
void tms_contact_solver_stiffness(tms_contact_solver *solver, int32_t tool, double K[9]);
/* How the other tools, what they hold, and imposed vertices answer: after _without, _yield gives the forces (by act)
 * with which they meet a displacement (by act) that something else makes. To first order, with their normals and shares
 * as they are. */
bool tms_contact_solver_without(tms_contact_solver *solver, int32_t tool);
void tms_contact_solver_yield(tms_contact_solver *solver, int32_t tool, const double *u_m, double *df_N);
/* online_grasp.c. Once an update: jaws close, open, let go a little more. Then wherever the tools have moved: pins
 * follow the jaws. */
void tms_contact_solver_work_jaws(tms_contact_solver *solver);
void tms_contact_solver_follow_jaws(tms_contact_solver *solver);
/* After a solve: where a spring that fades bears all that it can, its place in the jaw slips after the vertex, so that
 * it never drives tissue that another tool, or its own shape, has taken along. */
void tms_contact_solver_slip(tms_contact_solver *solver);
bool tms_contact_solver_is_grasping(const tms_contact_solver *solver, int32_t tool);
/* online_friction.c. Null: no memory. */
tms_friction *tms_friction_create(const tm_friction_def *def, const tm_contact_def *contact, int32_t vertex_count);
void tms_friction_destroy(tms_friction *friction); /* null is allowed */
bool tms_contact_solver_has_friction(const tms_contact_solver *solver, int32_t tool);
/* Every slot's place at the solution before is known; of those that came anew it is their present one, by the forces
 * of that solution. */
bool tms_contact_solver_friction_knows(const tms_contact_solver *solver);
void tms_contact_solver_friction_learn(tms_contact_solver *solver);
/* A solution is taken: what slipped stays slipped. */
void tms_contact_solver_friction_settle(tms_contact_solver *solver, double passed_s);
void tms_contact_solver_friction_place(tms_contact_solver *solver, int32_t tool);
/* A row whose vertices are all in its own tool's jaws is no obstacle. */
bool tms_contact_solver_in_jaws(const tms_contact_solver *solver, const tm_contact_row *row);
/* On the tool, rows and jaws together. */
void tms_contact_solver_force(const tms_contact_solver *solver, int32_t tool, double force_N[3], double resultant_N[3]);
/* tm_reaction_flag of the solution there is. */
uint32_t tms_contact_solver_flags(const tms_contact_solver *solver, int32_t tool);
tm_tool_reaction tms_contact_solver_reaction(const tms_contact_solver *solver, int32_t tool);

/* A vertex gets this slot, and its compliances with all below. */
void tms_contact_solver_fill(tms_contact_solver *solver, int32_t slot, int32_t vertex);
/* contact_solver_snapshot.c: what is kept between solves, as the hooks of a stage want it, of a system without pins.
 * `forgotten`: as if tms_contact_solver_forget had been called. Most bytes that it can be. */
int64_t tms_contact_solver_snapshot(const tms_contact_solver *solver, bool forgotten, void *buffer);
bool tms_contact_solver_restore(tms_contact_solver *solver, const void *buffer, int64_t bytes, bool apply);
int64_t tms_contact_solver_snapshot_max(const tms_contact_solver *solver);

/* newton_matrix.c: LU with partial pivoting, row-major. Its own, because it runs inside steps: OpenBLAS's dgetrf and
 * dgetrs take a lock each, Eigen's memory from some size on; and up to 45 unknowns it is the fastest
 * (notes/2026-11-24-models.md). */
bool tms_lu(double *a, int32_t *pivot, int32_t n);
void tms_lu_solve(const double *a, const int32_t *pivot, int32_t n, double *x);

/* --- between contact_solver.c, newton_matrix.c and newton.c: each depends on those before it --- */

static inline const tms_pin *tms_pin_of(const tms_contact_solver *l, int32_t slot) { return &l->pin[l->pin_of[slot]]; }

static inline bool tms_is_pinned(const tms_contact_solver *l, int32_t slot, int axis) {
    const int64_t d = 3 * slot + axis;
    return l->pin_of[slot] >= 0 && !l->pin[l->pin_of[slot]].prescribed &&
           l->block[d * 3 * l->capacity + d] > 0; /* a fixed component stays where it is */
}

/* A force that a spring bears at most keeps its size and turns with the spring: change of its component `c` for a
 * move of the vertex along axis `j`, N/m. */
static inline double tms_pin_rotates(const tms_pin *pin, int c, int j) {
    const double along = pin->max_N > 0 ? pin->force_N[c] * pin->force_N[j] / (pin->max_N * pin->max_N) : 0;
    return pin->prescribed ? -pin->rotation_N_m * ((c == j) - along) : 0;
}

/* out [3*high] := displacements by forces on `slot`, given by slot or in the list's order. */
void tms_contact_solver_response(const tms_contact_solver *solver, const int32_t *slot, int32_t count, const double *f,
                                 bool by_slot, double *out);
/* u at the slots from base and forces. */
void tms_contact_solver_shape(tms_contact_solver *solver);
/* out += f times the displacements of all slots below `high` by a unit force on a component of one. */
void tms_contact_solver_spread(const tms_contact_solver *solver, int32_t component, double f, double *restrict out);
/* Rows of the shape in u_m that are no farther off than `margin` radii, their forces on the slots and on the tools. */
void tms_contact_solver_evaluate_shape(tms_contact_solver *solver, tms_contact_eval *look, double margin);
/* Those forces anew, of the rows as they stand. */
void tms_contact_solver_sum(const tms_contact_solver *solver, tms_contact_eval *look);
/* Both, and the residual r: the sum of squares of the displacements it would make. Sets `converged`. */
double tms_contact_solver_evaluate(tms_contact_solver *solver);
/* Known part of the matrix at the present rows, over act, factorised; `without`: a tool that is left out, -1. False:
 * singular. */
bool tms_contact_solver_factor(tms_contact_solver *solver, int32_t without);
/* Displacement that the residual of the j-th unknown would make, per unit: the norm that residuals are compared in. */
double tms_contact_solver_scale(const tms_contact_solver *solver, int32_t j);
/* online_friction.c: what friction adds to a look; to the matrix of the present one. */
void tms_contact_solver_friction(const tms_contact_solver *solver, tms_contact_eval *look);
void tms_contact_solver_add_friction_matrix(tms_contact_solver *solver, const tms_friction_station *station, int32_t m);

#endif
