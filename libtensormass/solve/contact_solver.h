/* The online contact solver: contact of all instruments and imposed vertices, with a compliance that the client
 * provides.
 *
 * Unknowns are the forces f on a few surface vertices (slots). The shape u = base + C f gives contact rows, by the
 * core's own detection. The rows give forces: the reaction of the contact compliance to their depth, not below 0 and
 * not above the cap. This is the unilateral problem with regularised rows. Newton's method solves f = rows(base + C f):
 * the result is the converged force, with the present normals and shares. The derivative of a row's force along its
 * normal is known and forms a matrix. The rest (rotating normals, shares that move between rows) comes from finite
 * differences, in a few Krylov steps preconditioned by that matrix. */
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
#define TMS_PATH_STEP 0.125 /* radii: part of a tool's path per solve */

typedef struct tms_tool {
    tm_instrument_def def;
    tm_tool_pose pose;
    tm_capsule capsule;
    bool prescribed;           /* its previous rows and their forces stay: it is not solved for */
    tm_contact_search *search; /* surface around it */
    bool near;                 /* surface is near */
    tm_capsule gathered_at;    /* pose at the last gathering */
    bool overflowed;
} tms_tool;

/* Friction at one station of a tool in one shape: rows first .. first + count - 1 of the evaluation. */
typedef struct tms_friction_station {
    int32_t first, count;
    bool slips;
    double load_N, normal_force_N, normal[3];
    double force_N[3], stretch_N; /* on the tissue; its size before it was limited to the cone */
} tms_friction_station;

enum { TMS_STATIONS = 256 }; /* per tool, as rows number them */

/* State of one station between solves. */
typedef struct tms_friction_state {
    double force_N[3], stick_state; /* on the tissue; 1 stuck .. 0 slid */
} tms_friction_state;

/* Friction; allocated only if it is used. */
typedef struct tms_friction {
    tm_friction_coefficient coefficient[TM_MAX_INSTRUMENTS];
    tms_friction_state state[TM_MAX_INSTRUMENTS][TMS_STATIONS];
    tm_capsule capsule[TM_MAX_INSTRUMENTS]; /* of the previous solve */
    double *u_m;                            /* [3*vertex_count] shape of the previous solve, where known */
    int32_t *known_solution, solution;      /* [vertex_count] solve that u_m belongs to; number of the previous solve */
    tms_friction_station *station[2];       /* [max_rows] of both evaluations */
} tms_friction;

/* Forces of the rows of one shape. */
typedef struct tms_contact_eval {
    tm_contact_row *row; /* [max_rows] */
    int32_t count;
    double *fc; /* [3*capacity] forces on the slots */
    double force_N[TM_MAX_INSTRUMENTS][3], resultant_N[TM_MAX_INSTRUMENTS][3];
    bool capped[TM_MAX_INSTRUMENTS];
    int32_t station_count;
    tms_friction_station *station; /* [max_rows] with friction */
} tms_contact_eval;

/* A prescribed vertex: imposed (tool -1) or between jaws. A vertex that jaws released has a spring whose force is
 * limited and fades. */
typedef struct tms_pin {
    int32_t vertex, tool;
    double u_m[3], compliance_m_N;
    bool fades;
    double max_N;    /* limit of a fading spring */
    bool prescribed; /* the spring is at its limit in the last shape: force_N, along the spring */
    double force_N[3], rotation_N_m;
} tms_pin;

/* State of one grasper's jaws. */
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
    /* callbacks of the client */
    void *self;
    void (*compliance)(void *self, int32_t a, int32_t b,
                       double C[9]); /* displacement of vertex a per force on vertex b, m/N, row-major */
    void (*refresh)(void *self, const int32_t *vertex, int32_t count); /* update base_m at these; may be null */
    bool (*passes)(void *self, const tm_contact_row *row);             /* whether to ignore a row; may be null */
    void (*update_neighbourhood)(
        void *self); /* update u_m approximately, before triangles are selected by it; may be null */
    double *base_m;  /* [3*vertex_count] shape without f */
    double *u_m;     /* [3*vertex_count] shape: always valid at the slots, elsewhere as set by the client */
    /* slots */
    int32_t capacity, used_count, high; /* slots below `high` have been used */
    int32_t gather_every;               /* solves between gatherings of the neighbourhood */
    int32_t gathered_age;               /* solves since the last gathering */
    double wandered_m;                  /* possible motion of the tissue since then; counted by the client, else 0 */
    int32_t *slot_of;                   /* [vertex_count] -1 */
    int32_t *vertex;                    /* [capacity] -1: never used */
    int32_t *used;                      /* [used_count] slots of this solve, by ascending vertex */
    uint8_t *wanted;                    /* [capacity] */
    int32_t *stamp, stamp_now;          /* [vertex_count] */
    int32_t *list;                      /* [capacity] wanted vertices, ascending */
    double *block;                      /* [3*capacity][3*capacity] */
    double *f, *f_saved, *f_spare, *r, *f_kept, *du; /* [3*capacity] by slot */
    int32_t *pin_of;                                 /* [capacity] -1 */
    tms_pin *pin;                                    /* [capacity] */
    int32_t pin_count, imposed_count;                /* imposed ones come first */
    tm_grasp_def grasp;                              /* max_vertices 0: no grasping */
    tms_grasp grasp_of[TM_MAX_INSTRUMENTS];
    double update_s;
    /* rows */
    tms_contact_eval now, probe; /* of the solution; of a perturbed shape */
    tm_contact_row *previous;    /* [max_rows] of the previous solve */
    int32_t previous_count;
    /* Newton */
    int32_t active_count, *active; /* slots with unknown forces */
    int32_t *active_of;            /* [capacity] -1 */
    double *lu;                    /* [(3*capacity)^2] */
    int32_t *pivot;
    double *step; /* [3*capacity] by active unknown, as the Krylov vectors */
    double *krylov[TMS_KRYLOV + 1], *preconditioned[TMS_KRYLOV];
    double *pair_f[TMS_PAIRS], *pair_r[TMS_PAIRS]; /* [3*capacity] by slot: recent pairs of changes of f and r */
    int32_t pair_count, pair_next;
    double loose_tolerance; /* loose tolerance, relative to the largest displacement, for one solve of many: the next
                             * solve continues from there. 0: the full tolerance is always used */
    bool inexact; /* Newton's method also stops at the loose tolerance, if secant steps stall; else it uses the full
                   * one */
    bool converged, nearly;
    tms_friction *friction; /* null: no friction */
    int64_t bytes;
    void *allocation;
} tms_contact_solver;

/* Allocates all memory. `contact` null: no contact. The surface view's arrays must stay valid. */
tm_status tms_contact_solver_create(const tm_mesh *mesh, tm_surface_view surface, const tm_contact_def *contact,
                                    const tm_grasp_def *grasp, int32_t capacity, tms_contact_solver *solver,
                                    tm_error *error);
void tms_contact_solver_destroy(tms_contact_solver *solver);
/* Moves a tool; its previous contact is kept. */
void tms_contact_solver_move(tms_contact_solver *solver, int32_t tool, const tm_tool_pose *pose);
/* Sets a tool's pose; its previous contact is dropped. */
void tms_contact_solver_set_pose(tms_contact_solver *solver, int32_t tool, const tm_tool_pose *at);
bool tms_contact_solver_can_touch(const tms_tool *tool);
/* Recomputes all compliances on next use. */
void tms_contact_solver_forget(tms_contact_solver *solver);
/* Assigns slots to all vertices near the tools; drops forces of vertices that left. Gathers again only after enough
 * tool motion or time, or after _regather. */
void tms_contact_solver_gather(tms_contact_solver *solver);
void tms_contact_solver_regather(tms_contact_solver *solver);
/* Returns whether the tissue may have moved so far that gathering is needed. */
bool tms_contact_solver_has_wandered(const tms_contact_solver *solver);
/* Runs Newton's method from the present forces. Returns the number of steps; sets `converged`. */
int32_t tms_contact_solver_solve(tms_contact_solver *solver);
/* contact_solver.c: fallback after a solve that did not converge, for a system without pins; starts from its initial
 * forces. */
void tms_contact_solver_freeze(tms_contact_solver *solver, const double *f_before);
/* Moves all tools to `pose` in increments, gathering and solving at each. */
int32_t tms_contact_solver_update(tms_contact_solver *solver, const tm_tool_pose *pose);
/* Computes d(force at the tip)/d(tip) of the converged solution, row-major. Does not change the solution. */
void tms_contact_solver_stiffness(tms_contact_solver *solver, int32_t tool, double K[9]);
/* Computes the reaction of the other tools, their grasps and imposed vertices. After _without, _yield gives the forces
 * (by active unknown) for an external displacement (by active unknown). First order, with fixed normals and shares. */
bool tms_contact_solver_without(tms_contact_solver *solver, int32_t tool);
void tms_contact_solver_yield(tms_contact_solver *solver, int32_t tool, const double *u_m, double *df_N);
/* online_grasp.c. Once per update: closes, opens and releases jaws. After each tool motion: moves pins with the
 * jaws. */
void tms_contact_solver_work_jaws(tms_contact_solver *solver);
void tms_contact_solver_follow_jaws(tms_contact_solver *solver);
/* After a solve: where a fading spring is at its limit, its anchor in the jaw slips towards the vertex. The spring
 * therefore never drives tissue that another tool, or its own shape, moves. */
void tms_contact_solver_slip(tms_contact_solver *solver);
bool tms_contact_solver_is_grasping(const tms_contact_solver *solver, int32_t tool);
/* online_friction.c. Returns null if memory is exhausted. */
tms_friction *tms_friction_create(const tm_friction_def *def, const tm_contact_def *contact, int32_t vertex_count);
void tms_friction_destroy(tms_friction *friction); /* null is allowed */
bool tms_contact_solver_has_friction(const tms_contact_solver *solver, int32_t tool);
/* Return whether each slot's position in the previous solve is known, and set that of new slots: their present position
 * under the forces of that solve. */
bool tms_contact_solver_friction_knows(const tms_contact_solver *solver);
void tms_contact_solver_friction_learn(tms_contact_solver *solver);
/* Accepts a solution: slip becomes permanent. */
void tms_contact_solver_friction_settle(tms_contact_solver *solver, double passed_s);
void tms_contact_solver_friction_place(tms_contact_solver *solver, int32_t tool);
/* Returns whether all vertices of a row are in its own tool's jaws; such a row is ignored. */
bool tms_contact_solver_in_jaws(const tms_contact_solver *solver, const tm_contact_row *row);
/* Returns the force on the tool, of rows and jaws. */
void tms_contact_solver_force(const tms_contact_solver *solver, int32_t tool, double force_N[3], double resultant_N[3]);
/* Returns the tm_reaction_flag of the present solution. */
uint32_t tms_contact_solver_flags(const tms_contact_solver *solver, int32_t tool);
tm_tool_reaction tms_contact_solver_reaction(const tms_contact_solver *solver, int32_t tool);

/* Assigns a slot to a vertex, and computes its compliances with all below. */
void tms_contact_solver_fill(tms_contact_solver *solver, int32_t slot, int32_t vertex);
/* contact_solver_snapshot.c: writes the state between solves as a stage's hooks require, for a system without pins.
 * `forgotten`: as after tms_contact_solver_forget. Also gives the maximum size. */
int64_t tms_contact_solver_snapshot(const tms_contact_solver *solver, bool forgotten, void *buffer);
bool tms_contact_solver_restore(tms_contact_solver *solver, const void *buffer, int64_t bytes, bool apply);
int64_t tms_contact_solver_snapshot_max(const tms_contact_solver *solver);

/* newton_matrix.c: LU with partial pivoting, row-major. Written here because it runs inside steps: OpenBLAS's dgetrf
 * and dgetrs take a lock, and Eigen allocates from some size on. It is the fastest up to 45 unknowns
 * (notes/2026-11-24-models.md). */
bool tms_lu(double *a, int32_t *pivot, int32_t n);
void tms_lu_solve(const double *a, const int32_t *pivot, int32_t n, double *x);

/* --- between contact_solver.c, newton_matrix.c and newton.c: each depends on those before it --- */

static inline const tms_pin *tms_pin_of(const tms_contact_solver *l, int32_t slot) { return &l->pin[l->pin_of[slot]]; }

static inline bool tms_is_pinned(const tms_contact_solver *l, int32_t slot, int axis) {
    const int64_t d = 3 * slot + axis;
    return l->pin_of[slot] >= 0 && !l->pin[l->pin_of[slot]].prescribed &&
           l->block[d * 3 * l->capacity + d] > 0; /* a fixed component does not move */
}

/* Returns the change of component `c` of a limited spring's force per motion of the vertex along axis `j`, N/m. Such a
 * force keeps its size and rotates with the spring. */
static inline double tms_pin_rotates(const tms_pin *pin, int c, int j) {
    const double along = pin->max_N > 0 ? pin->force_N[c] * pin->force_N[j] / (pin->max_N * pin->max_N) : 0;
    return pin->prescribed ? -pin->rotation_N_m * ((c == j) - along) : 0;
}

/* out [3*high] := displacements by forces on `slot`, given by slot or in the list's order. */
void tms_contact_solver_response(const tms_contact_solver *solver, const int32_t *slot, int32_t count, const double *f,
                                 bool by_slot, double *out);
/* Computes u at the slots from base and forces. */
void tms_contact_solver_shape(tms_contact_solver *solver);
/* out += f times the displacements of all slots below `high` by a unit force on a component of one. */
void tms_contact_solver_spread(const tms_contact_solver *solver, int32_t component, double f, double *restrict out);
/* Evaluates the shape in u_m: its rows within `margin` radii, their forces on the slots and on the tools. */
void tms_contact_solver_evaluate_shape(tms_contact_solver *solver, tms_contact_eval *look, double margin);
/* Recomputes those forces from the present rows. */
void tms_contact_solver_sum(const tms_contact_solver *solver, tms_contact_eval *look);
/* Does both, and computes the residual r. Returns the sum of squares of the displacements that r would cause; sets
 * `converged`. */
double tms_contact_solver_evaluate(tms_contact_solver *solver);
/* Factorises the known part of the matrix at the present rows, over the active unknowns; `without`: omitted tool, -1:
 * none. Returns false if it is singular. */
bool tms_contact_solver_factor(tms_contact_solver *solver, int32_t without);
/* Returns the displacement per unit of the j-th unknown's residual: the norm in which residuals are compared. */
double tms_contact_solver_scale(const tms_contact_solver *solver, int32_t j);
/* online_friction.c: adds friction to an evaluation; to the matrix of the present one. */
void tms_contact_solver_friction(const tms_contact_solver *solver, tms_contact_eval *look);
void tms_contact_solver_add_friction_matrix(tms_contact_solver *solver, const tms_friction_station *station, int32_t m);

#endif
