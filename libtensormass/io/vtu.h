/* VTK's XML for unstructured grids, with the arrays appended after the XML, each after its length in bytes. Shared by
 * mesh files and the frames of tm-sim's series. Header only, so that tm-sim can include it. */
#ifndef TM_VTU_H
#define TM_VTU_H

#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>

typedef struct vtu_array {
    const char *type; /* VTK's name */
    int components, bytes;
    int64_t tuples;
} vtu_array;

/* A grid is begin, (field data,) piece, its point data, cells, its cell data, data, the arrays in declared order, end.
 * `at`: offset of the next array, zero before the first. */

static inline int64_t vtu_size(const vtu_array *a) { return a->tuples * a->components * a->bytes; }

/* Writes `prefix` unchanged and `name` with the characters replaced that XML refuses. */
static inline void vtu_declare(const vtu_array *a, const char *prefix, const char *name, int64_t *at, FILE *file) {
    fprintf(file, "<DataArray type=\"%s\" Name=\"%s", a->type, prefix);
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
    fprintf(file, "\" NumberOfComponents=\"%d\" format=\"appended\" offset=\"%" PRId64 "\"/>\n", a->components, *at);
    *at += (int64_t)sizeof(uint64_t) + vtu_size(a);
}

static inline void vtu_put_length(const vtu_array *a, FILE *file) {
    const uint64_t bytes = (uint64_t)vtu_size(a);
    fwrite(&bytes, sizeof bytes, 1, file);
}

static inline void vtu_put(const vtu_array *a, const void *data, FILE *file) {
    vtu_put_length(a, file);
    fwrite(data, 1, (size_t)vtu_size(a), file);
}

static inline void vtu_begin(FILE *file) {
    fputs("<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
          "<UnstructuredGrid>\n",
          file);
}

/* Declares the vertices, before all other arrays. `what`: attributes of the next element, " Vectors=..." or "". */
static inline void vtu_piece(int64_t vertices, int64_t tets, const char *what, int64_t *at, FILE *file) {
    const vtu_array points = {"Float64", 3, 8, vertices};
    fprintf(file, "<Piece NumberOfPoints=\"%" PRId64 "\" NumberOfCells=\"%" PRId64 "\">\n<Points>\n", vertices, tets);
    vtu_declare(&points, "", "Points", at, file);
    fprintf(file, "</Points>\n<PointData%s>\n", what);
}

static inline void vtu_cells(int64_t tets, int64_t *at, FILE *file) {
    const vtu_array corners = {"Int32", 1, 4, 4 * tets}, ends = {"Int64", 1, 8, tets}, types = {"UInt8", 1, 1, tets};
    fputs("</PointData>\n<Cells>\n", file);
    vtu_declare(&corners, "", "connectivity", at, file);
    vtu_declare(&ends, "", "offsets", at, file);
    vtu_declare(&types, "", "types", at, file);
    fputs("</Cells>\n<CellData Scalars=\"region\">\n", file);
}

static inline void vtu_data(FILE *file) {
    fputs("</CellData>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_", file);
}

static inline void vtu_put_points(int64_t vertices, const double *vertex_m, FILE *file) {
    vtu_put(&(vtu_array){"Float64", 3, 8, vertices}, vertex_m, file);
}

/* Writes the three arrays of vtu_cells. */
static inline void vtu_put_cells(int64_t tets, const int32_t *tet, FILE *file) {
    enum { TETRA = 10 };
    vtu_put(&(vtu_array){"Int32", 1, 4, 4 * tets}, tet, file);
    vtu_put_length(&(vtu_array){"Int64", 1, 8, tets}, file);
    for (int64_t end = 4; end <= 4 * tets; end += 4) fwrite(&end, sizeof end, 1, file);
    vtu_put_length(&(vtu_array){"UInt8", 1, 1, tets}, file);
    for (int64_t t = 0; t < tets; t++) putc(TETRA, file);
}

static inline void vtu_end(FILE *file) { fputs("\n</AppendedData>\n</VTKFile>\n", file); }

#endif
