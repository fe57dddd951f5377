/* Kinds of mesh files. One kind is one file, mesh_NAME.c, that defines app_mesh_format_NAME, and one row of
 * APP_MESH_FORMATS: endings, messages, and what tm-mesh writes follow from that. */
#ifndef TM_MESH_FORMAT_H
#define TM_MESH_FORMAT_H

#include <stdio.h>

#include "mesh_file.h"

#define APP_MESH_FORMATS(ROW) ROW(msh) ROW(vtk) ROW(medit)

/* A mesh as its reader finds it: in the order and with the numbers of the file. */
typedef struct app_mesh_raw app_mesh_raw;

/* The bytes of a file. A NUL that is not counted follows `end`. */
typedef struct app_mesh_text {
    const char *at, *end;
    tm_error *error;
} app_mesh_text;

typedef struct app_mesh_format {
    const char *ending; /* ".msh" */
    const char *start;  /* what every such file begins with, behind spaces */
    /* What it finds it adds to `raw`, vertices first. Must refuse what is cut short, and take memory for what it has
     * seen alone: counts in a file may lie. */
    tm_status (*read)(app_mesh_text *text, app_mesh_raw *raw);
    void (*write)(const app_mesh *mesh, FILE *file); /* null: read alone. Errors stay in `file`. */
} app_mesh_format;

#define APP_MESH_FORMAT_DECLARE(name) extern const app_mesh_format app_mesh_format_##name;
APP_MESH_FORMATS(APP_MESH_FORMAT_DECLARE)

/* What a reader adds. A failure is TM_ERR_MEMORY, or TM_ERR_MESH with the element to blame. */
tm_status app_mesh_add_vertex(app_mesh_raw *raw, int64_t tag, const double p[3], tm_error *error);
/* Called once between vertices and elements. Refuses a tag that comes twice. */
tm_status app_mesh_vertices_end(app_mesh_raw *raw, tm_error *error);
/* Points, edges, triangles and quadrilaterals (`dim` 0 to 2), and tetrahedra (3): all vertices of the groups of their
 * `entity`. `corner` [count], count <= 4, are vertex tags. */
tm_status app_mesh_add_element(app_mesh_raw *raw, int64_t tag, int dim, int32_t entity, const int64_t *corner,
                               int count, tm_error *error);
/* The elements of this entity are in this group; both count by themselves in each dimension. */
tm_status app_mesh_add_member(app_mesh_raw *raw, int dim, int32_t entity, int32_t group, tm_error *error);
tm_status app_mesh_add_name(app_mesh_raw *raw, int dim, int32_t group, const char *name, size_t length,
                            tm_error *error);
/* Refusals that every kind of file knows. */
tm_status app_mesh_higher_order(tm_error *error, const char *place, int64_t element, int64_t type);
tm_status app_mesh_other_volume(tm_error *error, const char *place, int64_t element, const char *what);

tm_status app_mesh_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

#endif
