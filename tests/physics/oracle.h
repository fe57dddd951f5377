/* Reference solutions of physics/oracle (README.md there): material, mesh, loads, displacements. */
#ifndef TM_TEST_ORACLE_H
#define TM_TEST_ORACLE_H

#include "../fixture.h"

typedef struct oracle {
    double lame[5], engineering[5], fibre[3], density, g[3], press[3], poke[3], clamp[3][3], tip[3][3], energy[3];
    int poke_vertex;
    int32_t vertex_count, tet_count;
    double *vertex;
    int32_t *tet;
    double *u[3];
    tm_mesh *mesh;
} oracle;

static inline void word(FILE *file, const char *expected) {
    char got[32];
    assert_int_equal(fscanf(file, "%31s", got), 1);
    assert_string_equal(got, expected);
}
static inline void numbers(FILE *file, double *to, int count) {
    for (int i = 0; i < count; i++) assert_int_equal(fscanf(file, "%lf", to + i), 1);
}

static inline void oracle_load(const char *name, oracle *o) {
    char path[512];
    const char *root = getenv("TM_ROOT");
    snprintf(path, sizeof path, "%s/tests/physics/oracle/%s.txt", root ? root : ".", name);
    FILE *file = fopen(path, "r");
    if (!file) fail_msg("%s cannot be opened; run from the repository's root or set TM_ROOT", path);
    static const char *const kase[3] = {"gravity", "press", "poke"};
    word(file, "material"), numbers(file, o->lame, 5);
    word(file, "engineering"), numbers(file, o->engineering, 5);
    word(file, "fibre"), numbers(file, o->fibre, 3);
    word(file, "gravity"), numbers(file, &o->density, 1), numbers(file, o->g, 3);
    word(file, "press"), numbers(file, o->press, 3);
    word(file, "poke"), assert_int_equal(fscanf(file, "%d", &o->poke_vertex), 1), numbers(file, o->poke, 3);
    for (int i = 0; i < 3; i++)
        word(file, kase[i]), numbers(file, o->clamp[i], 3), numbers(file, o->tip[i], 3),
            numbers(file, o->energy + i, 1);
    word(file, "vertices"), assert_int_equal(fscanf(file, "%d", &o->vertex_count), 1);
    o->vertex = malloc(sizeof(double) * 3 * (size_t)o->vertex_count);
    numbers(file, o->vertex, 3 * o->vertex_count);
    word(file, "tets"), assert_int_equal(fscanf(file, "%d", &o->tet_count), 1);
    o->tet = malloc(sizeof(int32_t) * 4 * (size_t)o->tet_count);
    for (int i = 0; i < 4 * o->tet_count; i++) assert_int_equal(fscanf(file, "%d", o->tet + i), 1);
    for (int i = 0; i < 3; i++) {
        word(file, "displacements"), word(file, kase[i]);
        o->u[i] = malloc(sizeof(double) * 3 * (size_t)o->vertex_count);
        numbers(file, o->u[i], 3 * o->vertex_count);
    }
    fclose(file);
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = o->vertex_count, def.vertex_m = o->vertex, def.tet_count = o->tet_count, def.tet = o->tet;
    tm_error error;
    fix_ok(tm_mesh_create(&def, &o->mesh, &error), &error);
}

static inline void oracle_unload(oracle *o) {
    tm_mesh_destroy(o->mesh);
    free(o->vertex), free(o->tet);
    for (int i = 0; i < 3; i++) free(o->u[i]);
}

#endif
