/* Closed loops of viscous tissue. Terms with frozen histories are elastic: a loop leaves no energy. Relaxing terms
 * dissipate: no loop gains energy, and never more is returned than was put in. Isotropic and with fibres, with and
 * without nodal dilatation, rotated and inverted. */
#include "../long.h"
#include "turning.h"

#include "tensormass/viscosity.h"

enum { WAVES = 2 };
static const double NET = 1e-6; /* relative to the sum of the absolute work */

typedef struct plan {
    bool fibred, volume, rotation_of;
    double threshold; /* threshold of rotation; 0: the default */
} plan;

typedef struct piece {
    tm_mesh *mesh;
    tm_tissue *tissue;
    tm_world *world;
    int32_t n;
    double *wave; /* u = sum of a cos + b sin, twice WAVES times n */
} piece;

/* Computes the path at t, and its derivative. */
static void follow(const piece *p, double t, double *u, double *way) {
    memset(u, 0, sizeof *u * (size_t)p->n);
    memset(way, 0, sizeof *way * (size_t)p->n);
    for (int w = 0; w < WAVES; w++) {
        const double *a = p->wave + 2 * w * p->n, *b = a + p->n, k = w + 1, c = cos(k * t), s = sin(k * t);
        for (int32_t i = 0; i < p->n; i++) u[i] += (c - 1) * a[i] + s * b[i], way[i] += k * (c * b[i] - s * a[i]);
    }
}

static tm_tissue *tissue_of(const tm_mesh *mesh, const plan *of) {
    tm_material m;
    tm_error error;
    tm_tissue *tissue;
    tm_tissue_def def = tm_tissue_def_default();
    double *fibre = of->fibred ? fix_fibres(mesh, (double[]){1, 0.3, -0.2}) : NULL;
    if (of->fibred)
        fix_ok(tm_material_engineering(30e3, 6e3, 0.4, 0.45, 5e3, &m, &error), &error);
    else
        fix_ok(tm_material_young(5e3, 0.45, &m, &error), &error);
    def.mesh = mesh, def.material_count = 1, def.material = &m, def.fibre = fibre;
    def.strain_smoothing = of->volume, def.smoothed_shear_share = 0,
    def.rotation = !of->rotation_of    ? 0
                   : of->threshold > 0 ? of->threshold
                                       : TM_ROTATION_THRESHOLD;
    fix_ok(tm_tissue_create(&def, &tissue, &error), &error);
    free(fibre);
    return tissue;
}

/* All vertices are prescribed; histories begin with the strain of `start`, or 0. */
static piece make(const plan *of, const tm_viscosity_term *term, int32_t terms, double size_m, double start_m) {
    fix_random random = {7};
    piece p = {.mesh = fix_block((int[]){1, 1, 1}, (double[]){0.01, 0.01, 0.01}, 0.2, &random)};
    tm_error error;
    p.n = 3 * p.mesh->vertex_count;
    p.tissue = tissue_of(p.mesh, of), p.world = fix_world(p.tissue, false);
    p.wave = malloc(sizeof(double) * 2 * WAVES * (size_t)p.n);
    for (int32_t i = 0; i < 2 * WAVES * p.n; i++) p.wave[i] = size_m * fix_signed(&random);
    tm_state *s = tm_world_state(p.world);
    for (int32_t i = 0; i < p.n; i++) s->u_m[i] = s->u_prev_m[i] = start_m * fix_signed(&random);
    if (of->rotation_of) fix_ok(tm_stage_rotation(p.world, NULL, &error), &error);
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = terms;
    memcpy(viscosity.term, term, sizeof *term * (size_t)terms);
    fix_ok(tm_stage_viscosity(p.world, &viscosity, &error), &error);
    if (terms == 1)
        fix_ok(tm_world_set_step(p.world, 0.01 * s->dt_s, &error), &error); /* 1e6 s practically never relaxes */
    int32_t *dof = malloc(sizeof *dof * (size_t)p.n);
    for (int32_t i = 0; i < p.n; i++) dof[i] = i;
    tm_support_def support = tm_support_def_default();
    support.count = p.n, support.dof = dof, support.value_m = s->u_m;
    fix_ok(tm_stage_support(p.world, &support, &error), &error);
    free(dof);
    return p;
}

static void destroy(piece *p) {
    free(p->wave);
    tm_world_destroy(p->world);
    tm_tissue_destroy(p->tissue);
    tm_mesh_destroy(p->mesh);
}

typedef struct balance {
    double put_in, least, sizes; /* J: at the end, at its minimum, sum of absolute values */
} balance;

static balance go_round(const piece *p, int rounds, int points) {
    double *u = malloc(sizeof *u * 3 * (size_t)p->n), *way = u + p->n, *next = u + 2 * p->n, before = 0;
    const tm_state *s = tm_world_state(p->world);
    balance b = {0};
    follow(p, 0, u, way);
    for (int32_t i = 0; i < p->n; i++) tm_support_move(p->world, i, u[i]);
    fix_ok(tm_world_step(p->world, 1), NULL);
    for (int k = 0; k <= rounds * points; k++) {
        /* The step's force is that of its initial state. */
        const double t = 2 * M_PI * k / points;
        double power = 0;
        follow(p, t + 2 * M_PI / points, next, way);
        for (int32_t i = 0; i < p->n; i++) tm_support_move(p->world, i, next[i]);
        fix_ok(tm_world_step(p->world, 1), NULL);
        follow(p, t, u, way);
        for (int32_t i = 0; i < p->n; i++) power -= s->force_N[i] * way[i] * 2 * M_PI / points;
        if (k) b.put_in += 0.5 * (before + power), b.sizes += fabs(power);
        b.least = fmin(b.least, b.put_in);
        before = power;
    }
    free(u);
    return b;
}

static plan plan_of(int k) { return (plan){.fibred = k & 1, .volume = k & 2, .rotation_of = k & 4}; }

static void say(const char *what, int k, double size_m, const balance *b) {
    const plan of = plan_of(k);
    print_message("%s:%s%s%s, %g m: put in %.2e, at the least %.2e of %.2e J\n", what, of.fibred ? " fibred" : "",
                  of.volume ? " volume" : "", of.rotation_of ? " turned" : "", size_m, b->put_in, b->least, b->sizes);
}

static const double SIZE_M[] = {1e-4, 1e-3, 1e-2};

static void test_frozen_histories_are_elastic(void **state) {
    (void)state;
    static const tm_viscosity_term frozen = {1e6, 0.6, 0.3};
    for (int k = 0; k < 8; k++)
        for (int i = 0; i < 3; i++) {
            const plan of = plan_of(k);
            piece p = make(&of, &frozen, 1, SIZE_M[i], SIZE_M[i]);
            const balance b = go_round(&p, 1, 1 << 13);
            if (fabs(b.put_in) >= NET * b.sizes) say("frozen", k, SIZE_M[i], &b);
            assert_true(fabs(b.put_in) < NET * b.sizes);
            destroy(&p);
        }
}

/* Relaxation times from far below a loop's duration to far above it. */
static void test_relaxing_terms_only_dissipate(void **state) {
    (void)state;
    const int points = 1 << 13, rounds = test_is_long() ? 20 : 1;
    for (int k = 0; k < 8; k++)
        for (int i = 0; i < 3; i++)
            for (int slow = 0; slow < 3; slow++) {
                const plan of = plan_of(k);
                tm_viscosity_term term[2] = {{1, 0.5, 0}, {1, 0.3, 0.6}};
                piece bare = make(&of, term, 1, 1e-4, 0);
                const double loop_s = points * tm_world_state(bare.world)->dt_s;
                destroy(&bare);
                term[0].time_s = loop_s * (double[]){1e-3, 0.1, 30}[slow], term[1].time_s = 5 * term[0].time_s;
                piece p = make(&of, term, 2, SIZE_M[i], 0);
                const balance b = go_round(&p, rounds, points);
                if (b.put_in < -NET * b.sizes || b.least < -NET * b.sizes) say("relaxing", k, SIZE_M[i], &b);
                assert_true(b.put_in > -NET * b.sizes && b.least > -NET * b.sizes);
                assert_true(b.put_in > 1e-5 * b.sizes); /* and it does dissipate */
                destroy(&p);
            }
}

/* Returns the angular momentum about the block's centre of mass, in the middle of the last step. */
static void momentum(const tm_mesh *mesh, const tm_tissue *tissue, const tm_state *s, double L[3]) {
    double centre[3] = {0}, mass = 0, at[3], way[3], arm[3], part[3];
    L[0] = L[1] = L[2] = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            const double kg = tissue->mass_kg[v];
            for (int c = 0; c < 3; c++) {
                at[c] = mesh->rest_m[3 * v + c] + 0.5 * (s->u_m[3 * v + c] + s->u_prev_m[3 * v + c]);
                way[c] = s->u_m[3 * v + c] - s->u_prev_m[3 * v + c];
            }
            if (pass == 0) mass += kg, vmadd(centre, kg, at, centre);
            if (pass == 0) continue;
            vmadd(at, -1 / mass, centre, arm);
            vcross(arm, way, part);
            vmadd(L, kg / s->dt_s, part, L);
        }
}

/* Returns the maximum error of the angular momentum of a free, fibred, relaxing block that rotates five times a
 * second. */
static double spin(double threshold) {
    enum { STEPS = 2500 };
    const plan of = {.rotation_of = true, .fibred = true, .threshold = threshold};
    fix_random random = {7};
    tm_mesh *mesh = fix_block((int[]){4, 3, 3}, (double[]){0.04, 0.03, 0.03}, 0.2, &random);
    tm_tissue *tissue = tissue_of(mesh, &of);
    tm_world *world = fix_world(tissue, false);
    tm_error error;
    tm_viscosity_def viscosity = tm_viscosity_def_default();
    viscosity.count = 1, viscosity.term[0] = (tm_viscosity_term){.time_s = 0.1, .shear = 0.8};
    fix_ok(tm_stage_rotation(world, NULL, &error), &error);
    fix_ok(tm_stage_viscosity(world, &viscosity, &error), &error);
    tm_state *s = tm_world_state(world);
    const double a = 10 * acos(-1.0) * s->dt_s;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const double x = mesh->rest_m[3 * v] - 0.02, y = mesh->rest_m[3 * v + 1] - 0.015;
        s->u_prev_m[3 * v] = x * (cos(a) - 1) + y * sin(a);
        s->u_prev_m[3 * v + 1] = -x * sin(a) + y * (cos(a) - 1);
    }
    double first[3], now[3], off[3], worst = 0;
    momentum(mesh, tissue, s, first);
    for (int i = 0; i < STEPS; i += 50) {
        assert_int_equal(tm_world_step(world, 50), TM_OK);
        momentum(mesh, tissue, s, now);
        vsub(now, first, off);
        worst = fmax(worst, vnorm(off) / vnorm(first));
    }
    print_message("spinning: %.1f turns, angular momentum within %.1e\n", 5 * STEPS * s->dt_s, worst);
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    return worst;
}

/* The linear law below the threshold interprets rotation as strain: it takes momentum once, while the block begins
 * to rotate. If the first step is already beyond the threshold, it takes none. */
static void test_rotating_block_keeps_angular_momentum(void **state) {
    (void)state;
    assert_true(spin(TM_ROTATION_THRESHOLD) < 3e-4);
    assert_true(spin(0.002) < 1e-12);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_frozen_histories_are_elastic),
        cmocka_unit_test(test_relaxing_terms_only_dissipate),
        cmocka_unit_test(test_rotating_block_keeps_angular_momentum),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
