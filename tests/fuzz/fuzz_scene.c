/* Scenes: rejected (2) with a message, or read; a scene that fits a small block is built and destroyed. */
#include "app.h"
#include "common/program_host.h"
#include "fuzz.h"
#include "scene/sim.h"
#include "tensormass_io.h"

static char mesh_path[200], set_mesh[240];

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    tm_mesh_file mesh;
    tm_error error = {0};
    char folder[300];
    snprintf(folder, sizeof folder, "%s/cache", fuzz_folder());
    setenv("TM_CACHE_DIR", folder, 1);
    const char *root = getenv("TM_ROOT");
    snprintf(mesh_path, sizeof mesh_path, "%s/meshes/block_1k.msh", root ? root : ".");
    snprintf(set_mesh, sizeof set_mesh, "tissue.mesh=%s", mesh_path);
    if (tm_mesh_file_load(mesh_path, 1, &mesh, &error))
        fprintf(stderr, "%s: %s\n", mesh_path, error.message), exit(1); /* now it is in the cache */
    tm_mesh_file_free(&mesh);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (memchr(data, 0, size)) return -1;
    const char *path = fuzz_file(data, size, ".yaml");
    app_scene *scene = NULL;
    int rc = app_exit_code(sim_scene_load(path, NULL, 0, app_program_host(), &scene));
    PROMISE(rc == APP_DONE || rc == APP_BAD_INPUT);
    if (rc) return 0;
    bool writes = scene->mesh.s[0] == 0 || memmem(data, size, "file", 4) || memmem(data, size, "hybrid", 6) ||
                  memmem(data, size, "precomputed", 11);
    app_scene_free(scene);
    if (writes) return 0; /* it names its own files */
    char *set[] = {set_mesh, "tissue.scale=1"};
    rc = app_exit_code(sim_scene_load(path, set, 2, app_program_host(), &scene));
    PROMISE(rc == APP_DONE || rc == APP_BAD_INPUT);
    sim *s = NULL;
    if (rc) return 0;
    rc = app_exit_code(sim_create(scene, &s));
    PROMISE(rc == APP_DONE || rc == APP_BAD_INPUT || rc == APP_FAILED);
    if (rc == APP_DONE) sim_destroy(s);
    return 0;
}
