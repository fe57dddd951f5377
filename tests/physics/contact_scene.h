/* A block of soft tissue with its bottom fixed and a tool above it, for the contact tests. */
#ifndef CONTACT_SCENE_H
#define CONTACT_SCENE_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/random.h"
#include "tensormass.h"

typedef struct scene_def {
    int cells[3];
    double size_m[3];
    double jitter; /* jitter of inner and surface vertices within their plane, in cells */
    double young_Pa, poisson, damping_1_s;
    double row_compliance_m_N; /* negative: the default */
    int tools;
    double trocar_m[2][3], tip_m[2][3];
    double radius_m, length_m;
    bool is_free;    /* tools without trocars */
    tm_law_kind law; /* nonlinear: with the constants of scene_law; fibres along x */
    bool averaged;   /* strain smoothing */
    double bulge_m;  /* height by which the middle of the top is raised, so that it is curved */
    tm_precision precision;
    tm_force_form form;
    int32_t threads;               /* 0: one thread */
    tm_parallel_for *parallel_for; /* null: the library's allocator */
} scene_def;

typedef struct scene {
    scene_def def;
    tm_mesh *mesh;
    tm_material material;
    tm_tissue *tissue;
    tm_world *world;
    tm_contact *contact;
} scene;

static uint64_t scene_seed = 1;
static double scene_random(void) { /* Returns a number in [0,1), the same on all platforms. */
    return num_unit(num_random64(&scene_seed));
}

static void scene_must(tm_status status, const tm_error *error) {
    if (status != TM_OK) {
        fprintf(stderr, "scene: %s\n", error->message);
        exit(1);
    }
}

static inline scene_def scene_def_default(void) {
    return (scene_def){.cells = {12, 12, 7},
                       .size_m = {0.072, 0.072, 0.042},
                       .jitter = 0.2,
                       .young_Pa = 5000,
                       .poisson = 0.45,
                       .damping_1_s = 100,
                       .row_compliance_m_N = -1,
                       .tools = 1,
                       .trocar_m = {{0, 0, 0.25}, {0, 0, 0.25}},
                       .tip_m = {{0.01, 0.005, 0.06}, {-0.01, 0.005, 0.06}},
                       .radius_m = 0.0025,
                       .length_m = 0.1};
}

/* Makes six tetrahedra per cell; x and y about 0, z from 0 up; vertices are displaced at random within the block's
 * faces. */
static tm_mesh *scene_mesh(const scene_def *d) {
    int nx = d->cells[0] + 1, ny = d->cells[1] + 1, nz = d->cells[2] + 1,
        tets = 6 * d->cells[0] * d->cells[1] * d->cells[2];
    double *vertex = malloc(sizeof(double) * 3 * (size_t)(nx * ny * nz));
    int32_t *tet = malloc(sizeof(int32_t) * 4 * (size_t)tets), n = 0;
    static const int path[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    scene_seed = 7;
    for (int k = 0; k < nz; k++)
        for (int j = 0; j < ny; j++)
            for (int i = 0; i < nx; i++) {
                int at[3] = {i, j, k};
                double *v = vertex + 3 * ((k * ny + j) * nx + i);
                for (int c = 0; c < 3; c++) {
                    double shift = d->jitter * (2 * scene_random() - 1);
                    v[c] = d->size_m[c] * (at[c] + (at[c] > 0 && at[c] < d->cells[c] ? shift : 0)) / d->cells[c];
                    if (c < 2) v[c] -= d->size_m[c] / 2;
                }
                double x = 2 * v[0] / d->size_m[0], y = 2 * v[1] / d->size_m[1];
                v[2] += d->bulge_m * (1 - x * x) * (1 - y * y) * v[2] / d->size_m[2];
            }
    for (int k = 0; k < d->cells[2]; k++)
        for (int j = 0; j < d->cells[1]; j++)
            for (int i = 0; i < d->cells[0]; i++)
                for (int p = 0; p < 6; p++) {
                    int at[3] = {i, j, k};
                    int32_t *t = tet + 4 * n++;
                    t[0] = (at[2] * ny + at[1]) * nx + at[0];
                    for (int s = 0; s < 3; s++) {
                        at[path[p][s]]++;
                        t[s + 1] = (at[2] * ny + at[1]) * nx + at[0];
                    }
                    if (p == 1 || p == 2 || p == 5) { /* odd permutations are left-handed */
                        int32_t swap = t[2];
                        t[2] = t[3];
                        t[3] = swap;
                    }
                }
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = nx * ny * nz;
    def.vertex_m = vertex;
    def.tet_count = tets;
    def.tet = tet;
    tm_mesh *mesh;
    tm_error error;
    scene_must(tm_mesh_create(&def, &mesh, &error), &error);
    free(vertex);
    free(tet);
    return mesh;
}

static void scene_support(scene *s) {
    int32_t *dof = malloc(sizeof(int32_t) * 3 * (size_t)s->mesh->vertex_count);
    double *value = calloc((size_t)(3 * s->mesh->vertex_count), sizeof(double));
    tm_support_def def = tm_support_def_default();
    tm_error error;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++)
        for (int c = 0; c < 3 && s->mesh->rest_m[3 * v + 2] < 1e-9; c++) dof[def.count++] = 3 * v + c;
    def.dof = dof;
    def.value_m = value;
    scene_must(tm_stage_support(s->world, &def, &error), &error);
    free(dof);
    free(value);
}

static inline void scene_law(tm_material *m, tm_law_kind law) {
    tm_error error;
    const double holzapfel[TM_LAW_CONSTANTS] = {4e3, 0.8, 0.1};
    if (law != TM_LAW_LINEAR)
        scene_must(tm_material_set_law(m, law, law == TM_LAW_HOLZAPFEL ? holzapfel : NULL, 0, &error), &error);
}

static inline scene scene_create_full(const scene_def *d, bool cuttable, const tm_tool_mode mode[2]) {
    scene s = {.def = *d};
    tm_error error;
    s.mesh = scene_mesh(d);
    scene_must(tm_material_young(d->young_Pa, d->poisson, &s.material, &error), &error);
    s.material.damping_1_s = d->damping_1_s;
    scene_law(&s.material, d->law);
    double *fibre = malloc(sizeof(double) * 3 * (size_t)s.mesh->tet_count);
    for (int32_t i = 0; i < 3 * s.mesh->tet_count; i++) fibre[i] = i % 3 == 0;
    tm_tissue_def tissue = tm_tissue_def_default();
    tissue.mesh = s.mesh;
    if (d->law == TM_LAW_HOLZAPFEL) tissue.fibre = fibre;
    if (d->averaged) tissue.strain_smoothing = true, tissue.smoothed_shear_share = 0;
    tissue.material_count = 1;
    tissue.material = &s.material;
    tissue.cuttable = cuttable;
    tissue.precision = d->precision;
    tissue.form = d->form;
    scene_must(tm_tissue_create(&tissue, &s.tissue, &error), &error);
    free(fibre);
    tm_world_def world = tm_world_def_default();
    world.tissue = s.tissue;
    if (d->threads > 0) world.threads = d->threads;
    world.parallel_for = d->parallel_for;
    scene_must(tm_world_create(&world, &s.world, &error), &error);
    scene_support(&s);
    tm_instrument_def tool[2];
    for (int t = 0; t < d->tools; t++) {
        tool[t] = (tm_instrument_def){.mode = mode ? mode[t] : TM_TOOL_PROBE,
                                      .is_free = d->is_free,
                                      .radius_m = d->radius_m,
                                      .contact_length_m = d->length_m};
        memcpy(tool[t].trocar_m, d->trocar_m[t], sizeof tool[t].trocar_m);
        memcpy(tool[t].pose.tip_m, d->tip_m[t], sizeof tool[t].pose.tip_m);
        tool[t].pose.active = true;
    }
    tm_contact_def contact = tm_contact_def_default();
    contact.instrument_count = d->tools;
    contact.instrument = tool;
    if (d->row_compliance_m_N >= 0) contact.contact_compliance_m_N = d->row_compliance_m_N;
    scene_must(tm_stage_contact(s.world, &contact, &s.contact, &error), &error);
    return s;
}

/* Makes a block large enough to be divided among 8 threads, with a cautery that cuts (tool 0) and a grasper. */
static inline scene scene_create_divided(tm_force_form form, tm_precision precision, int32_t threads,
                                         tm_parallel_for *parallel_for) {
    static const tm_tool_mode mode[2] = {TM_TOOL_CAUTERY, TM_TOOL_GRASPER};
    scene_def def = scene_def_default();
    def.cells[0] = def.cells[1] = 17, def.cells[2] = 10, def.tools = 2;
    def.form = form, def.precision = precision, def.threads = threads, def.parallel_for = parallel_for;
    scene s = scene_create_full(&def, true, mode);
    tm_error error;
    tm_cut_def cut = tm_cut_def_default();
    cut.rate_1_s = 2000;
    scene_must(tm_stage_cut(s.world, s.contact, &cut, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    scene_must(tm_stage_grasp(s.world, s.contact, &grasp, &(tm_grasp *){NULL}, &error), &error);
    return s;
}

static inline scene scene_create(const scene_def *d) { return scene_create_full(d, false, NULL); }

static inline void scene_destroy(scene *s) {
    tm_world_destroy(s->world);
    tm_tissue_destroy(s->tissue);
    tm_mesh_destroy(s->mesh);
}

static inline tm_tool_pose scene_pose(double x, double y, double z) {
    return (tm_tool_pose){.tip_m = {x, y, z}, .active = true};
}

/* Runs one frame of `frame_s` in which the tip moves straight to `to`; averages over its second half. */
static inline tm_tool_reaction scene_frame(scene *s, int32_t tool, tm_tool_pose to, double frame_s) {
    int32_t substeps = (int32_t)ceil(frame_s / tm_world_step_s(s->world));
    tm_contact_begin_frame(s->contact, substeps, substeps);
    tm_contact_set_target(s->contact, tool, &to, substeps);
    if (tm_world_step(s->world, substeps) != TM_OK) fprintf(stderr, "scene: the step is unstable\n"), exit(1);
    return tm_contact_reaction(s->contact, tool);
}

#endif
