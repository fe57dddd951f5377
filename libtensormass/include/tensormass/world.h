/* State and step. A world is the state of a tissue and an ordered list of the stages that were added. */
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
    double dt_s;      /* of the current substep */
    double *u_m;      /* at time_s */
    double *u_prev_m; /* one step before */
    double *u_next_m; /* written by the integrator, corrected by constraints; becomes u_m at the end of the step */
    double *force_N;  /* internal + external force at time_s */
} tm_state;

/* Phases of a step, in order. Within a phase, stages run in order of addition unless `runs_before` is set. */
typedef enum tm_phase {
    TM_PHASE_BEGIN = 0,     /* tool paths, moving supports, topology changes */
    TM_PHASE_FORCE = 1,     /* internal force: writes force_N */
    TM_PHASE_LOAD = 2,      /* gravity, vertex forces: add to force_N */
    TM_PHASE_INTEGRATE = 3, /* writes u_next_m */
    TM_PHASE_CONSTRAIN = 4, /* supports, contact: correct u_next_m */
    TM_PHASE_END = 5,       /* measurements */
    TM_PHASE_ON_DEMAND = 6  /* outside the step: a stage without `run` that works when the application calls it */
} tm_phase;

typedef struct tm_world tm_world;

#define TM_MAX_NEEDS 4

/* Vertices [begin, end) of a partition of the tissue. Partitions run concurrently, one per thread. */
typedef struct tm_range {
    int32_t partition, begin, end;
} tm_range;
/* Computes a stage on a range. If the stage is `divided`, it writes force_N, u_next_m and its own data of these
 * vertices only; it reads u_m and u_prev_m of any. */
typedef void tm_stage_range(void *self, tm_world *world, const tm_range *range);

/* Work of a stage that depends on the start of a substep, not on the new force: threads may do it during the force
 * pass. */
typedef struct tm_overlap {
    /* Called by the caller's thread before the force pass. Returns whether to overlap in this substep. */
    bool (*begin)(void *self, tm_world *world);
    /* Called for each partition by its thread. The stage's `run` follows later and uses the result. */
    void (*work)(void *self, tm_world *world, int32_t part);
} tm_overlap;

/* One effect. `self` is its own state, allocated when the stage is created. `run` never allocates and cannot fail. It
 * is null in TM_PHASE_ON_DEMAND and for a stage with a `range`. New fields are added at the end: fields that a caller's
 * struct lacks are null. */
typedef struct tm_stage {
    uint32_t size;    /* sizeof(tm_stage) */
    const char *name; /* static string: "force", "gravity", "contact" ... */
    tm_phase phase;
    void (*run)(void *self, tm_world *world);
    void (*destroy)(void *self);
    /* Updates what was derived from dt or the tissue, after dt changed or tissue was cut; may be null. The integrator
     * is called first, so that tm_world_mobility_s2_kg is already updated, then all others in the order in which they
     * run. */
    void (*step_changed)(void *self, tm_world *world);
    void *self;
    /* Snapshots; both null: the stage has no state between steps except what the scene sets. `snapshot` returns the
     * number of bytes, and writes them unless `buffer` is null. `restore` returns whether `buffer` fits this stage and,
     * if `apply`, restores it. */
    int64_t (*snapshot)(void *self, void *buffer);
    bool (*restore)(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply);
    /* A step succeeds completely or is rolled back. tm_world_step first calls `checkpoint`, which saves what `run` may
     * change in memory of the stage. If the step failed it calls `rollback`, which restores that to the last bit. Both
     * null: `run` changes nothing lasting. No allocation. Before a stage's rollback, u, tissue and masses are restored,
     * and the stages that run before it are rolled back. If anything had been cut, step_changed was called. */
    void (*checkpoint)(void *self);
    void (*rollback)(void *self, tm_world *world);
    /* Names of the stages it depends on: they cannot be removed before it; null: none. */
    const char *needs[TM_MAX_NEEDS];
    /* Upper limit of the world's step while the stage exists; 0: none. A stage whose force grows with displacement
     * stiffens the tissue and must set one:
     *     the minimum over vertices of 1 / sqrt(1/g^2 + k/(4 m)),
     * g the tissue's guaranteed step, m the mass of a vertex, k the stage's stiffness there. k is a spring's constant;
     * with several springs, or springs between vertices, it is the sum of absolute entries in the vertex' row. With
     * several such stages the k add. */
    double step_limit_s;
    const char *settle_refusal; /* why tm_world_settle cannot settle a world with this stage; null: it can */
    /* Name of the stage that it is a further part of: removed with it, owns nothing; null: an independent stage. */
    const char *substage_of;
    const char *runs_before; /* name of a stage of the same phase that it runs before; null: order of addition */
    bool skip_in_settle;     /* tm_world_settle skips it: it changes the tissue, not its equilibrium */
    /* Replaces `run` if every vertex is computed independently. */
    tm_stage_range *range;
    int64_t snapshot_max; /* upper bound of the result of `snapshot`; 0: it is constant */
    /* `range` may be divided among threads. Consecutive divided stages then run together, some hundred vertices at a
     * time, on all threads of the world, concurrently with overlapped work. false: the caller's thread does it
     * alone. */
    bool divided;
    const tm_overlap *overlap; /* null: no overlapped work */
} tm_stage;

#define TM_MAX_STAGES 32

typedef struct tm_stage_report {
    const char *name;
    tm_phase phase;
    int64_t bytes; /* allocated by the stage */
    int64_t runs;  /* steps since it was added */
    /* Time of its own work, wherever it is called from; 0 unless timing is on. With threads: time of the caller's
     * thread, which is its own partition and its share of waiting for the others. */
    double seconds;
    bool divided, overlaps; /* as in tm_stage; divided also: `run` divides its work itself */
    const char *provider;   /* of the stage "force": name of the stage whose law it computes; null: its own tensors */
} tm_stage_report;

/* Parallel for of an application with its own threads. Calls work(context, part) once for each part from 0 to parts-1,
 * concurrently or not, in any order and on any threads. Returns when all calls have returned. */
typedef void tm_parallel_for(void *user, void (*work)(void *context, int32_t part), void *context, int32_t parts);

enum { TM_MAX_THREADS = 64 };

typedef struct tm_world_def {
    uint32_t cookie, size;
    tm_tissue *tissue; /* must outlive the world */
    double dt_s; /* 0: the guaranteed critical step times `step_fraction`; above the guaranteed step: TM_ERR_STEP */
    double step_fraction; /* 0.9 */
    /* true; false: the undamped integrator (fewer instructions), which requires materials without damping. */
    bool damped;
    /* Threads of a step, including the caller's, up to TM_MAX_THREADS; 1. Small tissue uses fewer. Results are
     * bit-identical for any number. The library's threads sleep, except during calls of tm_world_step of four or more
     * substeps: there they wait actively, so set no more threads than cores. */
    int32_t threads;
    tm_parallel_for *parallel_for; /* null: the library starts threads of its own */
    void *parallel_for_user;
} tm_world_def;

TM_API tm_world_def tm_world_def_default(void);
/* Creates a world with the stages of every scene: force and integrate. */
TM_API tm_status tm_world_create(const tm_world_def *def, tm_world **world, tm_error *error);
TM_API void tm_world_destroy(tm_world *world); /* also destroys its stages, not the tissue */

/* Adds a stage: copies the struct and calls its `destroy` later. On failure it does neither. */
TM_API tm_status tm_world_add_stage(tm_world *world, const tm_stage *stage, int64_t bytes, tm_error *error);
/* Removes a stage. Refused while another stage depends on it: remove that one first. */
TM_API tm_status tm_world_remove_stage(tm_world *world, const char *name, tm_error *error);
TM_API int32_t tm_world_stages(const tm_world *world, tm_stage_report report[TM_MAX_STAGES]);
TM_API void tm_world_set_timing(tm_world *world, bool on);
/* Records the time from now on for the stage with this `self`, until the next call; null: for none. For calls of a
 * stage by the application, outside the step, with timing on. */
TM_API void tm_world_profile_stage(tm_world *world, const void *self);

TM_API tm_state *tm_world_state(tm_world *world);
TM_API tm_tissue *tm_world_tissue(tm_world *world);
TM_API double tm_world_step_s(const tm_world *world);
/* Returns [vertex_count] displacement within one step per newton, 1/(m/dt2 + gamma/2dt); 0 without mass. Constraints
 * use it as weight. Prescribed components are marked by tm_support_mask only. During settling it has the relaxation's
 * fictitious masses: read it in each step. */
TM_API const double *tm_world_mobility_s2_kg(const tm_world *world);
/* Changes the step. With v = (u - u_prev)/old and a the present acceleration:
 *     u_prev = u - new (v + (old - new)/2 a).
 * Without the term in a, step changes would add energy (apps/studies/stability, "step-changes"). Not within a step: it
 * evaluates the force. */
TM_API tm_status tm_world_set_step(tm_world *world, double dt_s, tm_error *error);

/* Returns the number of partitions of a step, one per thread: at most tm_world_def.threads, and one per 2,000
 * tetrahedra active when the world was created. Below 4,000 it is 1. */
TM_API int32_t tm_world_partitions(const tm_world *world);
/* Maximum displacement in a step, relative to the diagonal of the mesh's bounding box; beyond it the step fails. */
#define TM_DISPLACEMENT_MAX 1000.0
/* Returns this maximum, m. */
TM_API double tm_world_largest_displacement_m(const tm_world *world);
/* Advances by `count` substeps, or by none if one fails. No allocation, no lock, no log; with threads, it waits for
 * them. TM_ERR_UNSTABLE: a displacement is not finite or exceeds tm_world_largest_displacement_m (all vertices are
 * checked after every substep), or a contact force is not finite. Then everything is as before the call, to the last
 * bit: u, u_prev, force, time, cuts, and the state of stages (tm_stage.checkpoint). That state is bounded, but earlier
 * calls may have begun the instability: to go back farther, restore a snapshot. */
TM_API tm_status tm_world_step(tm_world *world, int32_t count);

/* --- stages of the library; each file stage_*.c of src/ is one --- */

TM_API tm_status tm_stage_gravity(tm_world *world, const double g_m_s2[3], tm_error *error);

/* Adds constant forces on vertices, including lumped tractions. [3*vertex_count] N, copied. */
TM_API tm_status tm_stage_load(tm_world *world, const double *force_N, tm_error *error);
/* Adds the stage "pressure": pressure_Pa [surface_count] on the triangles of the mesh's surface, along the inward
 * normals of the deformed surface, over its deformed area. Its stiffness, of the size of pressure times
 * edge, bounds the step (step_limit_s), for edges stretched by up to the law's limit, 1.6 of linear tissue; a longer
 * step: TM_ERR_STEP. On a surface with a free border a pressure is not conservative. Copied. */
TM_API tm_status tm_stage_pressure(tm_world *world, const double *pressure_Pa, tm_error *error);
/* Adds a traction (Pa, over the undeformed area) on surface triangles to force_N, the caller's array. Needs no
 * world. */
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
/* Adds the force of the support on the tissue in the last step to `reaction_N`, [3*vertex_count] N (free components
 * unchanged). In equilibrium it is -(internal + external force) of those components; instruments, bodies in contact and
 * ties belong to the external force. */
TM_API void tm_support_reaction(const tm_world *world, double *reaction_N);
/* Moves component `component` of the definition's list to `value_m`. For moving supports: call it from a stage of
 * TM_PHASE_BEGIN. */
TM_API void tm_support_move(tm_world *world, int32_t component, double value_m);
/* Marks [3*vertex_count] with 1 where a component is prescribed. */
TM_API void tm_support_mask(const tm_world *world, uint8_t *mask);
/* Returns the number of tetrahedra that the last force pass found beyond a limit of their nonlinear law, where it
 * continues linearly (tm_material_set_law). */
TM_API int32_t tm_world_limited_tets(const tm_world *world);
/* Returns the share of the rest volume in which the nonlinear law has lost its ellipticity at the present
 * displacements, so that its solution depends on the mesh. Some 10 us a tetrahedron. */
TM_API double tm_world_unstable_share(const tm_world *world);
/* Adaptive step of a tissue with nonlinear laws. A step of tm_world_step is step_s long, and is divided into 2^level
 * equal substeps as the tetrahedron that is strained most demands: level 0 up to strain[0], the norm of Green's strain,
 * level k up to strain[k]; at the last level, the step that the world had at the call, everything is allowed. The level
 * rises at once, by the state one step ahead, and sinks after eight steps that need less. It depends on nothing but the
 * state: results are bit-identical for any number of threads, and snapshots keep it. */
enum { TM_ADAPTIVE_LEVELS = 9 };
typedef struct tm_adaptive_step {
    double step_s;
    int32_t levels, level; /* 1 to TM_ADAPTIVE_LEVELS; the present one, 0 .. levels-1 */
    double strain[TM_ADAPTIVE_LEVELS];
    int64_t steps[TM_ADAPTIVE_LEVELS]; /* so far, at each level */
} tm_adaptive_step;
/* Makes the step adaptive, once, before other stages are added. TM_ERR_STEP: step_s is not guaranteed for strains up to
 * 0.1. TM_ERR_EXCLUDED: the tissue has no nonlinear law. */
TM_API tm_status tm_world_adapt(tm_world *world, double step_s, tm_error *error);
/* Returns whether the step is adaptive; *adaptive: its state. */
TM_API bool tm_world_adaptive(const tm_world *world, tm_adaptive_step *adaptive);
/* Checks that the supports leave no connected component of the tissue with rigid-body modes. TM_ERR_SUPPORT, with a
 * vertex, if they do: it has no equilibrium, and in TM_SINGLE rounding drives it (see there). Contact and grasps do not
 * count as supports. */
TM_API tm_status tm_world_check_constrained(const tm_world *world, tm_error *error);

/* --- static equilibrium --- */

typedef struct tm_settle_def {
    uint32_t cookie, size;
    /* Maximum residual force over free components, relative to the largest external or internal force; 1e-10. If more,
     * the scale is the tissue's stiffness times 1e-4 of the largest displacement: a body that only rotated has no
     * forces. */
    double tolerance;
    int64_t max_steps; /* 2e6 */
    bool (*progress)(void *user, int64_t step,
                     double residual); /* may be null; return false to stop (TM_ERR_CONVERGENCE) */
    void *user;
} tm_settle_def;
typedef struct tm_settle_result {
    int64_t steps;
    double residual;
    double energy_J;
    int32_t load_steps;         /* in which supports and loads were applied (with "rotation"); else 0 */
    tm_deformation deformation; /* in equilibrium. `inverted` above 0: the result is not valid */
    /* Above 0: bodies rest only with this friction between their surfaces, which have less; they slide on without. */
    double held_friction;
} tm_settle_result;
TM_API tm_settle_def tm_settle_def_default(void);
/* Solves K u = f_ext with the world's supports and loads, by dynamic relaxation (adaptive damping, fictitious masses
 * allowed). Leaves u = u_prev = the solution. Contact stages stay active. Allocates its own work space. */
TM_API tm_status tm_world_settle(tm_world *world, const tm_settle_def *def, tm_settle_result *result, tm_error *error);

/* Derivatives of an equilibrium with respect to constants. Both refuse (TM_ERR_EXCLUDED) worlds with contact, whose
 * forces are not smooth, and pressures that follow the surface. Both allocate their own work space and leave the state
 * alone.
 *
 * Computes force_N [3*vertex_count]: what tissue and loads exert on each component at u_m [3*vertex_count], by the
 * long-term law that settling uses. It vanishes on the free components of an equilibrium; on the prescribed ones it is
 * minus the support's force on the tissue. */
TM_API tm_status tm_world_static_force(tm_world *world, const double *u_m, double *force_N, tm_error *error);
/* Solves (K x)_i = b_i for the free components i of x_m [3*vertex_count], whose prescribed components are given; K is
 * the symmetric tangent of that force at the present displacement, so that this is the adjoint problem too. b_N
 * [3*vertex_count] may be null (zeros). Conjugate gradients, until the residual is below `tolerance` of the first one.
 * TM_ERR_CONVERGENCE: K is not positive there, or rounding stops it. */
TM_API tm_status tm_world_static_response(tm_world *world, const double *b_N, double tolerance, double *x_m,
                                          tm_error *error);

/* --- snapshots --- */

/* Snapshot: all data with which a world continues bit-identically (state, active tetrahedra, contact, grasps). Valid
 * for the same build of the library, the same kind of machine, and a world of the same scene. It is checksummed: a
 * foreign, damaged or truncated snapshot is refused (TM_ERR_FILE) and changes nothing. So is one of another mesh or
 * other stages (TM_ERR_ARGUMENT). `buffer` is aligned to 8 bytes.
 *
 * The size changes with contact, grasps and cuts. Call tm_snapshot_bytes before each save, or allocate
 * tm_snapshot_bytes_max once after the last stage was added: no later snapshot of these stages is larger. Restore a
 * snapshot with its own size, that of the save, not with the world's present size. */
TM_API int64_t tm_snapshot_bytes(const tm_world *world);
TM_API int64_t tm_snapshot_bytes_max(const tm_world *world);
TM_API tm_status tm_snapshot_save(const tm_world *world, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_snapshot_restore(tm_world *world, const void *buffer, int64_t bytes, tm_error *error);

/* Returns a hash of the bits of u and u_prev. */
TM_API uint64_t tm_world_hash(const tm_world *world);

#ifdef __cplusplus
}
#endif
#endif
