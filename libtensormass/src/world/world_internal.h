/* Internals of a world: its state, its list of stages, and the stages that every world may have. */
#ifndef TM_WORLD_INTERNAL_H
#define TM_WORLD_INTERNAL_H

#include "base/thread_pool.h"
#include "material/effect_range.h"
#include "tensormass/rotation.h"
#include "tensormass/world.h"
#include "tissue/tissue_internal.h"

enum { TM_COOKIE_WORLD = 0x776f726c, TM_COOKIE_SUPPORT = 0x73757070, TM_COOKIE_SETTLE = 0x73657474 };

/* Data of one thread in a step. */
typedef struct tm_partition {
    tm_force_partition force;  /* its vertices */
    tm_force_partition piece;  /* those in one or between two ranges of the provider (stage_force.c) */
    bool unstable;             /* one of them is unbounded, since the substep's last check */
    int32_t *halo;             /* [vertex_count] capacity of force.halo; null: the first */
    double usual_s;            /* mean time of its thread per force job, before those of sum_s */
    _Alignas(64) double sum_s; /* time of the force jobs since the last rebalancing; written by its thread, on a cache
                                  line of its own */
    double max_increment_m;    /* largest travel of a component of its vertices in the previous substep */
} tm_partition;

/* The law that the stage "force" computes. */
typedef struct tm_force_provider {
    const char *stage; /* that provides it; null: the tissue's tensors */
    void *self;
    tm_stage_range *range; /* null: `stage` computes the complete force, and "force" leaves 0 */
    /* Vertices of the bodies that it concerns; the others follow the tensors. Null: all. */
    const tm_ranges *where;
    const double *u_m; /* with `where`: displacement by which the tensors give its force; null: "force" leaves 0 */
} tm_force_provider;

/* A nonlinear law: what it adds to the tissue's tensors. Settling, energy accounting and compliance columns call this
 * interface, so that they depend on no particular law. */
struct tm_tangent;
typedef struct tm_nonlinear {
    void *self;             /* its stage's, or data that lead there */
    const tm_ranges *where; /* its vertices: `force`, `added_N` and `scratch_N` concern no other; null: all */
    double (*energy)(const void *self, const double *u_m);
    void (*force)(const void *self, const double *u_m, double *force_N); /* force_N := */
    /* [3*vertex_count] added in the last step by no law (conserve.h); null, or returns null: nothing. */
    const double *(*added_N)(const void *self);
    bool (*take_tangent)(const void *self, struct tm_tangent *tangent, tm_pool *pool); /* false: no memory */
    /* Adds the tangents of the tetrahedra [begin, end) to the tensors (tm_tangent_begin). */
    void (*add_tangent)(const void *self, const double *u_m, int32_t begin, int32_t end, struct tm_tangent *tangent);
    double *scratch_N;                      /* [3*vertex_count] */
    const struct tm_relaxing_law *relaxing; /* its viscosity (viscosity.h) */
} tm_nonlinear;

/* Receives a force on a vertex. */
typedef void tm_add_force(void *to, int32_t vertex, const double force_N[3]);
/* Of a stage after the new displacements that changes few of them, or none. */
typedef struct tm_few {
    bool (*applies)(const void *self); /* in this substep; null: always */
    bool (*is_bounded)(const void *self,
                       const tm_world *world); /* of the vertices that it changed; null: it changes none */
    /* Calls `add` with each of its forces in the last substep; null: it has none. */
    void (*forces)(const void *self, void *to, tm_add_force *add);
} tm_few;

struct tm_world {
    tm_pool pool;
    tm_state state;
    tm_tissue *tissue;
    bool damped, timing;
    bool wide;                /* stages may use AVX2 where its bits equal those of the plain loop */
    int32_t revision;         /* of the tissue's surface for which masses and stages are current */
    double long_step_s;       /* of an adaptive step */
    double guaranteed_step_s; /* of the tissue at creation: cutting never lowers it */
    int32_t guaranteed_tet;
    struct tm_adaptive *adaptive; /* null: all steps have one length */
    int32_t part, parts;          /* substep of an adaptive step, and their number; else 0 and 1 */
    double largest_m;             /* displacement beyond which a step has failed */
    double
        *mobility_s2_kg;   /* [vertex_count] 1/(m/dt2 + gamma/2dt), 0 without mass: displacement per newton in a step */
    double *inertia;       /* damped: [vertex_count] (m/dt2 - gamma/2dt) * mobility; else null */
    int64_t inertia_bytes; /* its size, attributed to the stage that reads it */
    uint8_t *fixed_scratch; /* [3*vertex_count] of tm_world_set_step */
    double *internal_N;     /* [3*vertex_count] tissue force, where the stage "energy" needs it; else null */
    const struct tm_energy_part *energy_part; /* tissue whose energy is accounted separately; null: none */
    /* as they were when tm_world_step was called */
    double *saved_u_m, *saved_u_prev_m, *saved_force_N;
    int64_t saved_step;
    double saved_time_s;
    bool settling;        /* passes over the stages are no steps: no motion, no change of history */
    bool evaluating;      /* forces are evaluated outside a step: no change of history */
    bool check_removed;   /* in this substep: check removed vertices for unbounded displacements */
    bool unstable;        /* a stage met a number that is not finite: the step fails */
    int32_t notes_travel; /* stages for which the integrator records the travel of vertices (tm_max_increment_m) */
    tm_force_provider force;
    const tm_nonlinear *nonlinear; /* null: the tissue is linear */
    int32_t partition_count;
    tm_partition *partition; /* [partition_count+1] the last: all vertices, for passes by one thread */
    int32_t job_count;       /* force jobs since the last rebalancing */
    int32_t group_end;       /* index after the stages that compute new displacements: where overlapped work is for */
    int32_t overlap_count, overlap[TM_MAX_STAGES]; /* indices of stages with overlapped work in the running job */
    tm_thread_pool *thread_pool;                   /* null: one partition, or the caller's own threads */
    bool has_thread_pool;
    tm_parallel_for *parallel_for;
    void *parallel_for_user;
    int32_t profiled; /* index of the stage whose time is running, or TM_NO_STAGE */
    double profiled_since_s;
    int32_t stage_count, step_count; /* step_count: those before TM_PHASE_ON_DEMAND */
    struct tm_stage_entry {
        tm_stage stage;
        int64_t bytes, runs;
        double seconds;
        const tm_few *few; /* null: it may change any displacement */
        bool divides;      /* its `run` divides its work among the step's threads */
    } entry[TM_MAX_STAGES];
    void *support;          /* self of the support stage, or null */
    int32_t supports_set;   /* times that it was set or removed */
    void *touching, *ties;  /* self of these stages, or null */
    bool settle_drag;       /* settling moves bodies as in time, with the drag of their contact */
    double settle_stride_m; /* settling moves a component by at most this in a step, so that none passes through; 0: no
                               limit */
    /* Contact of tissue has less friction than settling holds bodies by where they would slide (settle.c), and the
     * least friction between surfaces while they are held. */
    bool settle_slides;
    double settle_friction;
};

/* Adds the reactions of the supports without forces that contact, bodies in contact and ties exert on them. */
void tm_support_reaction_of_tissue(const tm_world *world, double *reaction_N);

/* Adds stages that come and go together, all with one self; the memory is attributed to the first. Adds all or none. */
tm_status tm_world_add_stages(tm_world *world, const tm_stage *stage, int32_t count, void *self, int64_t bytes,
                              tm_error *error);
void tm_world_set_few(tm_world *world, const char *stage, const tm_few *few);
extern const tm_few tm_changes_none;
/* Notes that the stage's `run` divides its work itself (tm_partitions_run). */
void tm_world_set_divides(tm_world *world, const char *stage);
/* Sets the law of the stage "force"; null: the tissue's tensors. */
void tm_world_set_force(tm_world *world, const tm_force_provider *provider);
/* Returns whether the stages from this index on change few displacements only; whether those are bounded. */
bool tm_world_changes_few(const tm_world *world, int32_t slot);
bool tm_world_few_are_bounded(const tm_world *world, int32_t slot);

/* Overlapped work (overlaps.c). Begins that of the stages from `end` on, or, in the job of a stage's own, of those
 * after the new displacements; returns whether there is any. Then each part of the job does its own. */
bool tm_overlaps_begin(tm_world *world, int32_t end);
bool tm_overlaps_begin_after(tm_world *world, const void *self);
void tm_overlaps_work(tm_world *world, int32_t part);

/* Removes all stages and frees their memory. */
void tm_world_remove_all_stages(tm_world *world);

/* --- partitions (parallel_stages.c) --- */
/* Divides the tissue among as many threads as repay it. Returns false without memory or threads. */
bool tm_partitions_init(tm_world *world, tm_pool *pool, const tm_world_def *def);
/* partition.c. _init divides by count. _set_ends sets the partition ends: ascending, the last is the vertex count.
 * tm_rebalance moves the ends towards equal measured time; call it once after each job. */
bool tm_partition_init(tm_world *world, tm_pool *pool, const tm_tissue *tissue);
void tm_partition_set_ends(tm_world *world, const int32_t *end);
void tm_partition_record_time(tm_partition *partition,
                              double took_s); /* called by the partition's thread after a force job */
void tm_rebalance(tm_world *world);
/* Called before and after the substeps of a call. */
void tm_partitions_begin(tm_world *world, int32_t substeps);
void tm_partitions_end(tm_world *world);
/* Runs the stages [begin, end), all parallel, a block of vertices at a time. With `look_too`, checks that u_next_m is
 * bounded. */
void tm_partitions_run_stages(tm_world *world, int32_t begin, int32_t end, bool look_too);
/* Calls work(context, part) for every partition, on the step's threads. */
void tm_partitions_run(tm_world *world, void (*work)(void *context, int32_t part), void *context);
/* Sets world->unstable where a new displacement exceeds world->largest_m or is not a number. */
void tm_partitions_check_bounded(tm_world *world);
/* Returns whether the new displacement of one vertex is bounded. */
bool tm_vertex_is_bounded(const tm_world *world, int32_t vertex);
/* Returns a bound of the travel of all vertices from u_prev_m to u_m, m, whichever stage moved them. Valid once the
 * substep has new displacements, in a world with notes_travel. */
double tm_max_increment_m(const tm_world *world);
/* Runs one stage over the complete tissue, on the caller's thread. */
void tm_stage_do(const tm_stage *stage, tm_world *world);

/* --- attribution of time, when timing is on --- */
enum { TM_NO_STAGE = -1 };
/* Attributes time to this stage from here on. */
void tm_profile_enter(tm_world *world, int32_t slot);
/* Returns the index of the stage with this self, not of a substage; TM_NO_STAGE: none. */
int32_t tm_world_stage_index(const tm_world *world, const void *self);

/* TM_ERR_STEP: not positive, above the guaranteed step or above a stage's limit. */
tm_status tm_world_check_step(const tm_world *world, double dt_s, tm_error *error);
/* The same as tm_world_set_step without checks. */
void tm_world_change_step(tm_world *world, double dt_s);
/* adaptive_step.c: chooses the substep of the next step, and returns how many make one. */
int32_t tm_adaptive_begin(tm_world *world);
/* Returns the longest step that is guaranteed while no tetrahedron is strained by more than TM_STRAIN_REST; 0: no
 * memory. */
#define TM_STRAIN_REST 0.1
double tm_adaptive_longest_s(tm_tissue *tissue);
/* Share of the step that the bound of the present strains allows. */
#define TM_ADAPTIVE_MARGIN 0.95
/* Returns by how much an adaptive step of tissue of these materials may exceed the step that holds in every state. */
double tm_adaptive_gain(const tm_material *material, int32_t count, bool averaged);
tm_status tm_adaptive_check(const tm_tissue *tissue, tm_error *error); /* TM_ERR_EXCLUDED: it cannot be adaptive */
/* stage_law.c: the batches of the stage "law"; null: the world has none. */
const struct tm_hyperelastic *tm_world_hyperelastic(const tm_world *world);
/* Calls every stage's step_changed: dt changed or the tissue was cut. The integrator comes first, whatever its index:
 * others derive values from its new mobilities. */
void tm_world_changed(tm_world *world);
/* The same after tm_cut_remove, at a cost independent of the mesh size: it checks masses only near the cut. */
void tm_world_cut(tm_world *world);

/* The stages of every world. */
tm_stage_range tm_stage_force, tm_stage_integrate, tm_stage_integrate_damped;
/* Recomputes mobility and inertia from masses, damping and dt; stops vertices that have lost their last tetrahedron. */
void tm_stage_integrate_changed(void *self, tm_world *world);
void tm_stage_integrate_refresh(tm_world *world, const int32_t *vertex, int32_t count);
/* Sets all three of u to the present u at removed vertices, which every stage skips. */
void tm_stage_integrate_freeze_removed(tm_world *world);
/* Friction by which settling holds bodies at first. Facets press a body that lies on them sideways by up to a hundredth
 * of its weight. */
#define TM_SETTLE_FRICTION 0.02

/* The stages that settling recognises: with these alone the equilibrium is the solution of a linear system. */
tm_stage_range tm_stage_gravity_run, tm_stage_load_run, tm_stage_support_run;
const double *tm_stage_gravity_m_s2(const void *self);      /* [3] */
const double *tm_world_gravity_m_s2(const tm_world *world); /* [3]; none: zeros */
/* Writes the prescribed values into u. */
void tm_support_impose(const tm_world *world, double *u_m);

/* rigid_body_modes.c: TM_ERR_SUPPORT if the supports leave a connected component a rigid motion; with `load_N`
 * [3*vertex_count], a loaded one. */
tm_status tm_check_constrained(const tm_world *world, const double *load_N, tm_error *error);

/* stage_law.c: adds the stage "law", for materials with nonlinear laws. */
tm_status tm_stage_law(tm_world *world, tm_error *error);

#endif
