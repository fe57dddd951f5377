/* Inside the mesh loader: what readers have found, on its way to an app_mesh. */
#ifndef TM_MESH_RAW_H
#define TM_MESH_RAW_H

#include "mesh_format.h"

typedef struct app_mesh_vertex {
    int64_t tag;
    double p[3];
} app_mesh_vertex;

typedef struct app_mesh_element {
    int64_t tag;
    int32_t corner[4]; /* vertices, from 0 */
    int32_t entity;
    int8_t dim, corners;
} app_mesh_element;

typedef struct app_mesh_member {
    int32_t dim, group, entity;
} app_mesh_member;

typedef struct app_mesh_name {
    int32_t dim, group;
    char name[64];
} app_mesh_name;

struct app_mesh_raw {
    app_mesh_vertex *vertex;
    app_mesh_element *element;
    app_mesh_member *member;
    app_mesh_name *name;
    int64_t vertices, elements, members, names, tets;
    struct app_mesh_rank {
        int64_t tag;
        int32_t place;
    } * ranked; /* the vertices by tag; null where tags count up by one */
};

/* Sorted once all are there: by dimension, group and entity; names by dimension and group. */
tm_status app_mesh_raw_sort(app_mesh_raw *raw, tm_error *error);
/* Regions and groups of the mesh, whose vertices and tetrahedra are there. */
tm_status app_mesh_raw_groups(const app_mesh_raw *raw, app_mesh *mesh, tm_error *error);
void app_mesh_raw_free(app_mesh_raw *raw);

#endif
