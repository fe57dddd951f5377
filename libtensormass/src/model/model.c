/* Functions that programs call: contract checks, and code common to all models. */
#include "tensormass/model.h"

#include <string.h>

#include "base/contract.h"
#include "model/model_internal.h"

tm_model_def tm_model_def_default(void) {
    return (tm_model_def){.cookie = TM_COOKIE_MODEL,
                          .size = sizeof(tm_model_def),
                          .tissue = tm_tissue_def_default(),
                          .frame_s = 1.0 / 30,
                          .step_fraction = 0.9,
                          .average = 1,
                          .damped = true,
                          .threads = 1};
}

void tm_model_destroy(tm_model *model) {
    if (model) model->kind->destroy(model);
}

/* --- frames --- */

void tm_model_begin(tm_model *model, const tm_tool_pose *to, int32_t substeps) {
    TM_REQUIRE(model && substeps >= 1 && (to || model->instrument_count == 0),
               "model or to is null, or substeps is below 1", );
    for (int i = 0; i < model->instrument_count; i++)
        TM_REQUIRE(TM_IS_POSE(to + i), "a pose is not finite or beyond 1e6", );
    for (int i = 0; i < model->instrument_count; i++) model->to[i] = to[i];
    model->failed = false;
    if (model->kind->begin)
        model->kind->begin(model, to, substeps);
    else
        tm_model_begin(model->inner, to, substeps);
}

tm_status tm_model_step(tm_model *model, int32_t substeps) {
    TM_REQUIRE(model && substeps >= 1, "model is null or substeps is below 1", TM_ERR_ARGUMENT);
    tm_status status = TM_OK;
    if (model->kind->step)
        status = model->kind->step(model, substeps);
    else if (model->inner)
        status = tm_model_step(model->inner, substeps);
    model->failed = status != TM_OK;
    return status;
}

void tm_model_end(tm_model *model) {
    TM_REQUIRE(model && !model->failed, "model is null, or its last frame failed", );
    if (model->kind->end)
        model->kind->end(model);
    else if (model->inner)
        tm_model_end(model->inner);
    for (int i = 0; i < model->instrument_count; i++) model->pose[i] = model->to[i];
}

tm_status tm_model_frame(tm_model *model, const tm_tool_pose *to) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    tm_model_begin(model, to, model->timing.substeps);
    const tm_status status = tm_model_step(model, model->timing.substeps);
    if (status == TM_OK) tm_model_end(model);
    return status;
}

#define INSTRUMENT_IS_THERE(...)                                                                                       \
    TM_REQUIRE(model &&instrument >= 0 && instrument < model->instrument_count,                                        \
               "model is null or instrument is not one of its own", __VA_ARGS__)

void tm_model_set_pose(tm_model *model, int32_t instrument, const tm_tool_pose *at) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(at), "at is null, not finite or beyond 1e6", );
    if (model->kind->set_pose)
        model->kind->set_pose(model, instrument, at);
    else
        tm_model_set_pose(model->inner, instrument, at);
    model->pose[instrument] = *at;
}

/* --- results --- */

tm_tool_reaction tm_model_reaction(const tm_model *model, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_reaction){0});
    if (!model->failed) return model->kind->reaction(model, instrument);
    tm_tool_reaction none = {.time_s = tm_model_time_s(model), .flags = TM_REACTION_UNSTABLE};
    memcpy(none.tip_m, model->pose[instrument].tip_m, sizeof none.tip_m);
    return none;
}

tm_surface_view tm_model_surface(tm_model *model) {
    TM_REQUIRE(model, "model is null", (tm_surface_view){0});
    return model->kind->surface ? model->kind->surface(model) : tm_tissue_surface(model->tissue);
}

const double *tm_model_displacement(tm_model *model) {
    TM_REQUIRE(model, "model is null", NULL);
    return model->kind->displacement(model);
}

double tm_model_time_s(const tm_model *model) {
    TM_REQUIRE(model, "model is null", 0);
    return model->kind->time_s ? model->kind->time_s(model) : tm_model_time_s(model->inner);
}

int32_t tm_model_alive(const tm_model *model) {
    TM_REQUIRE(model, "model is null", 0);
    return model->condensed_tets + tm_tissue_alive_count(model->tissue);
}

uint64_t tm_model_hash(tm_model *model) {
    TM_REQUIRE(model, "model is null", 0);
    return model->kind->hash(model);
}

/* --- patches --- */

tm_status tm_model_allow_patches(tm_model *model, const tm_patch_def *def, tm_error *error) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    TM_REQUIRE_DEF(def, TM_COOKIE_PATCH, TM_ERR_ARGUMENT);
    if (model->instrument_count == 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "patches need contact, and this model has none; give tm_model_def.contact");
    return model->kind->allow_patches(model, def, error);
}

bool tm_model_patch(tm_model *model, int32_t instrument, tm_patch *patch) {
    INSTRUMENT_IS_THERE(false);
    return !model->failed && model->kind->patch(model, instrument, patch);
}

/* --- equilibrium, snapshots --- */

tm_status tm_model_settle(tm_model *model, const tm_settle_def *def, double *u_m, double *reaction_N,
                          tm_settle_result *result, tm_error *error) {
    TM_REQUIRE(model && u_m && reaction_N && result, "model, u_m, reaction_N or result is null", TM_ERR_ARGUMENT);
    TM_REQUIRE_DEF(def, TM_COOKIE_SETTLE, TM_ERR_ARGUMENT);
    *result = (tm_settle_result){0};
    return model->kind->settle(model, def, u_m, reaction_N, result, error);
}

int64_t tm_model_snapshot_bytes(const tm_model *model) {
    TM_REQUIRE(model, "model is null", 0);
    return model->kind->snapshot_bytes ? model->kind->snapshot_bytes(model) : tm_model_snapshot_bytes(model->inner);
}

int64_t tm_model_snapshot_bytes_max(const tm_model *model) {
    TM_REQUIRE(model, "model is null", 0);
    return model->kind->snapshot_bytes_max ? model->kind->snapshot_bytes_max(model)
                                           : tm_model_snapshot_bytes_max(model->inner);
}

tm_status tm_model_save(const tm_model *model, void *buffer, int64_t bytes, tm_error *error) {
    TM_REQUIRE(model && buffer, "model or buffer is null", TM_ERR_ARGUMENT);
    return model->kind->save(model, buffer, bytes, error);
}

tm_status tm_model_restore(tm_model *model, const void *buffer, int64_t bytes, tm_error *error) {
    TM_REQUIRE(model && buffer, "model or buffer is null", TM_ERR_ARGUMENT);
    const tm_status status = model->kind->restore(model, buffer, bytes, error);
    if (status == TM_OK) model->failed = false;
    return status;
}

/* --- work that overlaps the frames --- */

tm_status tm_model_start(tm_model *model, tm_error *error) {
    TM_REQUIRE(model, "model is null", TM_ERR_ARGUMENT);
    if (model->kind->start) return model->kind->start(model, error);
    return model->inner ? tm_model_start(model->inner, error) : TM_OK;
}

int32_t tm_model_stages(const tm_model *model, tm_stage_report report[TM_MAX_STAGES]) {
    TM_REQUIRE(model && report, "model or report is null", 0);
    return model->kind->stages ? model->kind->stages(model, report) : tm_model_stages(model->inner, report);
}

void tm_model_set_timing(tm_model *model, bool on) {
    TM_REQUIRE(model, "model is null", );
    if (model->kind->set_timing)
        model->kind->set_timing(model, on);
    else
        tm_model_set_timing(model->inner, on);
}
