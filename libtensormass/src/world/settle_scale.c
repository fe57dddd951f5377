#include "world/settle_scale.h"

#include <float.h>
#include <math.h>

tm_force_scale tm_force_scale_of(const tm_tissue *tissue) {
    tm_force_scale scale = {.size_m = tm_mesh_size_m(tissue->mesh)};
    double K[9];
    for (int32_t v = 0; v < tissue->mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(tissue, v, K);
        for (int i = 0; i < 3; i++) scale.stiffness_N_m = fmax(scale.stiffness_N_m, K[4 * i]);
    }
    return scale;
}

double tm_force_scale_at(const tm_force_scale *scale, const double *u_m, int32_t n) {
    double most_m = 0;
    for (int32_t i = 0; i < n; i++) most_m = fmax(most_m, fabs(u_m[i]));
    const double way = fmax(1e-4 * most_m, 1e-9 * scale->size_m);
    return fmax(scale->stiffness_N_m * way, DBL_MIN);
}
