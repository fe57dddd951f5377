/* Interpolates fibre directions from an image at the centroids of tetrahedra. */
#include "fibres_image.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "image_api.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

/* Converts the centroid to voxels, from the centre of the first. Returns false if it is outside the grid. */
static bool to_grid(const image_vectors *v, const tm_mesh *m, int32_t tet, double at[3]) {
    double p[3] = {0};
    for (int k = 0; k < 12; k++) p[k % 3] += 0.25 * m->rest_m[3 * m->tet[4 * (int64_t)tet + k / 3] + k % 3];
    for (int k = 0; k < 3; k++) {
        at[k] = 0;
        for (int i = 0; i < 3; i++) at[k] += v->direction[3 * i + k] * (p[i] - v->origin_m[i]);
        at[k] /= v->spacing_m[k];
        if (!(at[k] >= -0.5 && at[k] <= v->size[k] - 0.5)) return false;
        at[k] = fmax(0, fmin(at[k], v->size[k] - 1));
    }
    return true;
}

/* Computes weight and unit vector of corner 0..7 of the cell around `at`; returns 0 if it has none. */
static double corner_of(const image_vectors *v, const double at[3], int corner, double axis[3]) {
    double weight = 1;
    size_t voxel = 0;
    for (int k = 2; k >= 0; k--) {
        const int below = (int)at[k], up = corner >> k & 1, last = v->size[k] - 1;
        const double part = at[k] - below;
        weight *= up ? part : 1 - part;
        voxel = voxel * (size_t)v->size[k] + (size_t)(below + up < last ? below + up : last);
    }
    for (int k = 0; k < 3; k++) axis[k] = (double)v->vector[3 * voxel + (size_t)k];
    const double length = vnorm(axis);
    if (!(length > 1e-6)) return 0; /* directions have a length near 1; voxels outside the tissue 0 */
    for (int k = 0; k < 3; k++) axis[k] /= length;
    return weight;
}

/* Computes the mean axis at a place, in the image's axes. */
static bool sample(const image_vectors *v, const double at[3], double out[3]) {
    double axis[8][3], weight[8], sum[3] = {0};
    int nearest = 0;
    for (int c = 0; c < 8; c++) {
        weight[c] = corner_of(v, at, c, axis[c]);
        if (weight[c] > weight[nearest]) nearest = c;
    }
    if (!(weight[nearest] > 0)) return false;
    for (int c = 0; c < 8; c++) {
        if (!(weight[c] > 0)) continue;
        const double turn = vdot(axis[c], axis[nearest]) < 0 ? -weight[c] : weight[c];
        for (int k = 0; k < 3; k++) sum[k] += turn * axis[c][k];
    }
    const double length = vnorm(sum); /* at least the nearest voxel's weight, since all signs agree with it */
    for (int k = 0; k < 3; k++) out[k] = sum[k] / length;
    return true;
}

static void to_world(const image_vectors *v, sim_fibre_axes axes, const double in[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = axes == SIM_FIBRES_RAS && i < 2 ? -in[i] : in[i];
        if (axes != SIM_FIBRES_IMAGE) continue;
        out[i] = 0;
        for (int k = 0; k < 3; k++) out[i] += v->direction[3 * i + k] * in[k];
    }
}

bool sim_fibres_from_image(const app_host *host, const tm_mesh *m, const char *path, sim_fibre_axes axes, double *fibre,
                           char why[SIM_FIBRES_WHY]) {
    tm_error error = {0};
    image_vectors v;
    char said[IMAGE_WHY] = "";
    void *module = app_host_module(host, "image", &error);
    const image_vectors_api *api = module ? dlsym(module, IMAGE_VECTORS_SYMBOL) : NULL;
    if (module && !api)
        tm_fail(&error, TM_ERR_FILE, -1, "the module image has another version; build both again: make, make image");
    if (!api) {
        snprintf(why, SIM_FIBRES_WHY, "%s: %s (make image)", path, error.message);
        return false;
    }
    if (api->read(path, &v, said)) {
        snprintf(why, SIM_FIBRES_WHY, "%s: %s", path, said);
        return false;
    }
    int32_t without = 0, first = 0;
    for (int32_t t = 0; t < m->tet_count; t++) {
        double at[3], axis[3];
        if (to_grid(&v, m, t, at) && sample(&v, at, axis))
            to_world(&v, axes, axis, fibre + 3 * (int64_t)t);
        else if (!without++)
            first = t;
    }
    free(v.vector);
    if (without)
        snprintf(why, SIM_FIBRES_WHY,
                 "%s: it has no vector at %d of %d tetrahedra, the first is %d; give an image that covers the mesh "
                 "(LPS, as tm-mesh image makes it)",
                 path, without, m->tet_count, first);
    return !without;
}
