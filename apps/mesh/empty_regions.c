/* Regions that a mesh file names without a tetrahedron in them: a scene that gives one a material is refused, and
 * usually a label or a volume was lost on the way. */
#include <string.h>

#include "command.h"

static bool has_tetrahedra(const tm_mesh_file *mesh, const char *name) {
    for (int32_t t = 0; t < mesh->tet_count; t++)
        if (!strcmp(mesh->region_name[mesh->region[t]], name)) return true;
    return false;
}

static int32_t add(const tm_mesh_file *mesh, const char *name, char found[REGIONS_WITHOUT][64], int32_t count) {
    if (!*name || count == REGIONS_WITHOUT || has_tetrahedra(mesh, name)) return count;
    for (int32_t i = 0; i < count; i++)
        if (!strcmp(found[i], name)) return count;
    snprintf(found[count], sizeof found[count], "%s", name);
    return count + 1;
}

/* The reader drops names that no element carries: they are looked for in the file's head. */
static int32_t read_names(const tm_mesh_file *mesh, const char *path, char found[REGIONS_WITHOUT][64], int32_t count) {
    const size_t length = strlen(path);
    if (length < 4 || strcmp(path + length - 4, ".msh") != 0) return count;
    FILE *file = fopen(path, "rb");
    char line[300], name[64];
    bool inside = false;
    while (file && fgets(line, sizeof line, file) && strncmp(line, "$Nodes", 6) && strncmp(line, "$EndPhysical", 12)) {
        int dimension, number;
        if (inside && sscanf(line, "%d %d \"%63[^\"]\"", &dimension, &number, name) == 3 && dimension == 3)
            count = add(mesh, name, found, count);
        inside = inside || !strncmp(line, "$PhysicalNames", 14);
    }
    if (file) fclose(file);
    return count;
}

int32_t find_empty_regions(const tm_mesh_file *mesh, const char *path, char name[REGIONS_WITHOUT][64]) {
    int32_t count = 0;
    for (int32_t r = 0; r < mesh->region_count; r++) count = add(mesh, mesh->region_name[r], name, count);
    return read_names(mesh, path, name, count);
}
