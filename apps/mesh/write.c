/* Meshes written: .msh 2.2, .vtk and .mesh text, and fibres as CSV. */
#include <string.h>

#include "command.h"

static bool is_region(const app_mesh *m, int32_t group) {
    for (int32_t r = 0; r < m->region_count; r++)
        if (strcmp(m->region_name[r], m->group_name[group]) == 0) return true;
    return false;
}

/* Elements of a group: its vertices as points, none for a region's own group, which its tetrahedra make. */
static int64_t point_count(const app_mesh *m) {
    int64_t points = 0;
    for (int32_t g = 0; g < m->group_count; g++)
        if (!is_region(m, g)) points += m->group_begin[g + 1] - m->group_begin[g];
    return points;
}

static void put_names(const app_mesh *m, FILE *file) {
    int names = 0;
    for (int32_t g = 0; g < m->group_count; g++) names += !is_region(m, g);
    for (int32_t r = 0; r < m->region_count; r++) names += m->region_name[r][0] != 0;
    fprintf(file, "$PhysicalNames\n%d\n", names);
    for (int32_t g = 0; g < m->group_count; g++)
        if (!is_region(m, g)) fprintf(file, "0 %d \"%s\"\n", g + 1, m->group_name[g]);
    for (int32_t r = 0; r < m->region_count; r++)
        if (m->region_name[r][0]) fprintf(file, "3 %d \"%s\"\n", r + 1, m->region_name[r]);
    fprintf(file, "$EndPhysicalNames\n");
}

static void put_msh(const app_mesh *m, FILE *file) {
    int64_t next = 0;
    fprintf(file, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n");
    put_names(m, file);
    fprintf(file, "$Nodes\n%d\n", m->vertex_count);
    for (int32_t v = 0; v < m->vertex_count; v++) {
        const double *p = m->vertex_m + 3 * (size_t)v;
        fprintf(file, "%lld %.17g %.17g %.17g\n", (long long)m->vertex_tag[v], p[0], p[1], p[2]);
    }
    fprintf(file, "$EndNodes\n$Elements\n%lld\n", (long long)(m->tet_count + point_count(m)));
    for (int32_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet + 4 * (size_t)t, region = m->region[t];
        fprintf(file, "%lld 4 2 %d %d", (long long)m->tet_tag[t], m->region_name[region][0] ? region + 1 : 0,
                region + 1);
        for (int k = 0; k < 4; k++) fprintf(file, " %lld", (long long)m->vertex_tag[v[k]]);
        fputc('\n', file);
        if (m->tet_tag[t] > next) next = m->tet_tag[t];
    }
    for (int32_t g = 0; g < m->group_count; g++)
        for (int32_t i = m->group_begin[g]; !is_region(m, g) && i < m->group_begin[g + 1]; i++)
            fprintf(file, "%lld 15 2 %d %d %lld\n", (long long)++next, g + 1, g + 1,
                    (long long)m->vertex_tag[m->group_vertex[i]]);
    fprintf(file, "$EndElements\n");
}

static void put_vtk(const app_mesh *m, FILE *file) {
    fprintf(file, "# vtk DataFile Version 2.0\ntensormass mesh\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %d double\n",
            m->vertex_count);
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
}

static void put_medit(const app_mesh *m, FILE *file) {
    fprintf(file, "MeshVersionFormatted 2\nDimension 3\nVertices\n%d\n", m->vertex_count);
    for (int32_t v = 0; v < m->vertex_count; v++)
        fprintf(file, "%.17g %.17g %.17g 0\n", m->vertex_m[3 * (size_t)v], m->vertex_m[3 * (size_t)v + 1],
                m->vertex_m[3 * (size_t)v + 2]);
    fprintf(file, "Tetrahedra\n%d\n", m->tet_count);
    for (int32_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet + 4 * (size_t)t;
        fprintf(file, "%d %d %d %d %d\n", v[0] + 1, v[1] + 1, v[2] + 1, v[3] + 1, m->region[t] + 1);
    }
    fprintf(file, "End\n");
}

static tm_status close_and_commit(FILE *file, app_output *output, tm_error *error) {
    bool whole = !ferror(file);
    whole = fclose(file) == 0 && whole;
    if (whole && app_output_commit(output, error)) return TM_OK;
    app_output_abandon(output);
    return whole ? TM_ERR_FILE
                 : app_mesh_fail(error, TM_ERR_FILE, -1, "%s: cannot be written whole; check the disk", output->path);
}

tm_status write_mesh_file(const app_mesh *mesh, const char *path, tm_error *error) {
    static const struct {
        const char *ending;
        void (*put)(const app_mesh *, FILE *);
    } format[] = {{".msh", put_msh}, {".vtk", put_vtk}, {".mesh", put_medit}};
    const char *dot = strrchr(path, '.');
    for (size_t i = 0; i < sizeof format / sizeof *format; i++) {
        if (!dot || strcmp(dot, format[i].ending) != 0) continue;
        app_output output;
        if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
        FILE *file = app_output_stream(&output);
        if (!file) return app_mesh_fail(error, TM_ERR_FILE, -1, "%s: cannot be written; check the folder", path);
        format[i].put(mesh, file);
        return close_and_commit(file, &output, error);
    }
    return app_mesh_fail(error, TM_ERR_FILE, -1, "%s: unknown kind of mesh file; name it .msh, .vtk or .mesh", path);
}

tm_status write_fibres(const double *fibre, int32_t tet_count, const char *path, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    FILE *file = app_output_stream(&output);
    if (!file) return app_mesh_fail(error, TM_ERR_FILE, -1, "%s: cannot be written; check the folder", path);
    fprintf(file, "tet,ax,ay,az\n");
    for (int32_t t = 0; t < tet_count; t++)
        fprintf(file, "%d,%.9g,%.9g,%.9g\n", t, fibre[3 * (size_t)t], fibre[3 * (size_t)t + 1],
                fibre[3 * (size_t)t + 2]);
    return close_and_commit(file, &output, error);
}
