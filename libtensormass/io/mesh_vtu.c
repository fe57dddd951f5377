/* Writes VTK's XML for unstructured grids: ParaView and meshio open it with regions, groups and fibres. */
#include "vtk_cells.h"
#include "vtu.h"

/* Writes 1 for a vertex in the group, whose vertices ascend, else 0. */
static void put_group(const tm_mesh_file *m, int32_t group, FILE *file) {
    int32_t at = m->group_begin[group];
    for (int32_t v = 0; v < m->vertex_count; v++) {
        const bool in = at < m->group_begin[group + 1] && m->group_vertex[at] == v;
        at += in;
        putc(in, file);
    }
}

/* Writes regions as cell data with their names in comments, groups as 0 or 1 of the points. */
static void put_vtu(const tm_mesh_file *m, FILE *file) {
    const int64_t v = m->vertex_count, t = m->tet_count;
    const vtu_array in_group = {"UInt8", 1, 1, v}, region = {"Int32", 1, 4, t}, fibre = {"Float64", 3, 8, t};
    int64_t at = 0;
    fputs("<?xml version=\"1.0\"?>\n", file);
    for (int32_t r = 0; r < m->region_count; r++) {
        fprintf(file, "<!-- region %d: ", r);
        for (const char *c = m->region_name[r]; *c; c++) putc(*c == '-' || (unsigned char)*c < ' ' ? '_' : *c, file);
        fputs(" -->\n", file);
    }
    vtu_begin(file);
    vtu_piece(v, t, "", &at, file);
    for (int32_t g = 0; g < m->group_count; g++) vtu_declare(&in_group, "group:", m->group_name[g], &at, file);
    vtu_cells(t, &at, file);
    vtu_declare(&region, "", "region", &at, file);
    if (m->fibre) vtu_declare(&fibre, "", "fibre", &at, file);
    vtu_data(file);
    vtu_put_points(v, m->vertex_m, file);
    for (int32_t g = 0; g < m->group_count; g++) {
        vtu_put_length(&in_group, file);
        put_group(m, g, file);
    }
    vtu_put_cells(t, m->tet, file);
    vtu_put(&region, m->region, file);
    if (m->fibre) vtu_put(&fibre, m->fibre, file);
    vtu_end(file);
}

static tm_status read_vtu(tm_io_text *text, tm_io_raw *raw) {
    tm_io_vtk v = {.error = text->error};
    tm_status status = tm_io_vtk_read_xml(text, "UnstructuredGrid", &v);
    if (!status) status = tm_io_vtk_tets(&v, raw);
    tm_io_vtk_free(&v);
    return status;
}

const tm_io_format tm_io_format_vtu = {".vtu", "<", read_vtu, put_vtu};
