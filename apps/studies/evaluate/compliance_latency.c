/* Latency of exact compliance in its own thread, by the wall clock. Measures when the first patch is complete and how
 * many frames after a cut patches are exact again. Also measures how much the simulation's frame slows down meanwhile.
 * Frames of 25 Hz. The figures are of this machine under this load; no test asserts them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "app.h"
#include "bandwidth.h"
#include "bench.h"
#include "common/program_host.h"
#include "evaluate.h"
#include "json_file.h"
#include "scene/solve_api.h"
#include "tensormass/cut.h"

enum { SETTLED = 12, SMALL_CUTS = 5, APART = 8, PATIENCE = 200 };
static const double EDGE_M = 0.005, FRAME_S = 0.04, RADIUS_M = 0.0035, DEEP_M = 0.003;

typedef struct bed {
    app_bench b;
    tm_contact *contact;
    tm_patch_builder *maker;
    double top_m, middle_m, begin_s;
    int frames;
    bool exact, whole;           /* exact: the last frame's patch; whole: no request is outstanding */
    double step_s[4 * PATIENCE]; /* time of each frame, without the patch */
} bed;

static tm_status make_bed(bed *b, const int32_t cells[3], tm_error *error) {
    app_bench_def def = app_bench_default(0, 0);
    memset(b, 0, sizeof *b);
    for (int c = 0; c < 3; c++) def.cells[c] = cells[c], def.size_m[c] = cells[c] * EDGE_M;
    b->top_m = def.size_m[2], b->middle_m = 0.5 * def.size_m[0] + 0.0013;
    tm_status status = tm_material_young(5e3, 0.4, &def.material[0], error);
    def.material[0].damping_1_s = 60, def.cuttable = true;
    if (!status) status = app_bench_open(&def, &b->b, error);
    tm_instrument_def tool = {.radius_m = RADIUS_M,
                              .contact_length_m = 0.1,
                              .trocar_m = {b->middle_m, b->middle_m, b->top_m + 0.1},
                              .pose = {.tip_m = {b->middle_m, b->middle_m, b->top_m + RADIUS_M}, .active = true}};
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = 1, contact.instrument = &tool;
    return status ? status : tm_stage_contact(b->b.world, &contact, &b->contact, error);
}

static tm_status make_patches(bed *b, const sim_solve_api *api, tm_error *error) {
    uint8_t *fixed = app_zeroed(3 * (size_t)b->b.mesh->vertex_count, 1);
    tm_support_mask(b->b.world, fixed);
    tm_compliance_factor_def def = api->tm_compliance_factor_def_default_();
    def.tissue = b->b.tissue, def.fixed = fixed;
    tm_compliance_factor *factored;
    tm_status status = api->tm_compliance_factor_create_(&def, &factored, error);
    free(fixed);
    if (status) return status;
    tm_compliance_source source = api->tm_compliance_factor_owned_source_(factored);
    tm_patch_def patch = tm_patch_def_default();
    patch.horizon_s = 2 * FRAME_S, patch.source = &source;
    status = tm_stage_patch(b->b.world, b->contact, &patch, &b->maker, error);
    if (status) source.destroy(source.self);
    return status ? status : tm_patch_start(b->maker, error);
}

static void sleep_until(double at_s) {
    double left = at_s - app_seconds();
    if (left > 0) nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * fmin(left, 0.9))}, NULL);
}

/* Runs one frame of 40 ms, not before it is due. The pressed tool circles slowly, so that new vertices come near. */
static bool frame(bed *b) {
    static tm_patch patch;
    const int32_t n = (int32_t)ceil(FRAME_S / tm_world_step_s(b->b.world));
    const double angle = 0.06 * b->frames, radius = 0.008 * fmin(b->frames / 20.0, 1);
    tm_tool_pose to = {.active = true};
    to.tip_m[0] = b->middle_m + radius * cos(angle), to.tip_m[1] = b->middle_m + radius * sin(angle);
    to.tip_m[2] = b->top_m + RADIUS_M - DEEP_M * fmin(b->frames / 8.0, 1);
    const double start = app_seconds();
    tm_contact_begin_frame(b->contact, n, n);
    tm_contact_set_target(b->contact, 0, &to, n);
    bool good = tm_world_step(b->b.world, n) == TM_OK;
    if (b->frames < (int)(sizeof b->step_s / sizeof *b->step_s)) b->step_s[b->frames] = app_seconds() - start;
    b->exact = b->maker && tm_patch_compute(b->maker, 0, &patch) && patch.kind == 2;
    b->whole = b->exact && !tm_patch_pending(b->maker);
    b->frames++;
    sleep_until(start + FRAME_S);
    return good;
}

/* Cuts tetrahedra at the surface in a ball beyond the tool's circle, 9 mm further from the middle. */
static int32_t cut(bed *b, double angle, double radius_m) {
    int32_t gone = 0;
    const double centre[3] = {b->middle_m + 0.017 * cos(angle), b->middle_m + 0.017 * sin(angle), b->top_m};
    for (int32_t t = 0; t < b->b.mesh->tet_count; t++) {
        double d[3] = {-centre[0], -centre[1], -centre[2]};
        for (int k = 0; k < 12; k++) d[k % 3] += 0.25 * b->b.mesh->rest_m[3 * b->b.mesh->tet[4 * t + k / 3] + k % 3];
        if (d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < radius_m * radius_m)
            gone += tm_cut_remove(b->b.tissue, &t, 1, NULL, 0);
    }
    return gone;
}

/* Returns the processor time of all other threads. */
static double others_s(void) { return app_processor_s() - app_clock_s(CLOCK_THREAD_CPUTIME_ID); }

/* Runs frames until patches are exact, or complete. Without a builder runs the given number, so that both runs have the
 * same tissue. */
static int until(bed *b, bool whole, int frames) {
    int waited = 0;
    if (!b->maker) {
        for (; waited < frames && frame(b); waited++) {
        }
        return frames;
    }
    while (waited < PATIENCE) {
        if (!frame(b)) return PATIENCE;
        waited++;
        if (whole ? b->whole : b->exact) break;
    }
    return waited;
}

typedef struct ready {
    double first_s, first_cpu_s;
    int first, small[SMALL_CUTS], large, small_tets, large_tets;
} ready;

static void session(bed *b, ready *r) {
    b->begin_s = app_seconds();
    const double before_s = others_s();
    r->first = until(b, true, r->first);
    if (b->maker) r->first_s = app_seconds() - b->begin_s, r->first_cpu_s = others_s() - before_s;
    for (int i = 0; i < SETTLED; i++) frame(b);
    for (int i = 0; i < SMALL_CUTS; i++) {
        r->small_tets += cut(b, 2.0 + 0.5 * i, 0.0045);
        r->small[i] = until(b, false, r->small[i]);
        for (int k = 0; k < APART; k++) frame(b);
    }
    r->large_tets += cut(b, 5.5, 0.015);
    r->large = until(b, false, r->large);
    for (int k = 0; k < APART; k++) frame(b);
}

static void report(cJSON *rows, const bed *alone, bed *beside, const ready *r) {
    double small[SMALL_CUTS];
    static double step_s[4 * PATIENCE];
    const int most = (int)(sizeof step_s / sizeof *step_s);
    for (int i = 0; i < SMALL_CUTS; i++) small[i] = r->small[i];
    const int count = beside->frames < most ? beside->frames : most;
    memcpy(step_s, alone->step_s, sizeof step_s);
    const double own_s = app_median(step_s, count), with_s = app_median(beside->step_s, count);
    const double small_frames = app_median(small, SMALL_CUTS); /* app_median sorts */
    double load[1] = {0};
    app_json_add(
        rows,
        "tets %d first_whole_patch_s %g first_whole_patch_worker_s %g cut_tets %g exact_after_cut_frames %g exact_after_cut_frames_most %g large_cut_tets %g exact_after_large_cut_frames %d step_alone_s %g step_beside_s %g slower %g load_average %g",
        beside->b.mesh->tet_count, r->first_s, r->first_cpu_s, r->small_tets / 2.0 / SMALL_CUTS, small_frames,
        small[SMALL_CUTS - 1], r->large_tets / 2.0, r->large, own_s, with_s, own_s > 0 ? with_s / own_s - 1 : 0,
        getloadavg(load, 1) == 1 ? load[0] : 0);
}

static int one(const sim_solve_api *api, const int32_t cells[3], cJSON *rows) {
    static bed beside, alone;
    ready r = {0};
    tm_error error = {0};
    tm_status status = make_bed(&beside, cells, &error);
    if (!status) status = make_patches(&beside, api, &error);
    if (!status) session(&beside, &r);
    if (!status) status = make_bed(&alone, cells, &error);
    if (!status) session(&alone, &r);
    if (!status) report(rows, &alone, &beside, &r);
    app_bench_close(&beside.b);
    app_bench_close(&alone.b);
    return status ? app_report(NULL, 0, &error) : 0;
}

int study_ready(const study_run *run, cJSON *out) {
    static const int32_t cells[][3] = {{14, 14, 13}, {20, 20, 21}};
    sim_solve_api api;
    tm_error error = {0};
    if (!sim_solve_open(app_program_host(), &api, &error)) return 0;
    for (int i = 0; i < (run->quick ? 1 : 2); i++) {
        progress("ready times", 0.5 * i);
        const int rc = one(&api, cells[i], out);
        if (rc) return rc;
    }
    return 0;
}
