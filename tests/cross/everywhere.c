/* Checks on another machine than the builder's: alignment of memory, a mesh written and read, the SIMD form against
 * the plain one, and the controller's core. Prints the same text on all platforms. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hrt.h"
#include "tensormass.h"
#include "tensormass_io.h"

static int fail(const char *what) {
    printf("failed: %s\n", what);
    return 1;
}

/* Writes four by four by four boxes of six tetrahedra as `path` and reads them back. */
static tm_mesh *mesh_through(const char *path) {
    static const int way[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}},
                     step[3] = {1, 5, 25};
    tm_mesh_file made = {.vertex_count = 125, .tet_count = 384, .region_count = 1}, read;
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    if (!tm_mesh_file_allocate(&made, 0)) return NULL;
    for (int v = 0, t = 0; v < 125; v++) {
        for (int c = 0; c < 3; c++) made.vertex_m[3 * v + c] = 0.01 * (v / step[c] % 5) * (1 + 0.03 * (v % 7));
        for (int w = 0; w < 6 && v % 5 < 4 && v / 5 % 5 < 4 && v / 25 < 4; w++, t++) {
            int32_t *at = made.tet + 4 * t;
            at[0] = v;
            for (int i = 0; i < 3; i++) at[i + 1] = at[i] + step[way[w][i]];
            if (w > 2) { /* odd permutations have the opposite orientation */
                const int32_t odd = at[1];
                at[1] = at[2], at[2] = odd;
            }
            made.tet_tag[t] = t + 1;
        }
        made.vertex_tag[v] = v + 1;
    }
    FILE *file = fopen(path, "wb");
    if (!file || tm_mesh_file_write(&made, path, file, &error) || fclose(file)) return NULL;
    if (tm_mesh_file_load(path, 1, &read, &error)) return printf("%s\n", error.message), NULL;
    if (memcmp(read.vertex_m, made.vertex_m, 375 * sizeof(double))) return NULL; /* to the bit */
    tm_mesh_file_build(&read, &mesh, &error);
    tm_mesh_file_free(&read);
    tm_mesh_file_free(&made);
    remove(path);
    return mesh;
}

/* Computes forces of a stretched tissue by this form of the loop. */
static int forces(const tm_mesh *mesh, tm_force_form form, tm_precision precision, double *force_N) {
    tm_error error;
    tm_material material;
    tm_tissue *tissue = NULL;
    tm_tissue_def def = tm_tissue_def_default();
    if (tm_material_young(5e3, 0.45, &material, &error)) return 0;
    def.mesh = mesh, def.material_count = 1, def.material = &material, def.form = form, def.precision = precision;
    if (tm_tissue_create(&def, &tissue, &error)) return 0;
    double u_m[375];
    for (int i = 0; i < 375; i++) u_m[i] = 1e-4 * ((i * 37) % 41 - 20);
    tm_tissue_force(tissue, u_m, force_N);
    tm_tissue_destroy(tissue);
    return 1;
}

static void core(void) {
    static hrt_controller controller;
    hrt_params params;
    hrt_axes axes;
    hrt_result result = {0};
    hrt_input input;
    memset(&input, 0, sizeof input);
    const float axis[3] = {0.3f, -0.2f, -1}, up[3] = {0, 1, 0}, joint[HRT_JOINTS] = {0.1f, -0.2f, 0.05f};
    float tip[3], jacobian[9];
    hrt_params_default(&params);
    hrt_axes_along(&axes, hrt_device_types[0], axis, up);
    hrt_tip(&axes, joint, tip);
    hrt_jacobian(&axes, joint, jacobian);
    printf("tip %.5f %.5f %.5f m, jacobian %.4f %.4f\n", (double)tip[0], (double)tip[1], (double)tip[2],
           (double)jacobian[0], (double)jacobian[8]);
    hrt_init(&controller, &params, &axes, 1);
    for (int i = 0; i < 500; i++) hrt_tick(&controller, 2000 * (int64_t)i, &input, NULL, &result);
    printf("controller %s, force at most %.2f N\n", hrt_state_name(controller.state), (double)params.force_max_N);
}

int main(int count, char **word) {
    if (count != 2) return fail("usage: everywhere SCRATCH.msh");
    for (size_t bytes = 1; bytes < 5000; bytes = 3 * bytes + 1) {
        void *memory = tm_allocate(bytes);
        if (!memory || (uintptr_t)memory % 64) return fail("alignment");
        tm_release(memory, bytes);
    }
    tm_mesh *mesh = mesh_through(word[1]);
    if (!mesh) return fail("mesh");
    double plain[375], best[375];
    for (int p = 0; p < 2; p++) { /* single first: the printed figures are those of double */
        const tm_precision precision = p ? TM_DOUBLE : TM_SINGLE;
        double most = 0, apart = 0;
        if (!forces(mesh, TM_FORCE_PLAIN, precision, plain) || !forces(mesh, TM_FORCE_BEST, precision, best))
            return fail("forces");
        for (int i = 0; i < 375; i++) most = fmax(most, fabs(plain[i])), apart = fmax(apart, fabs(plain[i] - best[i]));
        if (!(apart < 1e-12 * most)) return fail("forms of the force loop"); /* sums are computed in double in both */
    }
    printf("version %s, forces %016llx\n", tm_version(),
           (unsigned long long)tm_hash(plain, sizeof plain, TM_HASH_SEED));
    tm_mesh_destroy(mesh);
    core();
    tm_mesh_file file;
    tm_error error;
    if (tm_mesh_file_load("nowhere/a.msh", 1, &file, &error) != TM_ERR_FILE) return fail("a file that is not there");
    printf("%s\n", error.message);
    return tm_memory_in_use() != 0;
}
