/* Mesh formats. Each is one file, mesh_NAME.c, that defines tm_io_format_NAME, and one row of TM_IO_FORMATS. Endings,
 * messages and the output of tm-mesh follow from that. */
#ifndef TM_MESH_FORMAT_H
#define TM_MESH_FORMAT_H

#include <stdio.h>

#include "tensormass_io.h"

#define TM_IO_FORMATS(ROW) ROW(msh) ROW(vtk) ROW(medit) ROW(vtu)

/* A mesh as its reader finds it: with the file's order and numbers. */
typedef struct tm_io_raw tm_io_raw;

/* The bytes of a file. An uncounted NUL follows `end`. */
typedef struct tm_io_text {
    const char *at, *end;
    tm_error *error;
    int line; /* set by the reader: where it stopped, for the message; 0 in a binary file */
} tm_io_text;

typedef struct tm_io_format {
    const char *ending; /* ".msh" */
    const char *start;  /* start of each such file, after spaces */
    /* Adds what it finds to `raw`, vertices first. Must refuse truncated files, and allocate only for data already
     * seen: counts in a file may be wrong. */
    tm_status (*read)(tm_io_text *text, tm_io_raw *raw); /* null: write only */
    void (*write)(const tm_mesh_file *mesh, FILE *file); /* null: read only. Errors stay in `file`. */
} tm_io_format;

#define TM_IO_FORMAT_DECLARE(name) extern const tm_io_format tm_io_format_##name;
TM_IO_FORMATS(TM_IO_FORMAT_DECLARE)

/* Functions for readers. They fail with TM_ERR_MEMORY, or TM_ERR_MESH with the invalid element. */
tm_status tm_io_add_vertex(tm_io_raw *raw, int64_t tag, const double p[3], tm_error *error);
/* Must be called once between vertices and elements. Refuses duplicate tags. */
tm_status tm_io_vertices_end(tm_io_raw *raw, tm_error *error);
/* Adds points, edges, triangles and quadrilaterals (`dim` 0 to 2) or tetrahedra (3); their vertices join the groups of
 * their `entity`. `corner` [count], count <= 4, are vertex tags. */
tm_status tm_io_add_element(tm_io_raw *raw, int64_t tag, int dim, int32_t entity, const int64_t *corner, int count,
                            tm_error *error);
/* Assigns the elements of an entity to a group; both are numbered separately in each dimension. */
tm_status tm_io_add_member(tm_io_raw *raw, int dim, int32_t entity, int32_t group, tm_error *error);
tm_status tm_io_add_name(tm_io_raw *raw, int dim, int32_t group, const char *name, size_t length, tm_error *error);
/* Refusals common to all formats. */
tm_status tm_io_higher_order(tm_error *error, int64_t element, int64_t type);
tm_status tm_io_other_volume(tm_error *error, int64_t element, const char *what);

/* Finds the first occurrence of `word` with `length` letters; null if there is none. */
const char *tm_io_find(const char *at, const char *end, const char *word, size_t length);
/* Returns the line of `at`. */
int tm_io_line(const char *start, const char *at);

#endif
