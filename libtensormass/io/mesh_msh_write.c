/* Writes .msh 2.2 as text: regions as volumes, groups of vertices as points, with the file's own numbers. */
#include <string.h>

#include "mesh_msh.h"

static bool is_region(const tm_mesh_file *m, int32_t group) {
    for (int32_t r = 0; r < m->region_count; r++)
        if (strcmp(m->region_name[r], m->group_name[group]) == 0) return true;
    return false;
}

/* Returns the number of point elements of a group: its vertices, or none for a region's own group, which its tetrahedra
 * form. */
static int64_t point_count(const tm_mesh_file *m) {
    int64_t points = 0;
    for (int32_t g = 0; g < m->group_count; g++)
        if (!is_region(m, g)) points += m->group_begin[g + 1] - m->group_begin[g];
    return points;
}

static void put_names(const tm_mesh_file *m, FILE *file) {
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

void tm_io_write_msh(const tm_mesh_file *m, FILE *file) {
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
