/* Kinds of mesh files. One kind is one file, mesh_NAME.c, that defines tm_io_format_NAME, and one row of
 * TM_IO_FORMATS: endings, messages, and what tm-mesh writes follow from that. */
#ifndef TM_MESH_FORMAT_H
#define TM_MESH_FORMAT_H

#include <stdio.h>

#include "tensormass_io.h"

#define TM_IO_FORMATS(ROW) ROW(msh) ROW(vtk) ROW(medit) ROW(vtu)

/* A mesh as its reader finds it: in the order and with the numbers of the file. */
typedef struct tm_io_raw tm_io_raw;

/* The bytes of a file. A NUL that is not counted follows `end`. */
typedef struct tm_io_text {
    const char *at, *end;
    tm_error *error;
    int line; /* left by the reader: where it stopped, for the message; 0 in a binary file */
} tm_io_text;

typedef struct tm_io_format {
    const char *ending; /* ".msh" */
    const char *start;  /* what every such file begins with, behind spaces */
    /* What it finds it adds to `raw`, vertices first. Must refuse what is cut short, and take memory for what it has
     * seen alone: counts in a file may lie. */
    tm_status (*read)(tm_io_text *text, tm_io_raw *raw); /* null: written alone */
    void (*write)(const tm_mesh_file *mesh, FILE *file); /* null: read alone. Errors stay in `file`. */
} tm_io_format;

#define TM_IO_FORMAT_DECLARE(name) extern const tm_io_format tm_io_format_##name;
TM_IO_FORMATS(TM_IO_FORMAT_DECLARE)

/* What a reader adds. A failure is TM_ERR_MEMORY, or TM_ERR_MESH with the element to blame. */
tm_status tm_io_add_vertex(tm_io_raw *raw, int64_t tag, const double p[3], tm_error *error);
/* Called once between vertices and elements. Refuses a tag that comes twice. */
tm_status tm_io_vertices_end(tm_io_raw *raw, tm_error *error);
/* Points, edges, triangles and quadrilaterals (`dim` 0 to 2), and tetrahedra (3): all vertices of the groups of their
 * `entity`. `corner` [count], count <= 4, are vertex tags. */
tm_status tm_io_add_element(tm_io_raw *raw, int64_t tag, int dim, int32_t entity, const int64_t *corner, int count,
                            tm_error *error);
/* The elements of this entity are in this group; both count by themselves in each dimension. */
tm_status tm_io_add_member(tm_io_raw *raw, int dim, int32_t entity, int32_t group, tm_error *error);
tm_status tm_io_add_name(tm_io_raw *raw, int dim, int32_t group, const char *name, size_t length, tm_error *error);
/* Refusals that every kind of file knows. */
tm_status tm_io_higher_order(tm_error *error, int64_t element, int64_t type);
tm_status tm_io_other_volume(tm_error *error, int64_t element, const char *what);

/* Where the `length` letters of `word` first are; null. */
const char *tm_io_find(const char *at, const char *end, const char *word, size_t length);
/* The line that `at` lies in. */
int tm_io_line(const char *start, const char *at);

#endif
