/* A support that oscillates, as the diaphragm moves the liver. Example of docs/adding-an-effect.md. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/elementary.h"
#include "sim.h"

typedef struct options {
    app_section here;
    app_text support;
    app_vector amplitude;
    app_number period;
} options;

static const app_field fields[] = {
    {"breathing", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "periodic motion of a support"},
    {"breathing.support", APP_TEXT, NULL, "!", 0, 0, offsetof(options, support), 0, "name of the support"},
    {"breathing.amplitude", APP_VECTOR, "length", "[0, 0, 10 mm]", 0, 0, offsetof(options, amplitude), 0,
     "displacement from rest to the far end"},
    {"breathing.period", APP_NUMBER, "time", "4 s", 0.01, 1000, offsetof(options, period), 0, "duration of one breath"},
};

typedef struct moved {
    int32_t component; /* of the stage `support` */
    double rest_m, amplitude_m;
} moved;

typedef struct breathing {
    double angular_1_s;
    int64_t bytes;
    int32_t count;
    moved component[];
} breathing;

static void run(void *self, tm_world *world) {
    const breathing *b = self;
    const tm_state *state = tm_world_state(world);
    /* Supports prescribe the displacement at the end of this step. */
    double share = 0.5 - 0.5 * tm_cosine(b->angular_1_s * (state->time_s + state->dt_s));
    for (int32_t i = 0; i < b->count; i++)
        tm_support_move(world, b->component[i].component, b->component[i].rest_m + share * b->component[i].amplitude_m);
}

static void destroy(void *self) { tm_release(self, (size_t)((breathing *)self)->bytes); }

static int find_support(const app_scene *scene, const options *o) {
    for (int i = 0; i < scene->support.count; i++)
        if (!strcmp(((const app_support *)scene->support.item)[i].name.s, o->support.s)) return i;
    return -1;
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    int i = find_support(scene, o);
    if (i < 0 || !*o->support.s)
        return app_scene_bad(
            scene, o->support.line,
            "breathing moves the support '%s', which the scene does not name; give one of the supports this name",
            o->support.s);
    const app_support *s = (const app_support *)scene->support.item + i;
    for (int a = 0; a < 3; a++)
        if (o->amplitude.v[a] != 0 && !strchr(s->axes.s, "xyz"[a]))
            return app_scene_bad(scene, o->amplitude.line ? o->amplitude.line : o->here.line,
                                 "breathing moves along %c, which the support leaves free; hold that axis too",
                                 "xyz"[a]);
    return 0;
}

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    tm_error error = {0};
    uint8_t support = (uint8_t)(1 + find_support(s->scene, o));
    int32_t count = 0;
    for (int32_t i = 0; i < s->fixed_count; i++)
        count += s->fixed_by[i] == support && o->amplitude.v[s->fixed_dof[i] % 3] != 0;
    size_t bytes = sizeof(breathing) + sizeof(moved) * (size_t)count;
    breathing *b = tm_allocate(bytes);
    if (!b) return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    *b = (breathing){.angular_1_s = 2 * M_PI / o->period.si, .bytes = (int64_t)bytes};
    for (int32_t i = 0; i < s->fixed_count; i++) {
        double amplitude = o->amplitude.v[s->fixed_dof[i] % 3];
        if (s->fixed_by[i] == support && amplitude != 0)
            b->component[b->count++] = (moved){i, s->fixed_m[i], amplitude};
    }
    tm_stage stage = {.size = sizeof(tm_stage),
                      .name = "breathing",
                      .phase = TM_PHASE_BEGIN,
                      .run = run,
                      .destroy = destroy,
                      .self = b};
    if (!tm_world_add_stage(s->model->world, &stage, b->bytes, &error)) return 0;
    destroy(b);
    return sim_report(s->scene, o->here.line, &error);
}

const sim_effect sim_effect_breathing = {
    .name = "breathing",
    .doc = "Moves one of the scene's supports from where it is held to `amplitude` away and back, smoothly: (1 - cos(2 "
           "pi t / period)) / 2.",
    .example = "{support: bottom, amplitude: [0, 0, 5 mm]}",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .check = check,
    .build = build,
};
