/* What looks at a .msh before Gmsh does (text and binary, 2.2 and 4.1), and the reader of VTK 5. Refused with a
 * message, or tags that are all different. */
#include "common/mesh_parts.h"
#include "fuzz.h"

static int by_value(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static void all_different(int64_t *tag, int64_t count) {
    if (count > 1) qsort(tag, (size_t)count, sizeof *tag, by_value);
    for (int64_t i = 1; i < count; i++) PROMISE(tag[i] != tag[i - 1]);
}

static void read_vtk(const char *text, size_t size) {
    app_mesh_scan scan = {0};
    app_mesh mesh = {0};
    tm_error error = {0};
    if (app_mesh_read_vtk(text, size, &scan, &mesh, &error) == TM_OK) {
        for (int32_t i = 0; i < 4 * mesh.tet_count; i++) PROMISE(mesh.tet[i] >= 0 && mesh.tet[i] < mesh.vertex_count);
        PROMISE(scan.vertex_count >= mesh.vertex_count && mesh.tet_count > 0);
        all_different(mesh.vertex_tag, mesh.vertex_count);
        all_different(mesh.tet_tag, mesh.tet_count);
        app_mesh_free(&mesh);
    } else
        PROMISE(error.message[0] && strchr(error.message, ';'));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1);
    if (size) memcpy(text, data, size);
    text[size] = 0;
    app_mesh_scan scan;
    tm_error error = {0};
    if (text[0] == '#')
        read_vtk(text, size);
    else if (app_mesh_scan_msh(text, size, &scan, &error) == TM_OK) {
        all_different(scan.vertex_tag, scan.vertex_count);
        all_different(scan.tet_tag, scan.tet_count);
        app_mesh_scan_free(&scan);
    } else
        PROMISE(error.message[0] && strchr(error.message, ';'));
    free(text);
    return 0;
}
