/* Converts cells of VTK's files to tetrahedra and triangles. */
#include "vtk_cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

tm_status tm_io_vtk_bad(const tm_io_vtk *v, const char *what) {
    return tm_fail(v->error, TM_ERR_FILE, -1, "%s; save it again", what);
}
tm_status tm_io_vtk_no_memory(const tm_io_vtk *v) {
    return tm_fail(v->error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
}

void tm_io_vtk_free(tm_io_vtk *v) {
    free(v->point);
    free(v->offset);
    free(v->corner);
    free(v->cell_type);
    free(v->region);
    free(v->name);
    for (int32_t g = 0; g < v->groups; g++) free(v->group[g].in);
    free(v->group);
    *v = (tm_io_vtk){.error = v->error};
}

bool tm_io_vtk_name(tm_io_vtk *v, int64_t region, const char *name) {
    void *grown = realloc(v->name, ((size_t)v->names + 1) * sizeof *v->name);
    if (!grown) return false;
    v->name = grown;
    v->name[v->names].region = region;
    snprintf(v->name[v->names++].text, sizeof v->name->text, "%s", name);
    return true;
}

uint8_t *tm_io_vtk_group_add(tm_io_vtk *v, const char *name) {
    uint8_t *in = calloc((size_t)v->points + 1, 1);
    void *grown = in ? realloc(v->group, ((size_t)v->groups + 1) * sizeof *v->group) : NULL;
    if (!grown) {
        free(in);
        return NULL;
    }
    v->group = grown;
    v->group[v->groups].in = in;
    snprintf(v->group[v->groups++].name, sizeof v->group->name, "%s", name);
    return in;
}

tm_status tm_io_vtk_check(const tm_io_vtk *v, int64_t corners) {
    for (int64_t c = 0; c < v->cells; c++) {
        if (v->offset[c] < 0 || v->offset[c] > v->offset[c + 1] || v->offset[c + 1] > corners)
            return tm_io_vtk_bad(v, "its OFFSETS are not ascending");
        for (int64_t k = v->offset[c]; k < v->offset[c + 1]; k++)
            if (v->corner[k] < 0 || v->corner[k] >= v->points)
                return tm_fail(v->error, TM_ERR_MESH, c + 1,
                               "cell %lld has vertex %lld, which does not exist; save the mesh again", (long long)c,
                               (long long)v->corner[k]);
    }
    return TM_OK;
}

/* --- tetrahedra --- */

static tm_status check_kind(const tm_io_vtk *v, int64_t c) {
    enum { FLAT = 9 };
    static const int flat[FLAT + 1] = {0, 1, 0, 2, 0, 3, 0, 0, 4, 4}; /* number of corners, 0: any */
    const int64_t type = v->cell_type[c], corners = v->offset[c + 1] - v->offset[c];
    if (type >= 0 && type <= FLAT && (!flat[type] || corners == flat[type])) return TM_OK;
    if (type >= VTK_QUADRATIC)
        return tm_fail(v->error, TM_ERR_MESH, c + 1,
                       "cell %lld is of higher order (type %lld); save first-order tetrahedra", (long long)c,
                       (long long)type);
    if (type == VTK_TETRA && corners == 4) return TM_OK;
    return tm_fail(v->error, TM_ERR_MESH, c + 1,
                   "cell %lld is not a tetrahedron (type %lld, %lld vertices); mesh with tetrahedra only", (long long)c,
                   (long long)type, (long long)corners);
}

/* Adds regions as groups of the entities with their number; without any, one unnamed region. */
static tm_status add_regions(const tm_io_vtk *v, tm_io_raw *raw) {
    tm_status status = TM_OK;
    int64_t most = -1;
    for (int64_t c = 0; c < v->cells && v->region; c++)
        if (v->cell_type[c] == VTK_TETRA) most = v->region[c] > most ? v->region[c] : most;
    if (most <= 0 && !v->names) return TM_OK; /* one unnamed region */
    for (int64_t r = 0; r <= most && !status; r++) {
        char name[64];
        snprintf(name, sizeof name, "region_%lld", (long long)r);
        for (int32_t n = 0; n < v->names; n++)
            if (v->name[n].region == r) memcpy(name, v->name[n].text, sizeof name);
        status = tm_io_add_member(raw, 3, (int32_t)r, (int32_t)r + 1, v->error);
        if (!status && *name) status = tm_io_add_name(raw, 3, (int32_t)r + 1, name, strlen(name), v->error);
    }
    return status;
}

static tm_status add_groups(const tm_io_vtk *v, tm_io_raw *raw) {
    tm_status status = TM_OK;
    int64_t tag = v->cells;
    for (int32_t g = 0; g < v->groups && !status; g++) {
        status = tm_io_add_member(raw, 0, g + 1, g + 1, v->error);
        if (!status) status = tm_io_add_name(raw, 0, g + 1, v->group[g].name, strlen(v->group[g].name), v->error);
        for (int64_t p = 0; p < v->points && !status; p++) {
            const int64_t corner = p + 1;
            if (v->group[g].in[p]) status = tm_io_add_element(raw, ++tag, 0, g + 1, &corner, 1, v->error);
        }
    }
    return status;
}

/* Tags number vertices and cells of the file from 1. */
tm_status tm_io_vtk_tets(const tm_io_vtk *v, tm_io_raw *raw) {
    tm_status status = TM_OK;
    for (int64_t c = 0; c < v->cells && !status; c++) status = check_kind(v, c);
    for (int64_t p = 0; p < v->points && !status; p++)
        status = tm_io_add_vertex(raw, p + 1, v->point + 3 * p, v->error);
    if (!status) status = tm_io_vertices_end(raw, v->error);
    for (int64_t c = 0; c < v->cells && !status; c++) {
        const int64_t *k = v->corner + v->offset[c], region = v->region ? v->region[c] : 0;
        if (v->cell_type[c] != VTK_TETRA) continue;
        if (region < 0 || region > 65535)
            return tm_fail(v->error, TM_ERR_MESH, c + 1, "cell %lld has region %lld; give regions 0 to 65535",
                           (long long)c, (long long)region);
        const int64_t corner[4] = {k[0] + 1, k[1] + 1, k[2] + 1, k[3] + 1};
        status = tm_io_add_element(raw, c + 1, 3, (int32_t)region, corner, 4, v->error);
    }
    if (!status && v->region) status = add_regions(v, raw);
    return status ? status : add_groups(v, raw);
}

/* --- triangles --- */

/* Returns the number of triangles of a cell; -1 for a volume or a higher order. */
static int64_t triangles_of(const tm_io_vtk *v, int64_t c) {
    const int64_t type = v->cell_type ? v->cell_type[c] : VTK_POLYGON, corners = v->offset[c + 1] - v->offset[c];
    const bool flat = type == VTK_TRIANGLE || type == VTK_STRIP || type == VTK_POLYGON || type == VTK_QUAD;
    if (flat) return corners < 3 ? 0 : corners - 2;
    return type >= 0 && type < VTK_TRIANGLE ? 0 : -1; /* points and lines are skipped */
}

tm_status tm_io_vtk_triangles(const tm_io_vtk *v, double **corner, int32_t *triangles) {
    int64_t count = 0;
    for (int64_t c = 0; c < v->cells; c++) {
        const int64_t more = triangles_of(v, c);
        if (more < 0)
            return tm_fail(
                v->error, TM_ERR_MESH, c + 1,
                "cell %lld is neither triangle nor polygon (type %lld), so this is not a surface; extract one "
                "(ParaView: Extract Surface)",
                (long long)c, (long long)v->cell_type[c]);
        count += more;
    }
    if (!count || count > INT32_MAX / 64)
        return tm_fail(v->error, TM_ERR_MESH, -1, "it has %lld triangles; save the surface again", (long long)count);
    double *to = *corner = malloc(9 * (size_t)count * sizeof *to);
    if (!to) return tm_io_vtk_no_memory(v);
    for (int64_t c = 0; c < v->cells; c++) {
        const int64_t *k = v->corner + v->offset[c], more = triangles_of(v, c);
        const bool strip = v->cell_type && v->cell_type[c] == VTK_STRIP;
        for (int64_t t = 0; t < more; t++) {
            /* every second triangle of a strip is flipped */
            const int64_t of[3] = {strip ? k[t + (t & 1)] : k[0], strip ? k[t + 1 - (t & 1)] : k[t + 1], k[t + 2]};
            for (int i = 0; i < 3; i++, to += 3) memcpy(to, v->point + 3 * of[i], 3 * sizeof *to);
        }
    }
    for (int64_t i = 0; i < 9 * count; i++)
        if (!isfinite((*corner)[i]))
            return tm_fail(v->error, TM_ERR_MESH, i / 9, "a coordinate is nan or infinite; save the surface again");
    *triangles = (int32_t)count;
    return TM_OK;
}
