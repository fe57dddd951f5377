/* A frame that becomes unstable is not rendered: one sample reports it, without force and stiffness, and the run
 * ends. */
#include "../fixture.h"

#include <unistd.h>

#include "../../apps/common/program_host.h"
#include "../../apps/sim/publish.h"
#include "../../apps/sim/run.h"

enum { SPOILT_FRAME = 30 };

static int64_t spoilt_step;

static void spoil(void *self, tm_world *world) {
    (void)self;
    const tm_state *state = tm_world_state(world);
    if (state->step >= spoilt_step)
        state->u_next_m[3 * (tm_tissue_mesh(tm_world_tissue(world))->vertex_count / 2)] = NAN;
}

static sim *spoilt_sim(char *const *set, int count) {
    char scene[600];
    snprintf(scene, sizeof scene, "%s/apps/scenes/block-press.yaml", getenv("TM_ROOT"));
    app_scene *loaded = NULL;
    sim *s = NULL;
    assert_int_equal(sim_scene_load(scene, set, count, app_program_host(), &loaded), 0);
    assert_int_equal(sim_create(loaded, &s), 0);
    const tm_stage stage = {.size = sizeof stage, .name = "spoil", .phase = TM_PHASE_END, .run = spoil};
    tm_error error;
    fix_ok(tm_world_add_stage(s->model->world, &stage, 0, &error), &error);
    return s;
}

typedef struct row {
    double frame, force, flags, kind;
} row;

/* Reads rows of the samples' file; columns are found by name. */
static int read_samples(const char *path, row *rows, int max) {
    FILE *in = fopen(path, "r");
    char line[1000], *names[40];
    assert_non_null(in);
    assert_non_null(fgets(line, sizeof line, in));
    static char head[1000];
    strcpy(head, line);
    int columns = 0, n = 0;
    for (char *p = strtok(head, ",\n"); p; p = strtok(NULL, ",\n")) names[columns++] = p;
    for (; n < max && fgets(line, sizeof line, in); n++) {
        char *p = line;
        rows[n] = (row){0};
        for (int c = 0; c < columns; c++) {
            const double x = strtod(p, &p);
            p++;
            if (!strcmp(names[c], "frame")) rows[n].frame = x;
            if (!strcmp(names[c], "flags")) rows[n].flags = x;
            if (!strcmp(names[c], "stiffness_kind")) rows[n].kind = x;
            if (!strncmp(names[c], "f", 1) && strstr(names[c], "_N")) rows[n].force += fabs(x);
        }
    }
    fclose(in);
    return n;
}

static void check_samples(const char *path, bool felt_before) {
    static row rows[4000];
    const int n = read_samples(path, rows, 4000);
    assert_true(n > 3);
    double most = 0;
    for (int i = 0; i + 1 < n; i++) {
        assert_false((int)rows[i].flags & SIM_FLAG_UNSTABLE);
        most = fmax(most, rows[i].force);
    }
    if (felt_before) assert_true(most > 0.01 && rows[n - 2].force > 0.01);
    assert_true((int)rows[n - 1].flags & SIM_FLAG_UNSTABLE);
    assert_true(rows[n - 1].force == 0 && rows[n - 1].kind == 0);
}

static void unstable_frame_is_not_rendered_in_lockstep(void **state) {
    (void)state;
    char samples[] = "/tmp/tm-unstable-XXXXXX", csv[] = "/tmp/tm-unstable-XXXXXX", line[1000];
    close(mkstemp(samples)), close(mkstemp(csv));
    char *set[] = {"haptics.extrapolator=tangent"};
    sim *s = spoilt_sim(set, 1);
    spoilt_step = (int64_t)s->substeps * (SPOILT_FRAME - 1) + s->substeps / 2;
    const run_options o = {.samples = samples, .csv = csv, .frames = -1, .duration_s = -1};
    assert_int_equal(run_lockstep(s, &o), APP_FAILED);
    /* Completed chunks of substeps stay: all before the bad substep. */
    assert_true(tm_world_state(s->model->world)->step >= (int64_t)s->substeps * (SPOILT_FRAME - 1));
    assert_true(tm_world_state(s->model->world)->step <= spoilt_step);
    assert_int_equal(s->frames, SPOILT_FRAME - 1);
    check_samples(samples, true);
    /* The hand feels a force before, and none half a second after. */
    FILE *in = fopen(csv, "r");
    double most = 0, last = -1, time_s = 0;
    assert_non_null(fgets(line, sizeof line, in));
    while (fgets(line, sizeof line, in)) {
        double f[3];
        assert_int_equal(sscanf(line, "%lf,%*d,%*d,%*d,%*u,%*f,%*f,%*f,%lf,%lf,%lf", &time_s, f, f + 1, f + 2), 4);
        last = fabs(f[0]) + fabs(f[1]) + fabs(f[2]);
        most = fmax(most, last);
    }
    fclose(in);
    assert_true(most > 0.05 && most < 9 && last == 0);
    assert_true(time_s > SPOILT_FRAME * s->frame_s + 0.4);
    sim_destroy(s);
    unlink(samples), unlink(csv);
}

static void unstable_frame_is_not_rendered_in_real_time(void **state) {
    (void)state;
    char samples[] = "/tmp/tm-unstable-XXXXXX";
    close(mkstemp(samples));
    char *set[] = {"haptics.extrapolator=position"};
    sim *s = spoilt_sim(set, 1);
    spoilt_step = 12 * (int64_t)s->substeps;
    const run_options o = {.samples = samples, .url = "memq://", .frames = -1, .duration_s = 60};
    assert_int_equal(run_realtime(s, &o), APP_FAILED);
    check_samples(samples, false);
    sim_destroy(s);
    unlink(samples);
}

/* For any model: a force that is not a number is not sent. */
static void non_finite_forces_are_not_sent(void **state) {
    (void)state;
    sim *s = spoilt_sim(NULL, 0);
    sim_publisher p = {0};
    tensormass_force_sample_t sample;
    s->wants[0] = SIM_SENDS_PATCH;
    for (int where = 0; where < 4; where++) {
        tm_tool_reaction *r = &s->reaction[0];
        *r = (tm_tool_reaction){.force_N = {1, 2, 3}, .row_count = 1, .stiffness_kind = 1, .flags = TM_REACTION_CAPPED};
        s->patch_valid[0] = true;
        if (where == 1) r->force_N[1] = NAN;
        if (where == 2) r->tip_m[2] = -INFINITY;
        if (where == 3) r->stiffness_N_m[8] = NAN;
        sim_force_sample(&p, s, 0, 0, 0, 0, 0, &sample);
        assert_true(sample.flags & SIM_FLAG_CAPPED);
        assert_int_equal((sample.flags & SIM_FLAG_UNSTABLE) != 0, where > 0);
        assert_int_equal((sample.flags & SIM_FLAG_PATCH) != 0, where == 0);
        assert_true(sample.force_N[0] == (where ? 0 : 1) && sample.stiffness_kind == (where ? 0 : 1));
        for (int c = 0; c < 3; c++) assert_true(isfinite(sample.tip_m[c]) && isfinite(sample.force_N[c]));
    }
    /* Each flag of a reaction has its own bit in a sample. */
    int32_t all = 0;
    for (int bit = 0; bit < 7; bit++) {
        s->reaction[0] = (tm_tool_reaction){.flags = 1u << bit};
        s->patch_valid[0] = false;
        sim_force_sample(&p, s, 0, 0, 0, 0, 0, &sample);
        assert_true(sample.flags && !(sample.flags & (sample.flags - 1)) && !(all & sample.flags));
        all |= sample.flags;
    }
    assert_int_equal(all, 1 + 2 + 16 + 32 + 64 + 128 + 256);
    sim_destroy(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(unstable_frame_is_not_rendered_in_lockstep),
                                       cmocka_unit_test(unstable_frame_is_not_rendered_in_real_time),
                                       cmocka_unit_test(non_finite_forces_are_not_sent)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
