/* The generated liver, read directly from its .msh (Gmsh 2.2 text), supported at vena cava and ligament. */
#ifndef SOLVE_ORGAN_H
#define SOLVE_ORGAN_H

#include "kit.h"

#include <unistd.h>

typedef struct organ {
    tm_mesh *mesh;
    uint8_t *fixed; /* [3*vertex_count] */
} organ;

static inline void organ_skip_to(FILE *f, const char *section) {
    char word[256];
    while (fscanf(f, "%255s", word) == 1)
        if (!strcmp(word, section)) return;
    fail_msg("no %s in a mesh", section);
}

/* Loads "1k", "10k" (committed) or "50k" (generated here if it does not exist). */
static inline organ organ_read(const char *size) {
    const char *root = getenv("TM_ROOT") ? getenv("TM_ROOT") : ".",
               *out = getenv("TM_OUT") ? getenv("TM_OUT") : "build";
    char path[600], make[2000];
    const bool large = !strcmp(size, "50k");
    snprintf(path, sizeof path, "%s/meshes/liver_%s.msh", large ? out : root, size);
    /* In this build's folder: a sanitizer's differs from that of `make meshes`. */
    snprintf(make, sizeof make,
             "make -s -C '%s' MESHES_DIR=\"$(realpath -m '%s/meshes')\" \"$(realpath -m '%s')\" >/dev/null", root, out,
             path);
    if (large && access(path, R_OK) && system(make)) fail_msg("%s could not be made", path);
    FILE *f = fopen(path, "r");
    if (!f) fail_msg("%s cannot be opened; run from the repository's root or set TM_ROOT", path);
    int count, tets = 0, tag, type, tags, number[16];
    organ_skip_to(f, "$Nodes");
    assert_int_equal(fscanf(f, "%d", &count), 1);
    double *vertex = malloc(24 * (size_t)count);
    for (int v = 0; v < count; v++)
        assert_int_equal(fscanf(f, "%d %lf %lf %lf", &tag, vertex + 3 * v, vertex + 3 * v + 1, vertex + 3 * v + 2), 4);
    organ o = {.fixed = calloc(3 * (size_t)count, 1)};
    int elements;
    organ_skip_to(f, "$Elements");
    assert_int_equal(fscanf(f, "%d", &elements), 1);
    int32_t *tet = malloc(16 * (size_t)elements);
    for (int e = 0; e < elements; e++) {
        assert_int_equal(fscanf(f, "%d %d %d", &tag, &type, &tags), 3);
        const int corners = type == 4 ? 4 : 3;
        for (int i = 0; i < tags + corners; i++) assert_int_equal(fscanf(f, "%d", number + i), 1);
        for (int i = 0; i < corners; i++) {
            const int v = number[tags + i] - 1;
            if (type == 4)
                tet[4 * tets + i] = v;
            else if (number[0] == 2 || number[0] == 3)
                o.fixed[3 * v] = o.fixed[3 * v + 1] = o.fixed[3 * v + 2] = 1;
        }
        tets += type == 4;
    }
    fclose(f);
    tm_mesh_def def = tm_mesh_def_default();
    tm_error error;
    def.vertex_count = count, def.vertex_m = vertex, def.tet_count = tets, def.tet = tet;
    fix_ok(tm_mesh_create(&def, &o.mesh, &error), &error);
    free(vertex), free(tet);
    return o;
}

static inline void organ_free(organ *o) {
    tm_mesh_destroy(o->mesh);
    free(o->fixed);
}

#endif
