/* Converts between the mesh file's vertex numbers and those of the mesh. */
#include <stdlib.h>

#include "sim.h"

void sim_vertices_of_file(const sim *s, int32_t *vertex) {
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) vertex[tm_mesh_original_vertex(s->mesh, v)] = v;
}

tm_status sim_select(const sim *s, const app_select *select, int line, uint8_t *mark, int32_t *count) {
    if (!s->mesh->original_vertex) return app_select_vertices(s->scene, select, line, &s->file, mark, count);
    uint8_t *in_file = malloc((size_t)s->file.vertex_count);
    if (!in_file) return app_scene_fail(s->scene, line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    const tm_status rc = app_select_vertices(s->scene, select, line, &s->file, in_file, count);
    for (int32_t v = 0; v < s->mesh->vertex_count && !rc; v++) mark[v] = in_file[tm_mesh_original_vertex(s->mesh, v)];
    free(in_file);
    return rc;
}
