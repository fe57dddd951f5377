/* Writes Gmsh 2.2 text, and fibres as CSV. Coordinates are rounded to 0.1 um, so that differences of libm's last bits
 * do not appear. */
#include <stdio.h>

#include "generator.h"

static void write_msh(const growing *m, FILE *file) {
    fprintf(file, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n%d\n", m->face_names + m->region_names);
    for (int g = 0; g < m->face_names; g++) fprintf(file, "2 %d \"%s\"\n", g + 1, m->face_name[g]);
    for (int r = 0; r < m->region_names; r++) fprintf(file, "3 %d \"%s\"\n", r + 1, m->region_name[r]);
    fprintf(file, "$EndPhysicalNames\n$Nodes\n%d\n", m->vertex_count);
    for (int v = 0; v < m->vertex_count; v++) {
        fprintf(file, "%d", v + 1);
        for (int k = 0; k < 3; k++) {
            double x = m->vertex[3 * v + k];
            fprintf(file, " %.7f", x > -5e-8 && x < 0 ? 0.0 : x);
        }
        fputc('\n', file);
    }
    fprintf(file, "$EndNodes\n$Elements\n%d\n", m->face_count + m->tet_count);
    for (int f = 0; f < m->face_count; f++) {
        const int *v = m->face + 3 * f, g = m->face_group[f] + 1;
        fprintf(file, "%d 2 2 %d %d %d %d %d\n", f + 1, g, g, v[0] + 1, v[1] + 1, v[2] + 1);
    }
    for (int t = 0; t < m->tet_count; t++) {
        const int *v = m->tet + 4 * t, r = m->region[t] + 1;
        fprintf(file, "%d 4 2 %d %d %d %d %d %d\n", m->face_count + t + 1, r, r, v[0] + 1, v[1] + 1, v[2] + 1,
                v[3] + 1);
    }
    fprintf(file, "$EndElements\n");
}

static void write_fibres(const growing *m, FILE *file) {
    fprintf(file, "tet,ax,ay,az\n");
    for (int t = 0; t < m->tet_count; t++) {
        fprintf(file, "%d", t);
        for (int k = 0; k < 3; k++) {
            double a = m->fibre[3 * t + k];
            fprintf(file, ",%.6f", a > -5e-7 && a < 0 ? 0.0 : a);
        }
        fputc('\n', file);
    }
}

bool write_mesh(const growing *m, const char *prefix) {
    char path[1024];
    snprintf(path, sizeof path, "%s.msh", prefix);
    FILE *file = fopen(path, "w");
    if (!file) return false;
    write_msh(m, file);
    bool good = fclose(file) == 0;
    if (!good || !m->fibre) return good;
    snprintf(path, sizeof path, "%s.fibres.csv", prefix);
    file = fopen(path, "w");
    if (!file) return false;
    write_fibres(m, file);
    return fclose(file) == 0;
}
