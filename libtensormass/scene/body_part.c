/* A body that is one of several separate parts of a mesh file: all tetrahedra that are connected with a vertex of the
 * group that it names. */
#include <stdlib.h>
#include <string.h>

#include "bodies.h"
#include "libtensormass/numeric/union_find.h"
#include "scene_parts.h"

/* Joins the vertices of each tetrahedron. */
static void connect(const tm_mesh_file *file, int32_t *parent) {
    for (int32_t v = 0; v < file->vertex_count; v++) parent[v] = v;
    for (int32_t t = 0; t < file->tet_count; t++)
        for (int k = 1; k < 4; k++) law_join(parent, file->tet[4 * (int64_t)t], file->tet[4 * (int64_t)t + k]);
}

/* Marks the tetrahedra to keep. Returns their number. */
static int32_t mark(const tm_mesh_file *file, int32_t group, int32_t *parent, uint8_t *wanted, uint8_t *keep) {
    int32_t count = 0;
    connect(file, parent);
    for (int32_t i = file->group_begin[group]; i < file->group_begin[group + 1]; i++)
        wanted[law_root(parent, file->group_vertex[i])] = 1;
    for (int32_t t = 0; t < file->tet_count; t++) {
        keep[t] = wanted[law_root(parent, file->tet[4 * (int64_t)t])];
        count += keep[t];
    }
    return count;
}

/* Regions and groups of other parts are none of the body. */
static void drop_empty(tm_mesh_file *file, int32_t *place) {
    int32_t regions = 0, groups = 0;
    for (int32_t r = 0; r < file->region_count; r++) place[r] = -1;
    for (int32_t t = 0; t < file->tet_count; t++) place[file->region[t]] = 0;
    for (int32_t r = 0; r < file->region_count; r++) {
        if (place[r] < 0) continue;
        memmove(file->region_name[regions], file->region_name[r], sizeof *file->region_name);
        place[r] = regions++;
    }
    for (int32_t t = 0; t < file->tet_count; t++) file->region[t] = place[file->region[t]];
    for (int32_t g = 0; g < file->group_count; g++) {
        if (file->group_begin[g] == file->group_begin[g + 1]) continue;
        memmove(file->group_name[groups], file->group_name[g], sizeof *file->group_name);
        file->group_begin[++groups] = file->group_begin[g + 1];
    }
    file->region_count = regions, file->group_count = groups;
}

static tm_status refuse(const app_scene *scene, const app_body *body, const tm_mesh_file *file) {
    char names[512];
    app_list_names((const char(*)[64])file->group_name, file->group_count, names);
    return app_scene_bad(scene, body->part.line, "bodies.%s.part: the mesh has no region or group '%s'; it has: %s",
                         body->name.s, body->part.s, names);
}

tm_status sim_take_part(const app_scene *scene, const app_body *body, tm_mesh_file *file) {
    const int32_t group = app_find_group(file, body->part.s);
    if (group < 0) return refuse(scene, body, file);
    const size_t vertices = (size_t)file->vertex_count + 1, tets = (size_t)file->tet_count + 1;
    int32_t *parent = malloc(sizeof *parent * (vertices + (size_t)file->region_count));
    uint8_t *wanted = calloc(vertices + tets, 1), *keep = wanted ? wanted + vertices : NULL;
    tm_status rc = 0;
    if (!parent || !wanted)
        rc = app_scene_fail(scene, body->part.line, TM_ERR_MEMORY, "out of memory; use smaller meshes");
    else if (!mark(file, group, parent, wanted, keep))
        rc = app_scene_bad(scene, body->part.line,
                           "bodies.%s.part: no tetrahedron has a vertex of '%s'; name a region or group of tissue",
                           body->name.s, body->part.s);
    else if (!tm_mesh_file_subset(file, keep, NULL))
        rc = app_scene_fail(scene, body->part.line, TM_ERR_MEMORY, "out of memory; use smaller meshes");
    else
        drop_empty(file, parent);
    free(parent);
    free(wanted);
    return rc;
}
