/* Reads and writes VTK's legacy files of tetrahedra. */
#include <stdio.h>

#include "vtk_cells.h"

static tm_status read_vtk(tm_io_text *text, tm_io_raw *raw) {
    tm_io_vtk v = {.error = text->error};
    tm_status status = tm_io_vtk_read_legacy(text, "UNSTRUCTURED_GRID", &v);
    if (!status) status = tm_io_vtk_tets(&v, raw);
    tm_io_vtk_free(&v);
    return status;
}

/* Writes a name as VTK does: spaces as %20. */
static void put_name(const char *name, FILE *file) {
    for (; *name; name++)
        if ((unsigned char)*name <= ' ' || *name == '%' || *name == '"' || (unsigned char)*name > 126)
            fprintf(file, "%%%02X", (unsigned char)*name);
        else
            putc(*name, file);
}

static void put_names(const tm_mesh_file *m, FILE *file) {
    bool named = false;
    for (int32_t r = 0; r < m->region_count; r++) named = named || *m->region_name[r];
    if (!named) return;
    fprintf(file, "FIELD FieldData 1\nregion_names 1 %d string\n", m->region_count);
    for (int32_t r = 0; r < m->region_count; r++) {
        put_name(m->region_name[r], file);
        putc('\n', file);
    }
}

static void put_fibres(const tm_mesh_file *m, FILE *file) {
    if (!m->fibre) return;
    fputs("VECTORS fibre double\n", file);
    for (size_t t = 0; t < (size_t)m->tet_count; t++)
        fprintf(file, "%.17g %.17g %.17g\n", m->fibre[3 * t], m->fibre[3 * t + 1], m->fibre[3 * t + 2]);
}

static void put_groups(const tm_mesh_file *m, FILE *file) {
    if (!m->group_count) return;
    fprintf(file, "POINT_DATA %d\nFIELD groups %d\n", m->vertex_count, m->group_count);
    for (int32_t g = 0; g < m->group_count; g++) {
        int32_t at = m->group_begin[g];
        put_name(m->group_name[g], file);
        fprintf(file, " 1 %d unsigned_char\n", m->vertex_count);
        for (int32_t v = 0; v < m->vertex_count; v++) {
            const bool in = at < m->group_begin[g + 1] && m->group_vertex[at] == v;
            at += in;
            fprintf(file, in ? "1\n" : "0\n");
        }
    }
}

/* Writes regions as cell data with their names in a field, groups as 0 or 1 of the points. */
static void put_vtk(const tm_mesh_file *m, FILE *file) {
    fprintf(file, "# vtk DataFile Version 2.0\ntensormass mesh\nASCII\nDATASET UNSTRUCTURED_GRID\n");
    put_names(m, file);
    fprintf(file, "POINTS %d double\n", m->vertex_count);
    for (int32_t v = 0; v < m->vertex_count; v++)
        fprintf(file, "%.17g %.17g %.17g\n", m->vertex_m[3 * (size_t)v], m->vertex_m[3 * (size_t)v + 1],
                m->vertex_m[3 * (size_t)v + 2]);
    fprintf(file, "CELLS %d %lld\n", m->tet_count, 5LL * m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet + 4 * (size_t)t;
        fprintf(file, "4 %d %d %d %d\n", v[0], v[1], v[2], v[3]);
    }
    fprintf(file, "CELL_TYPES %d\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) fprintf(file, "10\n");
    fprintf(file, "CELL_DATA %d\nSCALARS region int 1\nLOOKUP_TABLE default\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) fprintf(file, "%d\n", m->region[t]);
    put_fibres(m, file);
    put_groups(m, file);
}

const tm_io_format tm_io_format_vtk = {".vtk", "# vtk DataFile", read_vtk, put_vtk};
