/* One interface to every model of an organ: dynamic (this library), precomputed and hybrid (tensormass_solve.h). The
 * same definition makes each of them, the same calls move it, and what one of them cannot do it refuses with
 * TM_ERR_EXCLUDED and a sentence. Their differences are in one row of functions each (tm_model_kind). */
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

/* An organ, what holds it and what touches it. Everything is copied, but the mesh, which must outlive the model. */
typedef struct tm_model_def {
    uint32_t cookie, size;
    tm_tissue_def tissue; /* of the whole organ; cuttable is set where `cut` is given */
    int32_t support_count;
    const int32_t *support_dof;      /* [support_count] 3*vertex + axis, each once */
    const double *support_m;         /* [support_count] */
    const double *load_N;            /* [3*vertex_count], null: none */
    const double *gravity_m_s2;      /* [3], null: none */
    const tm_contact_def *contact;   /* null: nothing touches it */
    const tm_grasp_def *grasp;       /* instruments of mode grasper hold tissue; needs contact; null: they do not */
    const tm_friction_def *friction; /* needs contact; null: instruments slide freely. Hybrid: TM_ERR_EXCLUDED */
    const tm_cut_def *cut;           /* active cauteries cut; needs contact; null: they do not */
    double frame_s;                  /* from one call of tm_model_frame to the next, 1/30 */
    double step_s;          /* a substep is not longer; above the guaranteed critical step: TM_ERR_STEP; 0: that
                               times `step_fraction`. Quasi-static models have no substeps */
    double step_fraction;   /* 0.9 */
    double average;         /* share of a frame, at its end, that reactions are means of; 1 */
    bool damped;            /* as tm_world_def */
    double step_limit_s;    /* of what hangs on the tissue and is not in it; 0: nothing does */
    int32_t step_limit_tet; /* that sets it */
    int32_t threads;        /* as tm_world_def, with the two that follow; quasi-static models have none */
    tm_parallel_for *parallel_for;
    void *parallel_for_user;
    const char **invalid_member; /* may be null; set on failure: the name of the member above that is at fault */
} tm_model_def;

/* Lengths of time, fixed when the model is made. */
typedef struct tm_timing {
    double frame_s, dt_s;      /* a frame is a whole number of equal substeps; quasi-static: dt_s = frame_s */
    int32_t substeps, average; /* of a frame; the last of them that reactions are means of; quasi-static: 1 */
    double critical_s;         /* guaranteed critical step */
    int32_t critical_tet;      /* tetrahedron that sets it */
} tm_timing;

/* What a model is made of; `model` is its own. A null function is done by tm_model.inner, and without that as follows:
 * step, end and start do nothing, surface is the tissue's. None allocates but settle, save and restore
 * and `allow_patches`. Contracts were looked at by the functions below, which are what programs call. */
typedef struct tm_model_kind {
    uint32_t size;
    const char *name;      /* "dynamic", "precomputed", "hybrid" */
    bool knows_compliance; /* exactly, by itself: tm_patch_def.source is not read */
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

/* What every model has; its own follows in memory. Read-only for all but the model itself. */
struct tm_model {
    const tm_model_kind *kind;
    tm_timing timing;
    tm_tissue *tissue;   /* that of the world where there is one: it alone may be cut */
    tm_world *world;     /* for stages of your own; null: quasi-static, there is nothing to step */
    tm_contact *contact; /* of that world; null: none */
    tm_model *inner;     /* the model that does what the kind leaves null, or null */
    int32_t instrument_count;
    int32_t condensed_tets;                /* of the organ that are not in `tissue`: quasi-static, never cut */
    tm_tool_pose pose[TM_MAX_INSTRUMENTS]; /* at the end of the last frame */
    tm_tool_pose to[TM_MAX_INSTRUMENTS];   /* of the frame under way */
    bool failed;                           /* so did the last frame: it has not happened */
};

TM_API tm_model_def tm_model_def_default(void);
/* What every constructor looks at first: counts, times and what needs what. */
TM_API tm_status tm_model_check(const tm_model_def *def, tm_error *error);

/* The tensor/mass model: mass, motion, and everything cuttable. A piece that supports leave free to move or turn is
 * refused in TM_SINGLE (see there). */
TM_API tm_status tm_model_dynamic(const tm_model_def *def, tm_model **model, tm_error *error);
TM_API void tm_model_destroy(tm_model *model); /* null is allowed */

/* One frame: every instrument goes to to[i] ([instrument_count], null where there are none). All or nothing:
 * TM_ERR_UNSTABLE, and nothing has happened; reactions then say TM_REACTION_UNSTABLE and no force. No allocation. */
TM_API tm_status tm_model_frame(tm_model *model, const tm_tool_pose *to);
/* The same in pieces: begin, steps that add up to `substeps` (that of the pace for a whole frame), end. Pieces change
 * no bit; what fails is as before its own piece. Without `end` the frame has not been: nobody feels it. */
TM_API void tm_model_begin(tm_model *model, const tm_tool_pose *to, int32_t substeps);
TM_API tm_status tm_model_step(tm_model *model, int32_t substeps);
TM_API void tm_model_end(tm_model *model);
/* Puts an instrument there at once: no path is swept. */
TM_API void tm_model_set_pose(tm_model *model, int32_t instrument, const tm_tool_pose *at);

/* Of the last frame. stiffness_kind is 0 until tm_model_patch was called for the instrument. */
TM_API tm_tool_reaction tm_model_reaction(const tm_model *model, int32_t instrument);
/* Of the whole organ, living. Valid until the next frame. */
TM_API tm_surface_view tm_model_surface(tm_model *model);
/* [3*vertex_count] m; the precomputed model knows its surface alone: inner vertices read 0. Valid until the next frame.
 */
TM_API const double *tm_model_displacement(tm_model *model);
TM_API double tm_model_time_s(const tm_model *model);
/* Living tetrahedra of the whole organ. */
TM_API int32_t tm_model_alive(const tm_model *model);
/* Of the bits of its state. */
TM_API uint64_t tm_model_hash(tm_model *model);

/* Memory and a stage for patches and stiffness; once. Without def->source the dynamic model estimates its compliance
 * (tensormass/patch.h); precomputed and hybrid know theirs. TM_ERR_ARGUMENT: no contact. */
TM_API tm_status tm_model_allow_patches(tm_model *model, const tm_patch_def *def, tm_error *error);
/* After a frame: the instrument's stiffness, from now on in its reaction, and the patch (null: not wanted). False:
 * there is no patch (tm_patch_compute says when), or none were allowed. No allocation. */
TM_API bool tm_model_patch(tm_model *model, int32_t instrument, tm_patch *patch);

/* Rest under supports and loads: u_m and reaction_N (of the supports on the tissue), both [3*vertex_count]. Dynamic:
 * relaxes the model, instruments where they are. Precomputed and hybrid: solved anew, as cut as it is, without
 * instruments; the model stays as it is, result->steps is 0. */
TM_API tm_status tm_model_settle(tm_model *model, const tm_settle_def *def, double *u_m, double *reaction_N,
                                 tm_settle_result *result, tm_error *error);

/* Everything that a model of the same definition needs to go on with the same bits (tm_snapshot_save). The size changes
 * with contact, grasps and cuts: ask tm_model_snapshot_bytes before each save, or allocate tm_model_snapshot_bytes_max
 * once, after the last stage was added: no later snapshot is larger. What is damaged or of another definition is
 * refused, and changes nothing. `buffer` is aligned to 8 bytes. */
TM_API int64_t tm_model_snapshot_bytes(const tm_model *model);
TM_API int64_t tm_model_snapshot_bytes_max(const tm_model *model);
TM_API tm_status tm_model_save(const tm_model *model, void *buffer, int64_t bytes, tm_error *error);
TM_API tm_status tm_model_restore(tm_model *model, const void *buffer, int64_t bytes, tm_error *error);

/* For real time: what works beside the frames does so in a thread of its own from now on (tm_compliance_source.start).
 * Until then the same calls give the same bits. */
TM_API tm_status tm_model_start(tm_model *model, tm_error *error);

/* What a frame is made of, in the order it runs; a quasi-static model is one row, run once a frame. */
TM_API int32_t tm_model_stages(const tm_model *model, tm_stage_report report[TM_MAX_STAGES]);
TM_API void tm_model_set_timing(tm_model *model, bool on);

#ifdef __cplusplus
}
#endif
#endif
