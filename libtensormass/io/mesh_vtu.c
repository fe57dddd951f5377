/* VTK's XML for unstructured grids, written alone: what ParaView and meshio open with regions and groups. The arrays
 * lie behind the XML that describes them, each behind its length in bytes. */
#include <inttypes.h>
#include <stdlib.h>

#include "mesh_format.h"

enum { TETRA = 10 };

typedef struct array {
    const char *type; /* VTK's */
    int components, bytes;
    int64_t tuples;
} array;

static int64_t size_of(const array *a) { return a->tuples * a->components * a->bytes; }

static void put_name(const char *name, FILE *file) {
    for (; *name; name++) {
        const char *plain = *name == '<'   ? "&lt;"
                            : *name == '>' ? "&gt;"
                            : *name == '&' ? "&amp;"
                            : *name == '"' ? "&quot;"
                                           : NULL;
        if (plain)
            fputs(plain, file);
        else
            putc((unsigned char)*name < ' ' ? '_' : *name, file);
    }
}

static void declare(const array *a, const char *prefix, const char *name, int64_t *at, FILE *file) {
    fprintf(file, "<DataArray type=\"%s\" Name=\"%s", a->type, prefix);
    put_name(name, file);
    fprintf(file, "\" NumberOfComponents=\"%d\" format=\"appended\" offset=\"%" PRId64 "\"/>\n", a->components, *at);
    *at += (int64_t)sizeof(uint64_t) + size_of(a);
}

static void put_length(const array *a, FILE *file) {
    const uint64_t bytes = (uint64_t)size_of(a);
    fwrite(&bytes, sizeof bytes, 1, file);
}

/* 1 where a vertex is in the group, whose vertices ascend. */
static void put_group(const tm_mesh_file *m, int32_t group, FILE *file) {
    int32_t at = m->group_begin[group];
    for (int32_t v = 0; v < m->vertex_count; v++) {
        const bool in = at < m->group_begin[group + 1] && m->group_vertex[at] == v;
        at += in;
        putc(in, file);
    }
}

static void put_arrays(const tm_mesh_file *m, const array kind[6], FILE *file) {
    const size_t v = (size_t)m->vertex_count, t = (size_t)m->tet_count;
    put_length(&kind[0], file);
    fwrite(m->vertex_m, sizeof(double), 3 * v, file);
    for (int32_t g = 0; g < m->group_count; g++) {
        put_length(&kind[1], file);
        put_group(m, g, file);
    }
    put_length(&kind[2], file);
    fwrite(m->tet, sizeof(int32_t), 4 * t, file);
    put_length(&kind[3], file);
    for (int64_t end = 4; end <= 4 * (int64_t)t; end += 4) fwrite(&end, sizeof end, 1, file);
    put_length(&kind[4], file);
    for (size_t i = 0; i < t; i++) putc(TETRA, file);
    put_length(&kind[5], file);
    fwrite(m->region, sizeof(int32_t), t, file);
}

/* Regions as numbers of the cells, their names in comments, groups as 0 or 1 of the points. */
static void put_vtu(const tm_mesh_file *m, FILE *file) {
    const int64_t v = m->vertex_count, t = m->tet_count;
    const array kind[6] = {{"Float64", 3, 8, v}, {"UInt8", 1, 1, v}, {"Int32", 1, 4, 4 * t},
                           {"Int64", 1, 8, t},   {"UInt8", 1, 1, t}, {"Int32", 1, 4, t}};
    int64_t at = 0;
    fputs("<?xml version=\"1.0\"?>\n", file);
    for (int32_t r = 0; r < m->region_count; r++) {
        fprintf(file, "<!-- region %d: ", r);
        for (const char *c = m->region_name[r]; *c; c++) putc(*c == '-' || (unsigned char)*c < ' ' ? '_' : *c, file);
        fputs(" -->\n", file);
    }
    fprintf(file,
            "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
            "<UnstructuredGrid>\n<Piece NumberOfPoints=\"%" PRId64 "\" NumberOfCells=\"%" PRId64 "\">\n<Points>\n",
            v, t);
    declare(&kind[0], "", "Points", &at, file);
    fputs("</Points>\n<PointData>\n", file);
    for (int32_t g = 0; g < m->group_count; g++) declare(&kind[1], "group:", m->group_name[g], &at, file);
    fputs("</PointData>\n<Cells>\n", file);
    declare(&kind[2], "", "connectivity", &at, file);
    declare(&kind[3], "", "offsets", &at, file);
    declare(&kind[4], "", "types", &at, file);
    fputs("</Cells>\n<CellData Scalars=\"region\">\n", file);
    declare(&kind[5], "", "region", &at, file);
    fputs("</CellData>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_", file);
    put_arrays(m, kind, file);
    fputs("\n</AppendedData>\n</VTKFile>\n", file);
}

const tm_io_format tm_io_format_vtu = {".vtu", "<?xml", NULL, put_vtu};
