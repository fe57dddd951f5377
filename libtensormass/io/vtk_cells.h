/* Contents of VTK's files, legacy and XML: points, cells of any kind, a region per cell, groups of points. */
#ifndef TM_IO_VTK_CELLS_H
#define TM_IO_VTK_CELLS_H

#include "mesh_format.h"

/* Cell types with a name here. */
enum { VTK_TRIANGLE = 5, VTK_STRIP = 6, VTK_POLYGON = 7, VTK_QUAD = 9, VTK_TETRA = 10, VTK_QUADRATIC = 21 };

typedef struct tm_io_vtk_group {
    char name[64];
    uint8_t *in; /* [points] */
} tm_io_vtk_group;

typedef struct tm_io_vtk {
    tm_error *error;
    double *point;      /* [3*points] */
    int64_t *offset;    /* [cells+1] */
    int64_t *corner;    /* [offset[cells]] points, from 0 */
    int64_t *cell_type; /* [cells]; null: all polygons */
    int64_t points, cells;
    int64_t *region; /* [cells]; null: one region */
    int32_t names, groups;
    struct tm_io_vtk_name {
        int64_t region;
        char text[64];
    } * name; /* [names] of regions */
    tm_io_vtk_group *group;
} tm_io_vtk;

void tm_io_vtk_free(tm_io_vtk *v);
/* Fails with "WHAT; write it anew", TM_ERR_FILE. */
tm_status tm_io_vtk_bad(const tm_io_vtk *v, const char *what);
tm_status tm_io_vtk_no_memory(const tm_io_vtk *v);
/* Add names of regions and groups as they are read. Return false if memory is exhausted. The group's members [points]
 * start at 0. */
bool tm_io_vtk_name(tm_io_vtk *v, int64_t region, const char *name);
uint8_t *tm_io_vtk_group_add(tm_io_vtk *v, const char *name);
/* Checks that offsets ascend within `corners`, the number of corners, and that corners name existing points. */
tm_status tm_io_vtk_check(const tm_io_vtk *v, int64_t corners);
/* Adds its tetrahedra, with regions and groups; cells that are not volumes are skipped. */
tm_status tm_io_vtk_tets(const tm_io_vtk *v, tm_io_raw *raw);
/* Converts triangles, polygons and strips to triangles; refuses volumes. corner [9*triangles] is malloced. */
tm_status tm_io_vtk_triangles(const tm_io_vtk *v, double **corner, int32_t *triangles);

/* Readers: fill `v`, which the caller frees whatever they return. `text` is the complete file. */
tm_status tm_io_vtk_read_legacy(tm_io_text *text, const char *dataset, tm_io_vtk *v);
tm_status tm_io_vtk_read_xml(tm_io_text *text, const char *dataset, tm_io_vtk *v);

#endif
