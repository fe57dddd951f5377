/* State and step. A world is a tissue's state and a list of stages: what was asked for, in order, and nothing else. */
#ifndef TENSORMASS_WORLD_H
#define TENSORMASS_WORLD_H

#include "tissue.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Mutable state. Displacements u = P - rest. All arrays [3*vertex_count]. */
typedef struct tm_state {
    int64_t step;     /* substeps done */
    double time_s;    /* simulated */
    double dt_s;      /* of the substep under way */
    double *u_m;      /* at time_s */
    double *u_prev_m; /* one step before */
    double *u_next_m; /* written by the integrator, corrected by constraints, rotated in at the end of the step */
    double *force_N;  /* internal + external force at time_s */
} tm_state;

/* Order of stages within one step; inside a phase, order of addition, unless a stage says before which it comes. */
typedef enum tm_phase {
    TM_PHASE_BEGIN = 0,     /* tool paths, moving supports, topology changes */
    TM_PHASE_FORCE = 1,     /* internal force: writes force_N */
    TM_PHASE_LOAD = 2,      /* gravity, vertex forces: add to force_N */
    TM_PHASE_INTEGRATE = 3, /* writes u_next_m */
    TM_PHASE_CONSTRAIN = 4, /* supports, contact: correct u_next_m */
    TM_PHASE_END = 5,       /* measurements */
    TM_PHASE_ON_DEMAND = 6  /* not in the step: a stage without `run` that works when the application calls it */
} tm_phase;

typedef struct tm_world tm_world;

#define TM_MAX_NEEDS 4

/* Vertices [begin, end) of a part of the tissue: whose parts run at once, each in its own thread. */
typedef struct tm_range {
    int32_t partition, begin, end;
} tm_range;
/* What a stage does to a range. One that is `divided` writes force_N and u_next_m of these vertices alone, and what is
 * its own of them; it reads u_m and u_prev_m of any. */
typedef void tm_stage_range(void *self, tm_world *world, const tm_range *range);

/* Work of a stage that needs what a substep begins with, and not the new force: several threads may do it while they
 * compute that. */
typedef struct tm_overlap {
    /* By the caller's thread, before the force is computed. Returns whether to overlap in this substep. */
    bool (*begin)(void *self, tm_world *world);
    /* For each part of the step, by the part's thread. The stage's `run` comes later, and finds it done. */
    void (*work)(void *self, tm_world *world, int32_t part);
} tm_overlap;

/* One effect. `self` is its own state, taken when the stage was built. `run` allocates nothing and cannot fail; it is
 * null in TM_PHASE_ON_DEMAND and where there is a `range`. New fields come at the end: what a caller's struct does not
 * have is null.
 */
typedef struct tm_stage {
    uint32_t size;    /* sizeof(tm_stage) */
    const char *name; /* static string: "force", "gravity", "contact" ... */
    tm_phase phase;
    void (*run)(void *self, tm_world *world);
    void (*destroy)(void *self);
    /* dt changed or tissue was cut: refresh what was derived from them; may be null. The integrator is told first, so
     * that tm_world_mobility_s2_kg is new already, then all others in the order they run. */
    void (*step_changed)(void *self, tm_world *world);
    void *self;
    /* Snapshots; both null: the stage keeps nothing between steps that the scene does not set. `snapshot` returns how
     * many bytes it keeps and writes them to `buffer` unless that is null. `restore` says whether `buffer` fits this
     * stage and, if `apply`, takes it. */
    int64_t (*snapshot)(void *self, void *buffer);
    bool (*restore)(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
    /* A step is all or nothing. `checkpoint` is called when tm_world_step begins and puts aside, in memory of the
     * stage's own, what `run` may change; `rollback` is called when the step failed: it puts that back, to the last
     * bit. Both null: `run` changes nothing that lasts. No allocation. When rollback is called, u, tissue and masses
     * are as before, step_changed was called if anything had been cut, and the stages that run before this one have
     * given back. */
    void (*checkpoint)(void *self);
    void (*rollback)(void *self, tm_world *world);
    const char
        *needs[TM_MAX_NEEDS]; /* names of the stages it depends on: they cannot be removed under it; null: none */
    /* The world's step must not exceed it while the stage is there; 0: no limit. A stage that adds a force which grows
     * with displacement makes tissue stiffer, and must give one. With g the tissue's guaranteed step, m a vertex's mass
     * and k the stage's stiffness there (a spring's constant; of several, or between vertices, the sum of absolute
     * entries of the vertex' row): the least over vertices of 1 / sqrt(1/g^2 + k/(4 m)). */
    double step_limit_s;
    const char *settle_refusal; /* why tm_world_settle cannot find the rest of a world with this stage; null: it can */
    const char
        *substage_of; /* name of the stage whose further part it is: goes with it, owns nothing; null: it is whole */
    const char *runs_before; /* name of a stage of the same phase that it runs before; null: in order of addition */
    bool skip_in_settle;     /* tm_world_settle does not run it: it changes what is there, not where that rests */
    /* Instead of `run`, where every vertex is computed by itself. */
    tm_stage_range *range;
    int64_t snapshot_max; /* upper bound of what `snapshot` returns; 0: it returns the same number at all times */
    /* `range` may be divided among threads: divided stages that follow each other run together, some hundred vertices
     * at a time, on all threads of the world, and beside work that overlaps. Else the caller's thread does it alone. */
    bool divided;
    const tm_overlap *overlap; /* null: nothing overlaps the force pass */
} tm_stage;

#define TM_MAX_STAGES 32

typedef struct tm_stage_report {
    const char *name;
    tm_phase phase;
    int64_t bytes;  /* held by the stage */
    int64_t runs;   /* steps done while it was there */
    double seconds; /* of its own work, wherever that is called from; measured when timing is on, else 0. With threads
                       the caller's time: its own part, and its share of the wait for the others */
    bool divided, overlaps; /* as tm_stage has them */
    const char *provider;   /* of the stage "force": the stage whose law it computes; null: the tensors' own */
} tm_stage_report;

/* An application with threads of its own: calls work(context, part) once for each part from 0 to parts-1, at once or
 * one after another, in any order and on any threads, and returns when all have returned. */
typedef void tm_parallel_for(void *user, void (*work)(void *context, int32_t part), void *context, int32_t parts);

enum { TM_MAX_THREADS = 64 };

typedef struct tm_world_def {
    uint32_t cookie, size;
    tm_tissue *tissue; /* must outlive the world */
    double dt_s; /* 0: the guaranteed critical step times `step_fraction`; above the guaranteed step: TM_ERR_STEP */
    double step_fraction; /* 0.9 */
    bool damped; /* true; false: the undamped integrator (fewer instructions); materials' damping must then be 0 */
    /* 1; a step is divided among so many threads, the caller's with them, and fewer where tissue is too small for them.
     * The same bits for any number. Those that the library starts sleep but for calls of tm_world_step of four substeps
     * and more, in which they wait awake: ask for no more than there are cores. Up to TM_MAX_THREADS. */
    int32_t threads;
    tm_parallel_for *parallel_for; /* null: the library starts threads of its own */
    void *parallel_for_user;
} tm_world_def;

TM_API tm_world_def tm_world_def_default(void);
/* A world with the stages every scene has: force and integrate. */
TM_API tm_status tm_world_create(const tm_world_def *def, tm_world **world, tm_error *error);
TM_API void tm_world_destroy(tm_world *world); /* destroys its stages too, not the tissue */

/* The world takes the stage over: its struct is copied, and `destroy` will be called. On failure neither. */
TM_API tm_status tm_world_add_stage(tm_world *world, const tm_stage *stage, int64_t bytes, tm_error *error);
/* Refused while another stage needs it: remove that one first. */
TM_API tm_status tm_world_remove_stage(tm_world *world, const char *name, tm_error *error);
TM_API int32_t tm_world_stages(const tm_world *world, tm_stage_report report[TM_MAX_STAGES]);
TM_API void tm_world_set_timing(tm_world *world, bool on);
/* Outside the step, when timing is on: time from here on is booked on the stage with this `self`, until the next call;
 * null: on none. For what a stage does when the application calls it. */
TM_API void tm_world_profile_stage(tm_world *world, const void *self);

TM_API tm_state *tm_world_state(tm_world *world);
TM_API tm_tissue *tm_world_tissue(tm_world *world);
TM_API double tm_world_step_s(const tm_world *world);
/* [vertex_count] displacement within one step per newton, 1/(m/dt2 + gamma/2dt); 0 without mass. Constraints weigh by
 * it. Prescribed components are marked by tm_support_mask, not here. While settling it holds the relaxation's
 * fictitious masses: read it each step. */
TM_API const double *tm_world_mobility_s2_kg(const tm_world *world);
/* u_prev becomes u - new (v + (old - new)/2 a), v = (u - u_prev)/old, a the acceleration now: rescaling alone (without
 * a) lets changes of the step feed energy in (apps/studies/stability, "step-changes"). Not for the inside of a step: it
 * evaluates the force. */
TM_API tm_status tm_world_set_step(tm_world *world, double dt_s, tm_error *error);

/* In how many parts a step is computed, each by a thread: as many as tm_world_def.threads, but no more than one for
 * each 2,000 tetrahedra that were alive when the world was made. So below 4,000 it is 1. */
TM_API int32_t tm_world_partitions(const tm_world *world);
/* A step fails when a displacement passes this many times the diagonal of the mesh's bounds. */
#define TM_DISPLACEMENT_MAX 1000.0
/* That in m. */
TM_API double tm_world_largest_displacement_m(const tm_world *world);
/* `count` substeps, all or none. No allocation, no lock, no log; with threads, it waits for them. When a displacement
 * stops being finite or exceeds tm_world_largest_displacement_m (looked at after every substep, over all vertices), or
 * a contact force is not finite, it stops at once and returns TM_ERR_UNSTABLE, and everything is as it was before the
 * call, to the last bit: u, u_prev, force, time, what was cut, and what stages keep (tm_stage.checkpoint). That state
 * is bounded, but may itself be of a blow-up that earlier calls began: to go back farther, restore a snapshot. */
TM_API tm_status tm_world_step(tm_world *world, int32_t count);

/* --- stages of the library; each file stage_*.c of src/ is one --- */

TM_API tm_status tm_stage_gravity(tm_world *world, const double g_m_s2[3], tm_error *error);

/* Constant forces on vertices: vertex forces and tractions already lumped. [3*vertex_count] N, copied. */
TM_API tm_status tm_stage_load(tm_world *world, const double *force_N, tm_error *error);
/* Adds a traction (Pa, over rest area) on surface triangles to force_N; the caller's buffer, no world needed. */
TM_API void tm_load_add_traction(const tm_mesh *mesh, const int32_t *triangle, int32_t triangle_count,
                                 const double traction_Pa[3], double *force_N);

/* Prescribed displacement: component i of the list holds u[dof[i]] = value[i]. dof = 3*vertex + axis. Copied. */
typedef struct tm_support_def {
    uint32_t cookie, size;
    int32_t count;
    const int32_t *dof;
    const double *value_m;
} tm_support_def;
TM_API tm_support_def tm_support_def_default(void);
TM_API tm_status tm_stage_support(tm_world *world, const tm_support_def *def, tm_error *error);
/* Reaction of the support on the tissue at the last step, [3*vertex_count] N added into `reaction_N` (zero elsewhere).
 * At rest it is -(internal + external force) of those components. */
TM_API void tm_support_reaction(const tm_world *world, double *reaction_N);
/* Moves component `component` of the definition's list to `value_m` (a moving support, called by a stage of
 * TM_PHASE_BEGIN). */
TM_API void tm_support_move(tm_world *world, int32_t component, double value_m);
/* Marks [3*vertex_count] with 1 where a component is prescribed. */
TM_API void tm_support_mask(const tm_world *world, uint8_t *mask);
/* TM_ERR_SUPPORT, naming a vertex, if the supports leave a piece of the tissue free to move or turn as a whole. Such a
 * piece has no rest, and in TM_SINGLE it is driven by rounding (see there). Contact and grasps are not counted. */
/* Tetrahedra that the last force found beyond a limit of their nonlinear law, where it goes on linearly
 * (tm_material_set_law). */
TM_API int32_t tm_world_limited_tets(const tm_world *world);
TM_API tm_status tm_world_check_constrained(const tm_world *world, tm_error *error);

/* --- rest --- */

typedef struct tm_settle_def {
    uint32_t cookie, size;
    /* On max |residual force| over free components, relative to the largest external or internal force, or to the
     * tissue's stiffness times 1e-4 of the largest displacement where that is more (a body that was turned as a whole
     * bears none); 1e-10. */
    double tolerance;
    int64_t max_steps;                                           /* 2e6 */
    bool (*progress)(void *user, int64_t step, double residual); /* may be null; false stops (TM_ERR_CONVERGENCE) */
    void *user;
} tm_settle_def;
typedef struct tm_settle_result {
    int64_t steps;
    double residual;
    double energy_J;
    int32_t load_steps;         /* in which supports and loads came on ("rotation" alone); else 0 */
    tm_deformation deformation; /* at rest. `inverted` above 0: a rest not to be believed */
} tm_settle_result;
TM_API tm_settle_def tm_settle_def_default(void);
/* Dynamic relaxation (adaptive damping, fictitious masses allowed): solves K u = f_ext with the world's supports and
 * loads. Leaves u = u_prev = the solution. Contact stages stay active. Allocates its own work space. */
TM_API tm_status tm_world_settle(tm_world *world, const tm_settle_def *def, tm_settle_result *result, tm_error *error);

/* --- snapshots --- */

/* Snapshot of everything a world needs to go on with the same bits (state, living tetrahedra, contact, grasps), for the
 * same build of the library on the same kind of machine, and a world set up from the same scene. Bytes are checksummed;
 * a foreign, damaged or truncated snapshot is refused (TM_ERR_FILE) and the world left as it was; one of another mesh
 * or other stages too (TM_ERR_ARGUMENT). `buffer` is aligned to 8 bytes.
 *
 * The size changes with contact, grasps and cuts: ask tm_snapshot_bytes before each save, or allocate
 * tm_snapshot_bytes_max once, after the last stage was added: no later snapshot of these stages is larger. A snapshot
 * is restored with its own size, that of the save, whatever the world's size is by then. */
TM_API int64_t tm_snapshot_bytes(const tm_world *world);
TM_API int64_t tm_snapshot_bytes_max(const tm_world *world);
TM_API tm_status tm_snapshot_save(const tm_world *world, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_snapshot_restore(tm_world *world, const void *buffer, int64_t bytes, tm_error *error);

/* Hash of u and u_prev (bits). */
TM_API uint64_t tm_world_hash(const tm_world *world);

#ifdef __cplusplus
}
#endif
#endif
