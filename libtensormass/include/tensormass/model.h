/* Common interface to all models of an organ: dynamic (this library), precomputed and hybrid (tensormass_solve.h). All
 * take the same definition and the same calls. A model refuses what it cannot do with TM_ERR_EXCLUDED and a message.
 * Each model has a table of functions (tm_model_kind). */
#ifndef TENSORMASS_MODEL_H
#define TENSORMASS_MODEL_H

#include "cut.h"
#include "friction.h"
#include "grasp.h"
#include "patch.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tm_model tm_model;

/* An organ with its supports, loads and instruments. Everything is copied except the mesh, which must outlive the
 * model. */
typedef struct tm_model_def {
    uint32_t cookie, size;
    tm_tissue_def tissue; /* the complete organ; cuttable is set if `cut` is given */
    int32_t support_count;
    const int32_t *support_dof;      /* [support_count] 3*vertex + axis, each once */
    const double *support_m;         /* [support_count] */
    const double *load_N;            /* [3*vertex_count], null: none */
    const double *gravity_m_s2;      /* [3], null: none */
    const tm_contact_def *contact;   /* null: no contact */
    const tm_grasp_def *grasp;       /* instruments in grasper mode grasp tissue; requires contact; null: none does */
    const tm_friction_def *friction; /* requires contact; null: frictionless. Hybrid: TM_ERR_EXCLUDED */
    const tm_cut_def *cut;           /* active cauteries cut; requires contact; null: none does */
    double frame_s;                  /* interval between calls of tm_model_frame, 1/30 */
    /* Upper limit of a substep; above the guaranteed critical step: TM_ERR_STEP. 0: the guaranteed step times
     * `step_fraction`. Quasi-static models have no substeps. */
    double step_s;
    double step_fraction;   /* 0.9 */
    double average;         /* share of the frame, at its end, over which reactions are averaged; 1 */
    bool damped;            /* as tm_world_def */
    double step_limit_s;    /* step limit due to what is attached to the tissue without being part of it; 0: none */
    int32_t step_limit_tet; /* tetrahedron that sets it */
    int32_t threads;        /* as tm_world_def, and the next two; ignored by quasi-static models */
    tm_parallel_for *parallel_for;
    void *parallel_for_user;
    const char **invalid_member; /* may be null; set on failure: name of the invalid member above */
    /* The step follows the bound of the present state (tm_world_adapt): step_s, timing.dt_s and substeps are then those
     * of tissue that is strained by less than 0.1. Dynamic models. false */
    bool adaptive;
} tm_model_def;

/* Times, constant for the life of a model. */
typedef struct tm_timing {
    double frame_s, dt_s;      /* a frame is an integer number of equal substeps; quasi-static: dt_s = frame_s */
    int32_t substeps, average; /* per frame; averaged for reactions, at the end of the frame; quasi-static: 1 */
    double critical_s;         /* guaranteed critical step */
    int32_t critical_tet;      /* tetrahedron that sets it */
} tm_timing;

/* Functions of a kind of model; `model` is the model itself. A null function is taken from tm_model.inner. Without
 * inner, null step, end and start do nothing, and a null surface is the tissue's. Only settle, save, restore and
 * `allow_patches` allocate. Programs call the functions below, which check the contracts. */
typedef struct tm_model_kind {
    uint32_t size;
    const char *name;      /* "dynamic", "precomputed", "hybrid" */
    bool knows_compliance; /* exactly, without a source: tm_patch_def.source is not read */
    void (*destroy)(tm_model *model);
    void (*begin)(tm_model *model, const tm_tool_pose *to, int32_t substeps);
    tm_status (*step)(tm_model *model, int32_t substeps);
    void (*end)(tm_model *model);
    void (*set_pose)(tm_model *model, int32_t instrument, const tm_tool_pose *at);
    tm_tool_reaction (*reaction)(const tm_model *model, int32_t instrument);
    tm_surface_view (*surface)(tm_model *model);
    const double *(*displacement)(tm_model *model);
    double (*time_s)(const tm_model *model);
    uint64_t (*hash)(tm_model *model);
    tm_status (*allow_patches)(tm_model *model, const tm_patch_def *def, tm_error *error);
    bool (*patch)(tm_model *model, int32_t instrument, tm_patch *patch);
    tm_status (*settle)(tm_model *model, const tm_settle_def *def, double *u_m, double *reaction_N,
                        tm_settle_result *result, tm_error *error);
    int64_t (*snapshot_bytes)(const tm_model *model);
    tm_status (*save)(const tm_model *model, void *buffer, int64_t bytes, tm_error *error);
    tm_status (*restore)(tm_model *model, const void *buffer, int64_t bytes, tm_error *error);
    tm_status (*start)(tm_model *model, tm_error *error);
    int32_t (*stages)(const tm_model *model, tm_stage_report report[TM_MAX_STAGES]);
    void (*set_timing)(tm_model *model, bool on);
    int64_t (*snapshot_bytes_max)(const tm_model *model);
} tm_model_kind;

/* Common head of every model; the model's own data follows in memory. Read-only for all but the model itself. */
struct tm_model {
    const tm_model_kind *kind;
    tm_timing timing;
    tm_tissue *tissue;   /* the world's tissue if there is a world: only it may be cut */
    tm_world *world;     /* for additional stages; null: quasi-static, no steps */
    tm_contact *contact; /* of that world; null: none */
    tm_model *inner;     /* supplies the functions that the kind leaves null; may be null */
    int32_t instrument_count;
    int32_t condensed_tets;                /* tetrahedra of the organ outside `tissue`: quasi-static, never cut */
    tm_tool_pose pose[TM_MAX_INSTRUMENTS]; /* at the end of the last frame */
    tm_tool_pose to[TM_MAX_INSTRUMENTS];   /* target of the current frame */
    bool failed;                           /* the last frame failed and was rolled back */
};

TM_API tm_model_def tm_model_def_default(void);
/* Checks counts, times and dependencies of a definition. Every constructor calls it first. */
TM_API tm_status tm_model_check(const tm_model_def *def, tm_error *error);

/* Creates the tensor/mass model: inertia, motion, any part can be cut. Refuses TM_SINGLE if a connected component has
 * rigid-body modes (see there). */
TM_API tm_status tm_model_dynamic(const tm_model_def *def, tm_model **model, tm_error *error);
TM_API void tm_model_destroy(tm_model *model); /* null is allowed */

/* Computes one frame: moves every instrument to to[i] ([instrument_count], null if there are none). On TM_ERR_UNSTABLE
 * the state is as before the call; reactions then have TM_REACTION_UNSTABLE and no force. No allocation. */
TM_API tm_status tm_model_frame(tm_model *model, const tm_tool_pose *to);
/* The same as separate calls: begin, steps that add up to `substeps` (timing.substeps for a complete frame), end. The
 * division changes no bit; a failed call is rolled back alone. Without `end` reactions are not updated. */
TM_API void tm_model_begin(tm_model *model, const tm_tool_pose *to, int32_t substeps);
TM_API tm_status tm_model_step(tm_model *model, int32_t substeps);
TM_API void tm_model_end(tm_model *model);
/* Sets the pose of an instrument at once: no swept path. */
TM_API void tm_model_set_pose(tm_model *model, int32_t instrument, const tm_tool_pose *at);

/* Returns the reaction of the last frame. stiffness_kind is 0 until tm_model_patch was called for the instrument. */
TM_API tm_tool_reaction tm_model_reaction(const tm_model *model, int32_t instrument);
/* Returns the surface of the complete organ, active tetrahedra only. Valid until the next frame. */
TM_API tm_surface_view tm_model_surface(tm_model *model);
/* Returns the displacements, [3*vertex_count] m. The precomputed model has surface vertices only: inner vertices read
 * 0. Valid until the next frame. */
TM_API const double *tm_model_displacement(tm_model *model);
TM_API double tm_model_time_s(const tm_model *model);
/* Returns the number of active tetrahedra of the complete organ. */
TM_API int32_t tm_model_alive(const tm_model *model);
/* Returns a hash of the bits of its state. */
TM_API uint64_t tm_model_hash(tm_model *model);

/* Allocates memory and adds a stage for patches and stiffness; call once. Without def->source the dynamic model
 * estimates its compliance (tensormass/patch.h); precomputed and hybrid models have theirs. TM_ERR_ARGUMENT: no
 * contact. */
TM_API tm_status tm_model_allow_patches(tm_model *model, const tm_patch_def *def, tm_error *error);
/* Computes the instrument's patch (null: not needed) and its stiffness, which its reaction has from then on. Call after
 * a frame. Returns false if there is no patch (see tm_patch_compute) or tm_model_allow_patches was not called. No
 * allocation. */
TM_API bool tm_model_patch(tm_model *model, int32_t instrument, tm_patch *patch);

/* Computes static equilibrium under supports and loads: u_m and reaction_N (force of the supports on the tissue), both
 * [3*vertex_count]. Dynamic: relaxes the model, with instruments in place. Precomputed and hybrid: solves for the organ
 * in its present cut state, without instruments; the model is unchanged and result->steps is 0. */
TM_API tm_status tm_model_settle(tm_model *model, const tm_settle_def *def, double *u_m, double *reaction_N,
                                 tm_settle_result *result, tm_error *error);

/* Snapshot: all data with which a model of the same definition continues bit-identically (tm_snapshot_save). Its size
 * changes with contact, grasps and cuts. Call tm_model_snapshot_bytes before each save, or allocate
 * tm_model_snapshot_bytes_max once after the last stage was added: no later snapshot is larger. A damaged snapshot, or
 * one of another definition, is refused without any change. `buffer` is aligned to 8 bytes. */
TM_API int64_t tm_model_snapshot_bytes(const tm_model *model);
TM_API int64_t tm_model_snapshot_bytes_max(const tm_model *model);
TM_API tm_status tm_model_save(const tm_model *model, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_model_restore(tm_model *model, const void *buffer, int64_t bytes, tm_error *error);

/* For real time: from now on, work that overlaps the frames runs in its own thread (tm_compliance_source.start). Before
 * this call, equal calls give equal bits. */
TM_API tm_status tm_model_start(tm_model *model, tm_error *error);

/* Reports the stages of a frame in the order in which they run. A quasi-static model has one, run once a frame. */
TM_API int32_t tm_model_stages(const tm_model *model, tm_stage_report report[TM_MAX_STAGES]);
TM_API void tm_model_set_timing(tm_model *model, bool on);

#ifdef __cplusplus
}
#endif
#endif
