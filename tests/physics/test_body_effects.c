/* Effects of single bodies (tm_tissue_def.region_effects). Three bodies in one world: each moves bit for bit as it does
 * alone with the effects that act in it, for any number of threads, in both forms, and after cuts. A body without an
 * effect needs not a byte nor an instruction for it (tests/effects/test_plain_body.py). */
#include "../fixture.h"
#include "../long.h"

enum { BODIES = 3, STEPS = 14, CUT_AT = 7 };
enum { R = TM_REGION_ROTATION, S = TM_REGION_SMOOTHING, V = TM_REGION_VISCOSITY };

typedef struct setting {
    int of[BODIES]; /* effects of each body */
    double shear_share;
    bool apart; /* volume relaxes by another share than shear */
    bool cuts;
    int32_t threads;
    tm_force_form form;
} setting;

typedef struct organ {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
} organ;

/* Makes the bodies [first, last) as one mesh: a block each, in a region of its own. */
static tm_mesh *make_mesh(int first, int last) {
    tm_mesh *block[BODIES];
    int32_t vertices = 0, tets = 0;
    for (int b = first; b < last; b++) {
        fix_random random = {(uint64_t)b + 5};
        block[b] = fix_block((const int[3]){8, 5 + b % 2, 6}, (const double[3]){0.08, 0.05, 0.06}, 0.15, &random);
        vertices += block[b]->vertex_count, tets += block[b]->tet_count;
    }
    double *vertex = malloc(sizeof *vertex * 3 * (size_t)vertices);
    int32_t *tet = malloc(sizeof *tet * 4 * (size_t)tets), *region = malloc(sizeof *region * (size_t)tets);
    vertices = tets = 0;
    for (int b = first; b < last; b++) {
        for (int32_t i = 0; i < 3 * block[b]->vertex_count; i++)
            vertex[3 * vertices + i] = block[b]->rest_m[i] + (i % 3 == 1 ? 0.1 * b : 0);
        for (int32_t i = 0; i < 4 * block[b]->tet_count; i++) tet[4 * tets + i] = block[b]->tet[i] + vertices;
        for (int32_t t = 0; t < block[b]->tet_count; t++) region[tets + t] = b - first;
        vertices += block[b]->vertex_count, tets += block[b]->tet_count;
        tm_mesh_destroy(block[b]);
    }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = vertices, def.vertex_m = vertex, def.tet_count = tets, def.tet = tet;
    def.region = region;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    free(vertex), free(tet), free(region);
    return mesh;
}

/* Holds the ends at x = 0, and twists the bodies from there on. */
static void support_and_twist(organ *o) {
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)o->mesh->vertex_count), count = 0;
    double *u = calloc(3 * (size_t)o->mesh->vertex_count, sizeof *u);
    for (int32_t v = 0; v < o->mesh->vertex_count; v++) {
        const double *x = o->mesh->rest_m + 3 * v, angle = 12 * x[0], y = fmod(x[1] + 1e-9, 0.1) - 0.025;
        const double z = x[2] - 0.03;
        u[3 * v + 1] = cos(angle) * y - sin(angle) * z - y, u[3 * v + 2] = sin(angle) * y + cos(angle) * z - z;
        for (int i = 0; x[0] == 0 && i < 3; i++) dof[count++] = 3 * v + i;
    }
    double *zero = calloc((size_t)count, sizeof *zero);
    tm_support_def def = tm_support_def_default();
    tm_error error;
    def.count = count, def.dof = dof, def.value_m = zero;
    fix_ok(tm_stage_support(o->world, &def, &error), &error);
    const size_t bytes = sizeof *u * 3 * (size_t)o->mesh->vertex_count;
    memcpy(tm_world_state(o->world)->u_m, u, bytes);
    memcpy(tm_world_state(o->world)->u_prev_m, u, bytes);
    free(dof), free(u), free(zero);
}

static tm_viscosity_def terms(bool apart) {
    tm_viscosity_def def = tm_viscosity_def_default();
    def.count = 2;
    def.term[0] = (tm_viscosity_term){0.01, 0.3, apart ? 0.1 : 0.3};
    def.term[1] = (tm_viscosity_term){0.1, 0.2, 0.2};
    return def;
}

static organ make(const setting *s, int first, int last, bool by_region) {
    organ o = {.mesh = make_mesh(first, last)};
    tm_material material[BODIES];
    uint8_t effects[BODIES] = {0};
    int all = 0;
    tm_error error;
    for (int b = first; b < last; b++) {
        fix_ok(tm_material_young(4e3, 0.4, material + b - first, &error), &error);
        material[b - first].damping_1_s = 20;
        effects[b - first] = (uint8_t)s->of[b], all |= s->of[b];
    }
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = o.mesh, def.material_count = last - first, def.material = material;
    def.form = s->form, def.cuttable = s->cuts;
    def.rotation = all & R ? 0.02 : 0;
    def.strain_smoothing = all & S, def.smoothed_shear_share = s->shear_share;
    def.region_effects = by_region ? effects : NULL;
    fix_ok(tm_tissue_create(&def, &o.tissue, &error), &error);
    tm_world_def world = tm_world_def_default();
    world.tissue = o.tissue, world.dt_s = 1e-4, world.threads = s->threads;
    fix_ok(tm_world_create(&world, &o.world, &error), &error);
    if (all & R) fix_ok(tm_stage_rotation(o.world, NULL, &error), &error);
    const tm_viscosity_def relaxes = terms(s->apart);
    if (all & V) fix_ok(tm_stage_viscosity(o.world, &relaxes, &error), &error);
    fix_ok(tm_stage_gravity(o.world, (const double[3]){0, 0, -9.81}, &error), &error);
    support_and_twist(&o);
    return o;
}

static void drop(organ *o) {
    tm_world_destroy(o->world);
    tm_tissue_destroy(o->tissue);
    tm_mesh_destroy(o->mesh);
}

/* Removes a few tetrahedra in the middle of each body. */
static void cut(organ *o) {
    for (int32_t r = 0; r < o->mesh->region_count; r++) {
        int32_t first = 0, last, list[3];
        while (o->mesh->region[first] != r) first++;
        for (last = first; last < o->mesh->tet_count && o->mesh->region[last] == r;) last++;
        for (int i = 0; i < 3; i++) list[i] = first + (last - first) / 2 + i;
        tm_cut_remove(o->tissue, list, 3, NULL, 0);
    }
}

static void run(organ *o, const setting *s) {
    for (int i = 0; i < STEPS; i++) {
        if (s->cuts && i == CUT_AT) cut(o);
        assert_int_equal(tm_world_step(o->world, 1), TM_OK);
    }
}

/* The work that removes the energy of steps is shared by all rotating bodies: these have the bits of a body alone only
 * if no other rotates. */
static bool is_comparable(const setting *s, int body) {
    bool another = false;
    for (int b = 0; b < BODIES; b++) another |= b != body && (s->of[b] & R);
    return !(s->of[body] & R) || !another;
}

static void compare(const setting *s, const char *name) {
    organ all = make(s, 0, BODIES, true);
    run(&all, s);
    assert_int_equal(tm_world_partitions(all.world), s->threads);
    int32_t at = 0;
    for (int b = 0; b < BODIES; b++) {
        organ one = make(s, b, b + 1, false);
        const size_t bytes = sizeof(double) * 3 * (size_t)one.mesh->vertex_count;
        run(&one, s);
        const bool same = !memcmp(tm_world_state(all.world)->u_m + 3 * at, tm_world_state(one.world)->u_m, bytes);
        if (is_comparable(s, b) && !same)
            fail_msg("%s: body %d with effects %d of {%d, %d, %d} moves otherwise than alone (%d threads, form %d)",
                     name, b, s->of[b], s->of[0], s->of[1], s->of[2], (int)s->threads, (int)s->form);
        at += one.mesh->vertex_count;
        drop(&one);
    }
    drop(&all);
}

static void bodies_move_as_they_do_alone(void **unused) {
    (void)unused;
    static const struct {
        const char *name;
        int of[BODIES];
        double share;
    } row[] = {{"rotation", {0, R, 0}, 0},      {"rotation", {R, 0, R}, 0},
               {"smoothing", {S, 0, S}, 0.4},   {"smoothing", {0, S, 0}, 1},
               {"viscosity", {V, 0, V}, 0},     {"viscosity", {0, V, 0}, 0},
               {"both", {0, R | V, 0}, 0},      {"rotation in two, viscosity in one", {R | V, R, 0}, 0},
               {"apart", {R, V, 0}, 0},         {"viscosity and smoothing", {V | S, V, S}, 0.4},
               {"each another", {S, R, V}, 0.4}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++)
        for (int k = 0; k < 4; k++) {
            if (test_is_sanitized() && k != (int)i % 4) continue;
            setting s = {.shear_share = row[i].share, .apart = k & 1, .cuts = k & 2};
            s.threads = k == 1 || k == 2 ? 2 : 1;
            s.form = k & 1 ? TM_FORCE_BEST : TM_FORCE_PLAIN;
            memcpy(s.of, row[i].of, sizeof s.of);
            compare(&s, row[i].name);
        }
}

/* Settles all bodies in one world and each alone. */
static void bodies_settle_as_they_do_alone(void **unused) {
    (void)unused;
    static const int row[][BODIES] = {{R | V, R, 0}, {R, V, 0}, {S, V, V | S}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        setting s = {.threads = 1, .shear_share = 0.4, .apart = true};
        memcpy(s.of, row[i], sizeof s.of);
        organ all = make(&s, 0, BODIES, true);
        tm_settle_def def = tm_settle_def_default();
        tm_error error;
        def.tolerance = 1e-6;
        fix_ok(tm_world_settle(all.world, &def, NULL, &error), &error);
        int32_t at = 0;
        for (int b = 0; b < BODIES; b++) {
            organ one = make(&s, b, b + 1, false);
            const int32_t n = 3 * one.mesh->vertex_count;
            double most = 0;
            fix_ok(tm_world_settle(one.world, &def, NULL, &error), &error);
            const double *u = tm_world_state(one.world)->u_m, *v = tm_world_state(all.world)->u_m + 3 * at;
            for (int32_t k = 0; k < n; k++) most = fmax(most, fabs(u[k] - v[k]));
            assert_true(fix_largest(u, n) > 1e-3);
            assert_true(most < 1e-4 * fix_largest(u, n));
            at += one.mesh->vertex_count;
            drop(&one);
        }
        drop(&all);
    }
}

/* Without the effect, a body in the same place moves otherwise: the comparison above can fail. */
static void effects_act(void **unused) {
    (void)unused;
    for (int effect = R; effect <= V; effect *= 2) {
        const setting with = {.of = {effect, 0, 0}, .threads = 1}, without = {.threads = 1};
        organ a = make(&with, 0, BODIES, true), b = make(&without, 0, BODIES, true);
        run(&a, &with), run(&b, &without);
        int32_t own = 0;
        while (a.mesh->region[a.mesh->vertex_tet[a.mesh->vertex_tet_begin[own]]] == 0) own++;
        const double *u = tm_world_state(a.world)->u_m, *v = tm_world_state(b.world)->u_m;
        assert_int_not_equal(memcmp(u, v, sizeof *u * 3 * (size_t)own), 0);
        assert_memory_equal(u + 3 * own, v + 3 * own, sizeof *u * 3 * (size_t)(a.mesh->vertex_count - own));
        drop(&a), drop(&b);
    }
}

static void regions_with_common_vertices_are_refused(void **unused) {
    (void)unused;
    tm_mesh *block = make_mesh(0, 1);
    tm_mesh_def def = tm_mesh_def_default();
    int32_t *region = calloc((size_t)block->tet_count, sizeof *region);
    region[0] = 1;
    def.vertex_count = block->vertex_count, def.vertex_m = block->rest_m, def.tet_count = block->tet_count;
    def.tet = block->tet, def.region = region;
    tm_mesh *mesh = NULL;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &mesh, &error), &error);
    tm_material material;
    fix_ok(tm_material_young(4e3, 0.4, &material, &error), &error);
    const uint8_t effects[2] = {R, 0};
    const int32_t both[2] = {0, 0};
    tm_tissue_def tissue = tm_tissue_def_default();
    tm_tissue *made = NULL;
    tissue.mesh = mesh, tissue.material_count = 1, tissue.material = &material, tissue.region_material = both;
    tissue.rotation = 0.02, tissue.region_effects = effects;
    assert_int_equal(tm_tissue_create(&tissue, &made, &error), TM_ERR_ARGUMENT);
    assert_non_null(strstr(error.message, "share vertex"));
    tm_mesh_destroy(mesh), tm_mesh_destroy(block);
    free(region);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(bodies_move_as_they_do_alone),
                                       cmocka_unit_test(bodies_settle_as_they_do_alone), cmocka_unit_test(effects_act),
                                       cmocka_unit_test(regions_with_common_vertices_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
