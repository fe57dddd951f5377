/* What a frame of each model costs, and that they agree at rest: the same block and the same press, through the scenes
 * of tm-evaluate. */
#include <math.h>
#include <string.h>

#include "accuracy.h"
#include "bandwidth.h"
#include "common/program_host.h"
#include "scene/sim.h"

enum { FRAMES = 40, REST = 120 };

typedef struct price {
    double seconds_per_frame, setup_s, force_N;
    int64_t bytes;
} price;

static bool measure(const char *scene_file, price *out) {
    char rate[] = "time.frame_rate=30", sends[] = "haptics.sends=force", extrapolator[] = "haptics.extrapolator=hold";
    char *set[] = {rate, sends, extrapolator}, found[2048];
    app_scene *scene = NULL;
    sim *s = NULL;
    int64_t before = tm_memory_in_use();
    double start = app_seconds(), sample[FRAMES];
    app_shared_file(scene_file, found, sizeof found);
    if (sim_scene_load(found, set, 3, app_program_host(), &scene) || sim_create(scene, &s)) return false;
    out->setup_s = app_seconds() - start;
    double top = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) top = fmax(top, s->mesh->rest_m[3 * v + 2]);
    tm_tool_pose to = {.active = true};
    memcpy(to.tip_m, s->instrument_def[0].trocar_m, sizeof to.tip_m);
    bool good = true;
    for (int k = 0; k < FRAMES + REST; k++) {
        to.tip_m[2] = top + s->instrument_def[0].radius_m - 0.003 * fmin(1, (k + 1.0) / FRAMES);
        start = app_seconds();
        good = good && sim_frame(s, &to, s->substeps) == TM_OK;
        if (k >= REST) sample[k - REST] = app_seconds() - start;
    }
    out->seconds_per_frame = app_median(sample, FRAMES);
    out->force_N = s->reaction[0].force_N[2];
    out->bytes = tm_memory_in_use() - before;
    sim_destroy(s);
    return good;
}

void model_prices(cJSON *rows, void (*progress)(const char *, double)) {
    static const struct {
        const char *name, *scene, *cuttable;
    } models[] = {{"tensor/mass", "apps/scenes/evaluate-isotropic.yaml", "everywhere"},
                  {"hybrid", "apps/scenes/evaluate-hybrid.yaml", "its tensor/mass part"},
                  {"precomputed", "apps/scenes/evaluate-precomputed.yaml", "nowhere"}};
    double truth = 0;
    for (int m = 0; m < 3; m++) {
        price p;
        progress("prices of the models", m / 3.0);
        if (!measure(models[m].scene, &p)) continue;
        if (m == 0) truth = p.force_N;
        app_json_add(rows, "model %s cuttable %s seconds_per_frame %g setup_s %g bytes %g force_N %g difference %g",
                     models[m].name, models[m].cuttable, p.seconds_per_frame, p.setup_s, (double)p.bytes, p.force_N,
                     fabs(p.force_N / truth - 1));
    }
}
