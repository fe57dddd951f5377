/* What the room `world` gives: the inside of a world, its list of stages, and the stages that every world may have. */
#ifndef TM_WORLD_INTERNAL_H
#define TM_WORLD_INTERNAL_H

#include "base/thread_pool.h"
#include "tensormass/rotation.h"
#include "tensormass/world.h"
#include "tissue/tissue_internal.h"

enum { TM_COOKIE_WORLD = 0x776f726c, TM_COOKIE_SUPPORT = 0x73757070, TM_COOKIE_SETTLE = 0x73657474 };

/* What one thread has of a step. */
typedef struct tm_partition {
    tm_force_partition force;  /* its vertices */
    bool unstable;             /* one of them is nowhere, since the substep's last look */
    int32_t *halo;             /* [vertex_count] room of force.below; null: the first */
    double usual_s;            /* of its thread, in the mean of the jobs of force before sum_s */
    _Alignas(64) double sum_s; /* in those since the borders were looked at; its thread's, on a cache line of its own */
    double max_increment_m;    /* that the farthest component of its vertices came in the substep before */
} tm_partition;

/* The law that the stage "force" computes. */
typedef struct tm_force_provider {
    const char *stage; /* that gives it; null: the tissue's tensors */
    void *self;
    tm_stage_range *range; /* null: `stage` computes all of it by itself, and "force" leaves 0 */
} tm_force_provider;

/* A nonlinear law: what it adds to the tissue's tensors. Settling, the account of energy and compliance columns ask
 * this, and know no law by name. */
struct tm_tangent;
typedef struct tm_nonlinear {
    void *self; /* of its stage */
    double (*energy)(const void *self, const double *u_m);
    void (*force)(const void *self, const double *u_m, double *force_N); /* force_N := */
    /* [3*vertex_count] added in the last step and no law's (conserve.h); null, or returns null: nothing. */
    const double *(*added_N)(const void *self);
    bool (*take_tangent)(const void *self, struct tm_tangent *tangent, tm_pool *pool); /* false: no memory */
    /* Of the tetrahedra [begin, end), onto the tensors (tm_tangent_begin). */
    void (*add_tangent)(const void *self, const double *u_m, int32_t begin, int32_t end, struct tm_tangent *tangent);
    double *scratch_N; /* [3*vertex_count] */
} tm_nonlinear;

/* Of a stage behind the new displacements that changes few of them, or none. */
typedef struct tm_few {
    bool (*applies)(const void *self);                           /* in this substep; null: always */
    bool (*is_bounded)(const void *self, const tm_world *world); /* those that it changed; null: it changes none */
} tm_few;

struct tm_world {
    tm_pool pool;
    tm_state state;
    tm_tissue *tissue;
    bool damped, timing;
    bool wide;                /* stages may use AVX2, where that has the bits of the plain loop */
    int32_t revision;         /* of the tissue's surface that masses and stages know */
    double guaranteed_step_s; /* of the tissue at creation: cutting never lowers it */
    int32_t guaranteed_tet;
    double largest_m;       /* displacement beyond which a step has failed */
    double *mobility_s2_kg; /* [vertex_count] 1/(m/dt2 + gamma/2dt), 0 without mass: move per newton in a step */
    double *inertia;        /* damped: [vertex_count] (m/dt2 - gamma/2dt) * mobility; else null */
    int64_t inertia_bytes;  /* of that, booked on the stage that reads it */
    uint8_t *fixed_scratch; /* [3*vertex_count] of tm_world_set_step */
    double *internal_N;     /* [3*vertex_count] where the stage "energy" wants the tissue's own force; else null */
    const struct tm_energy_part *energy_part; /* tissue that the account of energy asks for itself; null: none */
    /* as they were when tm_world_step was called */
    double *saved_u_m, *saved_u_prev_m, *saved_force_N;
    int64_t saved_step;
    double saved_time_s;
    bool settling;      /* passes over the stages are no steps: nothing moves, and no history goes on */
    bool evaluating;    /* forces are evaluated outside a step: no history goes on */
    bool check_removed; /* in this substep, for displacements that are nowhere */
    bool unstable;      /* a stage met a number that is not finite: the step fails */
    bool notes_travel;  /* the integrator notes how far vertices came (tm_max_increment_m) */
    tm_force_provider force;
    const tm_nonlinear *nonlinear; /* null: the tissue is linear */
    int32_t partition_count;
    tm_partition *partition;     /* [partition_count+1] the last: all of it, for passes that one thread does */
    int32_t job_count;           /* of force, since the borders were looked at */
    int32_t group_end;           /* slot behind the divided stages under way */
    tm_thread_pool *thread_pool; /* null: one part, or the caller's own threads */
    bool has_thread_pool;
    tm_parallel_for *parallel_for;
    void *parallel_for_user;
    int32_t profiled; /* slot on which time is booked at present, or TM_NO_STAGE */
    double profiled_since_s;
    int32_t stage_count, step_count; /* step_count: those before TM_PHASE_ON_DEMAND */
    struct tm_stage_entry {
        tm_stage stage;
        int64_t bytes, runs;
        double seconds;
        const tm_few *few; /* null: it may change any displacement */
    } entry[TM_MAX_STAGES];
    void *support;        /* self of the support stage, or null */
    int32_t supports_set; /* how often that was set or taken away */
};

/* Stages that come and go together, all of one self; the memory is the first one's. All or none. */
tm_status tm_world_add_stages(tm_world *world, const tm_stage *stage, int32_t count, void *self, int64_t bytes,
                              tm_error *error);
void tm_world_set_few(tm_world *world, const char *stage, const tm_few *few);
extern const tm_few tm_changes_none;
/* Names the law of the stage "force"; null: the tissue's tensors. */
void tm_world_set_force(tm_world *world, const tm_force_provider *provider);
/* From this slot on, do stages change few displacements only? Are those bounded? */
bool tm_world_changes_few(const tm_world *world, int32_t slot);
bool tm_world_few_are_bounded(const tm_world *world, int32_t slot);

/* All of them, with what they hold. */
void tm_world_remove_all_stages(tm_world *world);

/* --- parts (parallel_stages.c) --- */
/* Divides the tissue among the threads that it is worth. False: no memory, or no thread to be had. */
bool tm_partitions_init(tm_world *world, tm_pool *pool, const tm_world_def *def);
/* partition.c: divides by count; moves borders to end[partition_count], ascending, the last all; or to where the times
 * of the jobs that have been done want them: once after each job. */
bool tm_partition_init(tm_world *world, tm_pool *pool, const tm_tissue *tissue);
void tm_partition_set_ends(tm_world *world, const int32_t *end);
void tm_partition_record_time(tm_partition *partition, double took_s); /* by the part's own thread, of a job of force */
void tm_rebalance(tm_world *world);
/* Around the substeps of a call. */
void tm_partitions_begin(tm_world *world, int32_t substeps);
void tm_partitions_end(tm_world *world);
/* Stages [begin, end), all divided, a block of vertices at a time; and looks whether u_next_m is sound. */
void tm_partitions_run_stages(tm_world *world, int32_t begin, int32_t end, bool look_too);
/* work(context, part) of every part, by the step's threads. */
void tm_partitions_run(tm_world *world, void (*work)(void *context, int32_t part), void *context);
/* Sets world->unstable where a new displacement is beyond world->largest_m or no number. */
void tm_partitions_check_bounded(tm_world *world);
/* Of one vertex: is it not? */
bool tm_vertex_is_bounded(const tm_world *world, int32_t vertex);
/* No farther any vertex came from u_prev_m to u_m, whoever moved it, m; once new displacements have been made in this
 * substep, in a world that notes it. */
double tm_max_increment_m(const tm_world *world);
/* One stage over the whole tissue, by the caller's thread. */
void tm_stage_do(const tm_stage *stage, tm_world *world);

/* --- whose time it is, when timing is on --- */
enum { TM_NO_STAGE = -1 };
/* From here on time is booked on this slot. */
void tm_profile_enter(tm_world *world, int32_t slot);
/* Of the whole stage with this self, not of a part; TM_NO_STAGE: none. */
int32_t tm_world_stage_index(const tm_world *world, const void *self);

/* TM_ERR_STEP: not positive, above the guaranteed step or above what a stage allows. */
tm_status tm_world_check_step(const tm_world *world, double dt_s, tm_error *error);
/* Calls every stage's step_changed: dt changed or the tissue was cut. The integrator comes first, whatever its slot:
 * what others derive from mobilities they derive from the new ones. */
void tm_world_changed(tm_world *world);
/* The same after tm_cut_remove, at a cost that does not grow with the mesh: masses are looked at where it cut only. */
void tm_world_cut(tm_world *world);

/* Every world's own stages. */
tm_stage_range tm_stage_force, tm_stage_integrate, tm_stage_integrate_damped;
/* Refreshes mobility and carry from masses, damping and dt; stops vertices that have lost their last tetrahedron. */
void tm_stage_integrate_changed(void *self, tm_world *world);
void tm_stage_integrate_refresh(tm_world *world, const int32_t *vertex, int32_t count);
/* Dead vertices are passed over by every stage: all three of u hold what u holds now. */
void tm_stage_integrate_freeze_removed(tm_world *world);
/* The stages settle knows: with these alone the rest state is a linear system. */
tm_stage_range tm_stage_gravity_run, tm_stage_load_run, tm_stage_support_run;
const double *tm_stage_gravity_m_s2(const void *self);      /* [3] */
const double *tm_world_gravity_m_s2(const tm_world *world); /* [3]; none: zeros */
/* Writes the prescribed values into u. */
void tm_support_impose(const tm_world *world, double *u_m);

/* rigid_body_modes.c: TM_ERR_SUPPORT if the supports leave a piece a rigid motion; with `load_N` [3*vertex_count], a
 * loaded one. */
tm_status tm_check_constrained(const tm_world *world, const double *load_N, tm_error *error);

/* stage_law.c: the stage "law", of tissue whose materials have nonlinear laws. */
tm_status tm_stage_law(tm_world *world, tm_error *error);

/* The stage "rotation" of a world, or null. */
tm_rotation *tm_world_rotation(const tm_world *world);

#endif
