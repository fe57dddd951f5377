/* Internals of the mesh loader: data from the readers, before it becomes a tm_mesh_file. */
#ifndef TM_MESH_RAW_H
#define TM_MESH_RAW_H

#include "mesh_format.h"

typedef struct tm_io_vertex {
    int64_t tag;
    double p[3];
} tm_io_vertex;

typedef struct tm_io_element {
    int64_t tag;
    int32_t corner[4]; /* vertices, from 0 */
    int32_t entity;
    int8_t dim, corners;
} tm_io_element;

typedef struct tm_io_member {
    int32_t dim, group, entity;
} tm_io_member;

typedef struct tm_io_name {
    int32_t dim, group;
    char name[64];
} tm_io_name;

struct tm_io_raw {
    tm_io_vertex *vertex;
    tm_io_element *element;
    tm_io_member *member;
    tm_io_name *name;
    int64_t vertices, elements, members, names, tets;
    struct tm_io_rank {
        int64_t tag;
        int32_t place;
    } * ranked; /* vertices sorted by tag; null if tags are consecutive */
};

/* Sorts when all are added: by dimension, group and entity; names by dimension and group. */
tm_status tm_io_raw_sort(tm_io_raw *raw, tm_error *error);
/* Adds regions and groups to a mesh that has its vertices and tetrahedra. */
tm_status tm_io_raw_groups(const tm_io_raw *raw, tm_mesh_file *mesh, tm_error *error);
void tm_io_raw_free(tm_io_raw *raw);

#endif
