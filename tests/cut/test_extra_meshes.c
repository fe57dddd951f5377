/* Removes the meshes of the folder TM_EXTRA_MESHES piece by piece in 20 random orders. Skipped without that folder. */
#include "organ.h"

#include <dirent.h>

static int by_name(const void *a, const void *b) { return strcmp(a, b); }

static void extra_meshes(void **state) {
    (void)state;
    const char *folder = getenv("TM_EXTRA_MESHES");
    static char path[256][600];
    int count = 0;
    DIR *dir = opendir(folder);
    if (!dir) fail_msg("TM_EXTRA_MESHES=%s cannot be opened", folder);
    for (struct dirent *entry; (entry = readdir(dir)) && count < 256;) {
        const char *dot = strrchr(entry->d_name, '.');
        if (dot && (!strcmp(dot, ".msh") || !strcmp(dot, ".vtk") || !strcmp(dot, ".mesh")))
            snprintf(path[count++], sizeof *path, "%s/%s", folder, entry->d_name);
    }
    closedir(dir);
    qsort(path, (size_t)count, sizeof *path, by_name);
    int accepted = 0;
    for (int i = 0; i < count; i++) accepted += organ_cut_down(path[i], ORDERS, 30, false);
    print_message("  %d of %d meshes cut\n", accepted, count);
    assert_true(accepted > 0);
}

int main(void) {
    const char *folder = getenv("TM_EXTRA_MESHES");
    if (!folder || !*folder) {
        printf("TM_EXTRA_MESHES names no folder of meshes\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {cmocka_unit_test(extra_meshes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
