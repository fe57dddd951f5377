/* Bodies of blocks that touch each other, for the tests of contact of tissue. */
#ifndef TM_TEST_TOUCH_BLOCKS_H
#define TM_TEST_TOUCH_BLOCKS_H

#include "../fixture.h"
#include "touch/touch_internal.h"

#include "apps/common/block.h"

typedef struct part {
    int cells[3];
    double size_m[3], at_m[3], turn_rad; /* about z */
} part;

typedef struct bodies {
    tm_mesh *mesh;
    int32_t *tet_body, body_begin[17], count;
    tm_tissue *tissue;
    tm_world *world;
    tm_touching *touching;
    tm_contact *contact; /* of add_tools */
} bodies;

typedef struct setup {
    double young_Pa, damping_1_s, gravity_m_s2, step_s, mu;
    double tilt_rad;                         /* of each part about y, before it turns */
    bool cuttable, rotation, one_body;       /* one_body: all parts are of one */
    bool (*is_held)(const double rest_m[3]); /* which vertices are held; null: none */
    int32_t threads;
    tm_touching_def touch;
    void (*add_tools)(bodies *b); /* null; else adds the stages of instruments before "touch" */
} setup;

static inline setup plain(void) {
    return (setup){.young_Pa = 5000, .damping_1_s = 60, .threads = 1, .touch = tm_touching_def_default()};
}

static inline void add_part(const part *p, double tilt_rad, double *vertex, int32_t *tet, int32_t *body, int32_t index,
                            int32_t *v, int32_t *t) {
    app_block block;
    const int32_t cells[3] = {p->cells[0], p->cells[1], p->cells[2]};
    assert_true(app_block_build(&block, cells, p->size_m));
    for (int32_t i = 0; i < block.vertex_count; i++) {
        const double *flat = block.vertex_m + 3 * i, up = cos(tilt_rad), aside = sin(tilt_rad);
        const double x[3] = {up * flat[0] + aside * flat[2], flat[1], up * flat[2] - aside * flat[0]};
        const double c = cos(p->turn_rad), s = sin(p->turn_rad);
        const double y[3] = {c * x[0] - s * x[1], s * x[0] + c * x[1], x[2]};
        for (int a = 0; a < 3; a++) vertex[3 * (*v + i) + a] = y[a] + p->at_m[a];
    }
    for (int32_t i = 0; i < 4 * block.tet_count; i++) tet[4 * *t + i] = block.tet[i] + *v;
    for (int32_t i = 0; i < block.tet_count; i++) body[*t + i] = index;
    *v += block.vertex_count, *t += block.tet_count;
    app_block_free(&block);
}

static inline bool at_base(const double rest_m[3]) { return fabs(rest_m[2]) < 1e-9; }

static inline void hold(bodies *b, bool (*is_held)(const double rest_m[3])) {
    int32_t *dof = malloc(sizeof *dof * 3 * (size_t)b->mesh->vertex_count), count = 0;
    double *zero = calloc((size_t)b->mesh->vertex_count * 3, sizeof *zero);
    for (int32_t v = 0; v < b->mesh->vertex_count; v++)
        for (int c = 0; c < 3 && is_held(b->mesh->rest_m + 3 * v); c++) dof[count++] = 3 * v + c;
    tm_support_def def = tm_support_def_default();
    def.count = count, def.dof = dof, def.value_m = zero;
    tm_error error;
    fix_ok(tm_stage_support(b->world, &def, &error), &error);
    free(dof), free(zero);
}

static inline void make_mesh(bodies *b, const part *p, const setup *s) {
    int32_t vertices = 0, tets = 0, v = 0, t = 0;
    for (int32_t i = 0; i < b->count; i++) {
        const int *c = p[i].cells;
        vertices += (c[0] + 1) * (c[1] + 1) * (c[2] + 1), tets += 6 * c[0] * c[1] * c[2];
    }
    double *vertex = malloc(sizeof *vertex * 3 * (size_t)vertices);
    int32_t *tet = malloc(sizeof *tet * 4 * (size_t)tets);
    b->tet_body = malloc(sizeof *b->tet_body * (size_t)tets);
    for (int32_t i = 0; i < b->count; i++) {
        b->body_begin[i] = v;
        add_part(p + i, s->tilt_rad, vertex, tet, b->tet_body, i, &v, &t);
    }
    b->body_begin[b->count] = v;
    tm_error error;
    tm_mesh_def mesh = tm_mesh_def_default();
    mesh.vertex_count = v, mesh.vertex_m = vertex, mesh.tet_count = t, mesh.tet = tet;
    fix_ok(tm_mesh_create(&mesh, &b->mesh, &error), &error);
    free(vertex), free(tet);
}

static inline void make_tissue(bodies *b, const setup *s) {
    tm_error error;
    tm_material material;
    fix_ok(tm_material_young(s->young_Pa, 0.4, &material, &error), &error);
    material.damping_1_s = s->damping_1_s;
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = b->mesh, tissue.material_count = 1, tissue.material = &material, tissue.cuttable = s->cuttable;
    tissue.form = TM_FORCE_PLAIN, tissue.rotation = s->rotation ? TM_ROTATION_THRESHOLD : 0;
    fix_ok(tm_tissue_create(&tissue, &b->tissue, &error), &error);
}

static inline bodies make(const part *p, int32_t count, const setup *s) {
    bodies b = {.count = count};
    tm_error error;
    make_mesh(&b, p, s);
    make_tissue(&b, s);
    tm_world_def world = tm_world_def_default();
    world.tissue = b.tissue, world.threads = s->threads, world.dt_s = s->step_s;
    fix_ok(tm_world_create(&world, &b.world, &error), &error);
    if (s->rotation) fix_ok(tm_stage_rotation(b.world, NULL, &error), &error);
    if (s->is_held) hold(&b, s->is_held);
    const double g[3] = {0, 0, -s->gravity_m_s2};
    if (s->gravity_m_s2 != 0) fix_ok(tm_stage_gravity(b.world, g, &error), &error);
    if (s->add_tools) s->add_tools(&b);
    tm_touching_def touch = s->touch;
    if (s->one_body) memset(b.tet_body, 0, sizeof *b.tet_body * (size_t)b.mesh->tet_count);
    touch.body_count = s->one_body ? 1 : count, touch.tet_body = b.tet_body, touch.mu_static = touch.mu_kinetic = s->mu;
    fix_ok(tm_stage_touch(b.world, &touch, &b.touching, &error), &error);
    return b;
}

/* A block that a cut opens like a mouth: a layer of cells is removed, except where the lips are joined. */
static inline bodies mouth(const setup *s) {
    const part p = {{12, 3, 5}, {0.06, 0.015, 0.025}, {0, 0, 0}, 0};
    bodies b = make(&p, 1, s);
    int32_t *gone = malloc(sizeof *gone * (size_t)b.mesh->tet_count), count = 0;
    for (int32_t t = 0; t < b.mesh->tet_count; t++) {
        double x = 0, z = 0;
        for (int j = 0; j < 4; j++) x += b.mesh->rest_m[3 * b.mesh->tet[4 * t + j]] / 4;
        for (int j = 0; j < 4; j++) z += b.mesh->rest_m[3 * b.mesh->tet[4 * t + j] + 2] / 4;
        if (x > 0.01 && z > 0.01 && z < 0.015) gone[count++] = t;
    }
    tm_cut_remove(b.tissue, gone, count, NULL, 0);
    free(gone);
    return b;
}

static inline void drop(bodies *b) {
    tm_world_destroy(b->world);
    tm_tissue_destroy(b->tissue);
    tm_mesh_destroy(b->mesh);
    free(b->tet_body);
}

static inline void throw_body(bodies *b, int32_t body, double vx, double vy, double vz) {
    const double v[3] = {vx, vy, vz};
    tm_state *s = tm_world_state(b->world);
    for (int32_t i = 3 * b->body_begin[body]; i < 3 * b->body_begin[body + 1]; i++)
        s->u_prev_m[i] = s->u_m[i] - s->dt_s * v[i % 3];
}

static inline void run(bodies *b, double seconds) {
    for (double until_s = tm_world_state(b->world)->time_s + seconds; tm_world_state(b->world)->time_s < until_s;)
        assert_int_equal(tm_world_step(b->world, 20), TM_OK);
}

static inline double kinetic_J(const bodies *b) {
    const tm_state *s = tm_world_state(b->world);
    double sum = 0;
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++) {
        const double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        sum += 0.5 * tm_tissue_mass_kg(b->tissue)[i / 3] * v * v;
    }
    return sum;
}

static inline void momentum(const bodies *b, double p[3]) {
    const tm_state *s = tm_world_state(b->world);
    p[0] = p[1] = p[2] = 0;
    for (int32_t i = 0; i < 3 * b->mesh->vertex_count; i++)
        p[i % 3] += tm_tissue_mass_kg(b->tissue)[i / 3] * (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
}

static inline double det(const double a[3], const double b[3], const double c[3]) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/* Returns whether a vertex of one body is inside a tetrahedron of another. Independent of contact rows. */
static inline bool is_inside_another(const bodies *b) {
    const double *u = tm_world_state(b->world)->u_m, *rest = b->mesh->rest_m;
    for (int32_t t = 0; t < b->mesh->tet_count; t++) {
        if (!b->tissue->alive[t]) continue;
        double x[4][3], e[3][3];
        for (int j = 0; j < 4; j++)
            for (int c = 0; c < 3; c++)
                x[j][c] = rest[3 * b->mesh->tet[4 * t + j] + c] + u[3 * b->mesh->tet[4 * t + j] + c];
        for (int j = 0; j < 3; j++)
            for (int c = 0; c < 3; c++) e[j][c] = x[j + 1][c] - x[0][c];
        for (int32_t v = 0; v < b->mesh->vertex_count; v++) {
            if (!(b->tissue->mass_kg[v] > 0)) continue;
            if (v >= b->body_begin[b->tet_body[t]] && v < b->body_begin[b->tet_body[t] + 1]) continue;
            double d[3], at[3];
            for (int c = 0; c < 3; c++) d[c] = rest[3 * v + c] + u[3 * v + c] - x[0][c];
            const double whole = det(e[0], e[1], e[2]);
            at[0] = det(d, e[1], e[2]) / whole, at[1] = det(e[0], d, e[2]) / whole;
            at[2] = det(e[0], e[1], d) / whole;
            if (at[0] > 0 && at[1] > 0 && at[2] > 0 && at[0] + at[1] + at[2] < 1) return true;
        }
    }
    return false;
}

/* Of the fields alone: the bytes between `vertex` and `weight` belong to none. */
static inline uint64_t hash_of_rows(const tm_touching_row *row, int32_t count, uint64_t hash) {
    const size_t indices = offsetof(tm_touching_row, vertex) + sizeof row->vertex;
    const size_t numbers = offsetof(tm_touching_row, weight);
    for (int32_t i = 0; i < count; i++) {
        const char *at = (const char *)(row + i);
        hash = tm_hash(at, indices, hash);
        hash = tm_hash(at + numbers, sizeof *row - numbers, hash);
    }
    return hash;
}

#endif
