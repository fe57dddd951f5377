#include <stdlib.h>
#include <string.h>

#include "tensormass_io.h"

bool tm_mesh_file_subset(tm_mesh_file *mesh, const uint8_t *keep, int32_t *kept) {
    tm_mesh_file out = *mesh;
    int32_t *place = malloc(((size_t)mesh->vertex_count + 1) * sizeof *place), members = 0;
    if (!place) return false;
    memset(place, -1, ((size_t)mesh->vertex_count + 1) * sizeof *place);
    out.tet_count = out.vertex_count = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++)
        for (int k = 0; keep[t] && k < 4; k++) place[mesh->tet[4 * (size_t)t + (size_t)k]] = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        if (place[v] == 0) place[v] = out.vertex_count++;
    for (int32_t t = 0; t < mesh->tet_count; t++) out.tet_count += keep[t] != 0;
    for (int32_t i = 0; i < mesh->group_begin[mesh->group_count]; i++) members += place[mesh->group_vertex[i]] >= 0;
    if (!tm_mesh_file_allocate(&out, members)) {
        free(place);
        return false;
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        if (place[v] < 0) continue;
        memcpy(out.vertex_m + 3 * (size_t)place[v], mesh->vertex_m + 3 * (size_t)v, 3 * sizeof(double));
        out.vertex_tag[place[v]] = mesh->vertex_tag[v];
    }
    for (int32_t t = 0, n = 0; t < mesh->tet_count; t++) {
        if (!keep[t]) continue;
        for (int k = 0; k < 4; k++) out.tet[4 * (size_t)n + (size_t)k] = place[mesh->tet[4 * (size_t)t + (size_t)k]];
        out.tet_tag[n] = mesh->tet_tag[t];
        out.region[n] = mesh->region[t];
        if (kept) kept[n] = t;
        n++;
    }
    memcpy(out.region_name, mesh->region_name, (size_t)mesh->region_count * sizeof *out.region_name);
    memcpy(out.group_name, mesh->group_name, (size_t)mesh->group_count * sizeof *out.group_name);
    for (int32_t g = 0, n = 0; g < mesh->group_count; g++) {
        for (int32_t i = mesh->group_begin[g]; i < mesh->group_begin[g + 1]; i++)
            if (place[mesh->group_vertex[i]] >= 0) out.group_vertex[n++] = place[mesh->group_vertex[i]];
        out.group_begin[g + 1] = n;
    }
    free(place);
    out.path = mesh->path;
    mesh->path = NULL;
    tm_mesh_file_free(mesh);
    *mesh = out;
    return true;
}
