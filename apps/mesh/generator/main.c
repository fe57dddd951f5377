/* generate SHAPE TETRAHEDRA PREFIX: writes PREFIX.msh and PREFIX.fibres.csv. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "generator.h"
#include "libtensormass/numeric/order.h"

/* Reports the mesh's cost: the critical step is proportional to the smallest tetrahedron size. */
static void report(const growing *m, const char *prefix) {
    double *size = malloc((size_t)m->tet_count * sizeof *size);
    if (!size) exit(1);
    for (int t = 0; t < m->tet_count; t++) {
        const int *v = m->tet + 4 * t;
        size[t] =
            growing_tet_size(m->vertex + 3 * v[0], m->vertex + 3 * v[1], m->vertex + 3 * v[2], m->vertex + 3 * v[3]);
    }
    num_sort(size, m->tet_count);
    printf(
        "%s.msh: %d tetrahedra, %d vertices, %d outer triangles; size smallest %.3g mm, median %.3g mm, ratio %.2f\n",
        prefix, m->tet_count, m->vertex_count, m->face_count, 1e3 * size[0], 1e3 * size[m->tet_count / 2],
        size[0] / size[m->tet_count / 2]);
    free(size);
}

int main(int argc, char **argv) {
    static const struct {
        const char *name;
        void (*make)(growing *, int);
    } shape[] = {
        {"block", make_block}, {"cylinder", make_cylinder}, {"liver", make_liver}, {"gallbladder", make_gallbladder}};
    int tets = argc == 4 ? atoi(argv[2]) : 0;
    for (size_t i = 0; i < sizeof shape / sizeof *shape && tets > 0; i++) {
        if (strcmp(argv[1], shape[i].name) != 0) continue;
        growing m = {0};
        shape[i].make(&m, tets);
        if (!write_mesh(&m, argv[3])) {
            fprintf(stderr, "%s.msh: cannot be written; check the folder\n", argv[3]);
            return 1;
        }
        report(&m, argv[3]);
        growing_free(&m);
        return 0;
    }
    fprintf(stderr, "usage: generate block|cylinder|liver|gallbladder TETRAHEDRA PREFIX\n");
    return 2;
}
