/* The broad phase reuses gathered triangles while no other can be in reach: bit-identical to gathering in every
 * substep for any motion of tool and tissue, and rarely repeated at rest. */
#include "../fixture.h"
#include "contact/contact_internal.h"
#include "contact_scene.h"
#include "world/world_internal.h"

enum { FRAMES = 11, SUBSTEPS = 100, PROBE = 0, OTHER = 1 };
enum {
    SLOW = 3,
    JUMP = 5,
    THROWN = 6,
    FLUNG = 8
}; /* frames: pressing until then; tissue moved elsewhere at once; thrown */

typedef struct story {
    tm_contact *contact;
    bool anew;
    int32_t frame, substep, gathered[FRAMES], rows[FRAMES]; /* number of gatherings; rows of the other tool */
    uint64_t hash[FRAMES];
} story;

/* Before each substep, values of the previous one. */
static void note(void *self, tm_world *world) {
    story *told = self;
    tm_state *now = tm_world_state(world);
    const tm_mesh *mesh = tm_tissue_mesh(tm_world_tissue(world));
    const tm_contact_row *row;
    const int32_t rows = tm_contact_rows(told->contact, &row), at = told->frame;
    for (int32_t i = 0; i < rows; i++) {
        told->hash[at] = tm_hash(&row[i].face, sizeof row[i].face, told->hash[at]);
        told->hash[at] = tm_hash(row[i].normal, sizeof row[i].normal, told->hash[at]);
        told->rows[at] += row[i].instrument == OTHER && row[i].lambda_N > 0;
    }
    told->hash[at] = tm_hash(now->u_m, 24 * (size_t)mesh->vertex_count, told->hash[at]);
    for (int t = 0; t < 2; t++) {
        tm_tool *tool = told->contact->tool + t;
        told->gathered[at] += tool->regathered;
        if (told->anew) tool->margin_used_m = INFINITY;
    }
    if (told->substep++ == SUBSTEPS / 2 && told->frame == JUMP)
        for (int32_t v = 0; v < mesh->vertex_count; v++)
            if (mesh->rest_m[3 * v + 2] > 0.03) now->u_m[3 * v + 2] += 0.0115;
}

/* One tool presses, slides, leaves and returns at 1 m/s; the other one stands above, and tissue is thrown at it. */
static void begin_frame(scene *s, int i) {
    static const double TIP[FRAMES][3] = {{0.01, 0.005, 0.041},  {0.011, 0.005, 0.0405}, {0.0105, 0.006, 0.04},
                                          {-0.02, -0.02, 0.05},  {0.02, 0.015, 0.038},   {0.01, 0.02, 0.038},
                                          {0.011, 0.02, 0.04},   {0.0, 0.02, 0.045},     {0.02, 0.014, 0.045},
                                          {0.02, 0.015, 0.0455}, {-0.01, 0.015, 0.045}};
    const tm_tool_pose to = scene_pose(TIP[i][0], TIP[i][1], TIP[i][2]), there = scene_pose(-0.012, -0.01, 0.056);
    tm_contact_begin_frame(s->contact, SUBSTEPS, SUBSTEPS);
    tm_contact_set_target(s->contact, PROBE, &to, SUBSTEPS);
    tm_contact_set_target(s->contact, OTHER, &there, SUBSTEPS);
    if (i != THROWN && i != FLUNG) return;
    const double speed_m_s = i == THROWN ? 1.5 : 6;
    tm_state *now = tm_world_state(s->world);
    for (int32_t v = 0; v < s->mesh->vertex_count; v++)
        if (s->mesh->rest_m[3 * v + 2] > 0.03) now->u_prev_m[3 * v + 2] -= speed_m_s * tm_world_step_s(s->world);
}

static story play(tm_force_form form, int32_t threads, double damping_1_s, bool anew) {
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 13, def.cells[2] = 8, def.tools = 2;
    def.damping_1_s = damping_1_s, def.form = form, def.threads = threads;
    scene s = scene_create(&def);
    assert_int_equal(tm_world_partitions(s.world), threads);
    story told = {.contact = s.contact, .anew = anew};
    tm_error error;
    const tm_stage stage = {.size = sizeof stage, .name = "notes", .phase = TM_PHASE_BEGIN, .run = note, .self = &told};
    fix_ok(tm_world_add_stage(s.world, &stage, 0, &error), &error);
    for (told.frame = 0; told.frame < FRAMES; told.frame++) {
        told.hash[told.frame] = TM_HASH_SEED, told.substep = 0;
        begin_frame(&s, told.frame);
        assert_int_equal(tm_world_step(s.world, SUBSTEPS), TM_OK);
    }
    scene_destroy(&s);
    return told;
}

static void reuse_equals_gathering_in_every_substep(void **state) {
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        const tm_force_form form = kind == 1 ? TM_FORCE_PLAIN : TM_FORCE_BEST;
        const double damping_1_s = kind == 2 ? 0 : 20;
        const story anew = play(form, 1, damping_1_s, true);
        assert_true(anew.rows[SLOW] == 0 && anew.rows[JUMP] > 0 && anew.rows[THROWN] + anew.rows[FLUNG] > 0);
        assert_true(anew.gathered[1] == 2 * SUBSTEPS);
        for (int32_t threads = 1; threads < 3; threads++) {
            const story kept = play(form, threads, damping_1_s, false);
            assert_memory_equal(kept.hash, anew.hash, sizeof kept.hash);
            for (int i = 1; i < SLOW; i++) assert_true(kept.gathered[i] <= SUBSTEPS / 10);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(reuse_equals_gathering_in_every_substep)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
