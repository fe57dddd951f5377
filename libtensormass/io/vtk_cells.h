/* What VTK's files hold, legacy and XML alike: points, cells of any kind, a region for each, groups of points. */
#ifndef TM_IO_VTK_CELLS_H
#define TM_IO_VTK_CELLS_H

#include "mesh_format.h"

/* Kinds of cells that have a name here. */
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
    int64_t *region; /* [cells], or null: one */
    int32_t names, groups;
    struct tm_io_vtk_name {
        int64_t region;
        char text[64];
    } * name; /* [names] of regions */
    tm_io_vtk_group *group;
} tm_io_vtk;

void tm_io_vtk_free(tm_io_vtk *v);
/* "WHAT; write it anew", TM_ERR_FILE. */
tm_status tm_io_vtk_bad(const tm_io_vtk *v, const char *what);
tm_status tm_io_vtk_no_memory(const tm_io_vtk *v);
/* Names of regions and groups as they come. False: no memory. The group's members [points] are all 0. */
bool tm_io_vtk_name(tm_io_vtk *v, int64_t region, const char *name);
uint8_t *tm_io_vtk_group_add(tm_io_vtk *v, const char *name);
/* Offsets ascend within the corners, and corners name points that are there. `corners`: how many there are. */
tm_status tm_io_vtk_check(const tm_io_vtk *v, int64_t corners);
/* Its tetrahedra, with regions and groups; what is no volume is passed over. */
tm_status tm_io_vtk_tets(const tm_io_vtk *v, tm_io_raw *raw);
/* Its triangles, polygons and strips as triangles; volumes are refused. corner [9*triangles] malloced. */
tm_status tm_io_vtk_triangles(const tm_io_vtk *v, double **corner, int32_t *triangles);

/* Readers: they fill `v`, which the caller frees, whatever they return. `text` is the whole file. */
tm_status tm_io_vtk_read_legacy(tm_io_text *text, const char *dataset, tm_io_vtk *v);
tm_status tm_io_vtk_read_xml(tm_io_text *text, const char *dataset, tm_io_vtk *v);

#endif
