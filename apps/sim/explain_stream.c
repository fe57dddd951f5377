#include "explain_stream.h"

#include <stdio.h>

#include "scene/effects.h"
#include "stream.h"

/* Says of each free instrument what gives its shaft's direction. */
static void explain_free(const sim *s, cJSON *json) {
    for (int i = 0; i < s->instrument_count; i++) {
        const hrt_device_type *device = s->axes[i].device;
        const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
        char where[300];
        if (!s->instrument_def[i].is_free) continue;
        app_scene_where(s->scene, t->mount.line, where, sizeof where);
        printf("instrument %d: free, its shaft in the direction of %s (%s)\n\n", i,
               device->tilts ? "the handle" : "axis", where);
        cJSON_AddStringToObject(json, i ? "direction_1" : "direction_0", device->tilts ? "handle" : "axis");
    }
}

void explain_stream(const sim *s, cJSON *json) {
    explain_free(s, json);
    static const char *const with[] = {[SIM_SENDS_FORCE] = "without stiffness and patch",
                                       [SIM_SENDS_STIFFNESS] = "with stiffness",
                                       [SIM_SENDS_PATCH] = "with stiffness and patch"};
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    if (!haptics) return;
    const double rate_Hz = 1 / s->sample_s;
    const sim_sends most = sim_stream_sends(s, rate_Hz), sends = most < s->can_send ? most : s->can_send;
    char where[300];
    app_scene_where(s->scene, haptics->rate.line ? haptics->rate.line : haptics->here.line, where, sizeof where);
    printf("force samples: %s%.4g Hz of %d substeps, %s (%s)\n\n", haptics->rate.si == 0 ? "up to " : "", rate_Hz,
           s->substeps / s->samples, with[sends], where);
    if (sends == SIM_SENDS_PATCH && !s->model->kind->knows_compliance &&
        (sim_has(s, "rotation") || sim_law_line(s->scene)))
        printf("patches: compliance of the tangent, %s; a summary says how far it aged (age_max)\n\n",
               s->exact_patches ? "from a factor that is renewed beside the simulation"
                                : "by iterations, which follow slowly");
    cJSON *out = cJSON_AddObjectToObject(json, "force_samples");
    cJSON_AddNumberToObject(out, "rate_Hz", rate_Hz);
    cJSON_AddBoolToObject(out, "adapts", haptics->rate.si == 0);
    cJSON_AddNumberToObject(out, "substeps", s->substeps / s->samples);
}
