/* VTK's XML for unstructured grids, written alone: what ParaView and meshio open with regions and groups. */
#include "mesh_format.h"
#include "vtu.h"

/* 1 where a vertex is in the group, whose vertices ascend. */
static void put_group(const tm_mesh_file *m, int32_t group, FILE *file) {
    int32_t at = m->group_begin[group];
    for (int32_t v = 0; v < m->vertex_count; v++) {
        const bool in = at < m->group_begin[group + 1] && m->group_vertex[at] == v;
        at += in;
        putc(in, file);
    }
}

/* Regions as numbers of the cells, their names in comments, groups as 0 or 1 of the points. */
static void put_vtu(const tm_mesh_file *m, FILE *file) {
    const int64_t v = m->vertex_count, t = m->tet_count;
    const vtu_array in_group = {"UInt8", 1, 1, v}, region = {"Int32", 1, 4, t};
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
    vtu_data(file);
    vtu_put_points(v, m->vertex_m, file);
    for (int32_t g = 0; g < m->group_count; g++) {
        vtu_put_length(&in_group, file);
        put_group(m, g, file);
    }
    vtu_put_cells(t, m->tet, file);
    vtu_put(&region, m->region, file);
    vtu_end(file);
}

const tm_io_format tm_io_format_vtu = {".vtu", "<?xml", NULL, put_vtu};
