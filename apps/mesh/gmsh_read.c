/* The gmsh module's reader: nodes, four-node tetrahedra and physical groups out of Gmsh's model. Runs in a process of
 * its own. */
#include <gmshc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/mesh_parts.h"
#include "gmsh_module.h"

enum { TET4 = 4 };

typedef struct tagged {
    int64_t tag;
    double p[3];
} tagged;

static int by_tag(const void *a, const void *b) {
    const tagged *x = a, *y = b;
    return x->tag < y->tag ? -1 : x->tag > y->tag;
}

/* -1: not there. */
static int32_t index_of(const app_mesh *mesh, size_t tag) {
    int32_t low = 0, high = mesh->vertex_count;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (mesh->vertex_tag[middle] < (int64_t)tag)
            low = middle + 1;
        else
            high = middle;
    }
    return low < mesh->vertex_count && mesh->vertex_tag[low] == (int64_t)tag ? low : -1;
}

/* Any element that is not linear, or a volume element that is no tetrahedron. */
static tm_status refuse_other_elements(int64_t *tets, tm_error *error) {
    int *type = NULL, wrong = 0;
    size_t *count = NULL, **tag = NULL, **node = NULL, *nodes = NULL, types = 0, counts = 0, node_lists = 0;
    *tets = 0;
    gmshModelMeshGetElements(&type, &types, &tag, &count, &counts, &node, &nodes, &node_lists, -1, -1, &wrong);
    if (wrong) return tm_gmsh_failed(error, "its elements cannot be read");
    for (size_t i = 0; i < types; i++) {
        char *name = NULL;
        double *local = NULL;
        int dim = 0, order = 0, corners = 0, primary = 0;
        size_t locals = 0;
        gmshModelMeshGetElementProperties(type[i], &name, &dim, &order, &corners, &local, &locals, &primary, &wrong);
        if (type[i] == TET4) *tets += (int64_t)count[i];
        if (wrong || !count[i]) continue;
        if (order > 1)
            return app_mesh_fail(error, TM_ERR_MESH, (int64_t)tag[i][0],
                                 "element %zu is of order %d (%s); save first-order elements (gmsh -order 1)",
                                 tag[i][0], order, name);
        if (dim == 3 && type[i] != TET4)
            return app_mesh_fail(error, TM_ERR_MESH, (int64_t)tag[i][0],
                                 "element %zu is a %s; mesh with tetrahedra alone", tag[i][0], name);
    }
    if (*tets == 0) return app_mesh_fail(error, TM_ERR_MESH, -1, "no tetrahedra in it; mesh the volume (gmsh -3)");
    return TM_OK;
}

static tm_status read_nodes(app_mesh *mesh, tagged **nodes, tm_error *error) {
    size_t *tag = NULL, tags = 0, coordinates = 0, parameters = 0;
    double *coordinate = NULL, *parameter = NULL;
    int wrong = 0;
    gmshModelMeshGetNodes(&tag, &tags, &coordinate, &coordinates, &parameter, &parameters, -1, -1, 0, 0, &wrong);
    if (wrong || coordinates != 3 * tags || tags > INT32_MAX / 4)
        return tm_gmsh_failed(error, "its vertices cannot be read");
    if (!(*nodes = malloc((tags + 1) * sizeof **nodes)))
        return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh");
    for (size_t i = 0; i < tags; i++) {
        (*nodes)[i].tag = (int64_t)tag[i];
        memcpy((*nodes)[i].p, coordinate + 3 * i, 3 * sizeof(double));
    }
    qsort(*nodes, tags, sizeof **nodes, by_tag);
    size_t kept = 0;
    for (size_t i = 0; i < tags; i++)
        if (!i || (*nodes)[i].tag != (*nodes)[i - 1].tag) (*nodes)[kept++] = (*nodes)[i];
    mesh->vertex_count = (int32_t)kept;
    gmshFree(tag);
    gmshFree(coordinate);
    return TM_OK;
}

/* Regions: the 3D physical groups, and one more, unnamed, if a volume is in none. */
typedef struct regions {
    int *tag;
    int32_t count;
    bool rest; /* some volume is in no physical group */
} regions;

static int32_t region_of_entity(const regions *r, int entity) {
    int *group = NULL, wrong = 0, first = -1;
    size_t groups = 0;
    gmshModelGetPhysicalGroupsForEntity(3, entity, &group, &groups, &wrong);
    for (size_t i = 0; !wrong && i < groups; i++)
        for (int g = 0; g < r->count; g++)
            if (r->tag[g] == abs(group[i]) && (first < 0 || g < first)) first = g;
    gmshFree(group);
    return first >= 0 ? first : r->count;
}

typedef struct element {
    int64_t tag;
    int32_t v[4], region;
} element;

static int by_element_tag(const void *a, const void *b) {
    const element *x = a, *y = b;
    return x->tag < y->tag ? -1 : x->tag > y->tag;
}

static tm_status read_tets(const app_mesh *mesh, regions *r, element *out, int64_t room, tm_error *error) {
    int *entity = NULL, wrong = 0;
    size_t entities = 0, n = 0;
    gmshModelGetEntities(&entity, &entities, 3, &wrong);
    for (size_t e = 0; e + 1 < entities; e += 2) {
        size_t *tag = NULL, *node = NULL, tags = 0, nodes = 0;
        gmshModelMeshGetElementsByType(TET4, &tag, &tags, &node, &nodes, entity[e + 1], 0, 1, &wrong);
        if (wrong || nodes != 4 * tags || (int64_t)(n + tags) > room)
            return tm_gmsh_failed(error, "its tetrahedra cannot be read");
        int32_t region = region_of_entity(r, entity[e + 1]);
        if (tags && region == r->count) r->rest = true;
        for (size_t t = 0; t < tags; t++, n++) {
            out[n].tag = (int64_t)tag[t];
            out[n].region = region;
            for (int k = 0; k < 4; k++)
                if ((out[n].v[k] = index_of(mesh, node[4 * t + (size_t)k])) < 0)
                    return app_mesh_fail(error, TM_ERR_MESH, (int64_t)tag[t],
                                         "tetrahedron %zu names vertex %zu, which is not there; write the mesh anew",
                                         tag[t], node[4 * t + (size_t)k]);
        }
        gmshFree(tag);
        gmshFree(node);
    }
    if ((int64_t)n != room) return tm_gmsh_failed(error, "some tetrahedra are in no volume");
    qsort(out, n, sizeof *out, by_element_tag);
    return TM_OK;
}

typedef struct groups {
    int32_t count, members, room;
    char (*name)[64];
    int32_t *begin, *vertex;
} groups;

static tm_status group_name(int dim, int tag, char out[64], tm_error *error) {
    static const char *const plain[] = {"point", "line", "surface", "volume"};
    char *name = NULL;
    int wrong = 0;
    gmshModelGetPhysicalName(dim, tag, &name, &wrong);
    int length = !wrong && name && *name ? snprintf(out, 64, "%s", name) : snprintf(out, 64, "%s_%d", plain[dim], tag);
    gmshFree(name);
    if (length >= 64)
        return app_mesh_fail(error, TM_ERR_MESH, tag,
                             "the name of physical group %d is longer than 63 letters; shorten it", tag);
    return TM_OK;
}

static int by_value(const void *a, const void *b) {
    int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* The vertices of one more group, ascending, each once. Groups of one name in several dimensions become one. */
static tm_status read_groups(const app_mesh *mesh, const int *group, size_t length, groups *out, tm_error *error) {
    size_t kinds = length / 2;
    out->name = calloc(kinds + 1, sizeof *out->name);
    out->begin = calloc(kinds + 2, sizeof *out->begin);
    char(*name)[64] = calloc(kinds + 1, sizeof *name);
    if (!out->name || !out->begin || !name) return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh");
    for (size_t g = 0; g < kinds; g++) {
        tm_status status = group_name(group[2 * g], group[2 * g + 1], name[g], error);
        if (status) return status;
    }
    for (size_t g = 0; g < kinds; g++) {
        bool seen = false;
        for (size_t h = 0; h < g; h++) seen = seen || strcmp(name[g], name[h]) == 0;
        if (seen) continue;
        int32_t begin = out->members;
        for (size_t h = g; h < kinds; h++) {
            if (strcmp(name[g], name[h]) != 0) continue;
            size_t *tag = NULL, tags = 0, coordinates = 0;
            double *coordinate = NULL;
            int wrong = 0;
            gmshModelMeshGetNodesForPhysicalGroup(group[2 * h], group[2 * h + 1], &tag, &tags, &coordinate,
                                                  &coordinates, &wrong);
            int32_t *grown = realloc(out->vertex, ((size_t)out->members + tags + 1) * sizeof *grown);
            if (wrong || !grown) return tm_gmsh_failed(error, "a physical group cannot be read");
            out->vertex = grown;
            for (size_t i = 0; i < tags; i++) {
                int32_t v = index_of(mesh, tag[i]);
                if (v >= 0) out->vertex[out->members++] = v;
            }
            gmshFree(tag);
            gmshFree(coordinate);
        }
        qsort(out->vertex + begin, (size_t)(out->members - begin), sizeof(int32_t), by_value);
        int32_t kept = begin;
        for (int32_t i = begin; i < out->members; i++)
            if (i == begin || out->vertex[i] != out->vertex[i - 1]) out->vertex[kept++] = out->vertex[i];
        out->members = kept;
        memcpy(out->name[out->count], name[g], sizeof name[g]);
        out->begin[++out->count] = kept;
    }
    free(name);
    return TM_OK;
}

static tm_status assemble(app_mesh *mesh, const tagged *node, const element *tet, const groups *g, const regions *r,
                          tm_error *error) {
    mesh->group_count = g->count;
    mesh->region_count = r->count + (r->rest || r->count == 0);
    int64_t *tags = mesh->vertex_tag;
    if (!app_mesh_allocate(mesh, g->members)) return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh");
    free(tags);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        mesh->vertex_tag[v] = node[v].tag;
        memcpy(mesh->vertex_m + 3 * (size_t)v, node[v].p, sizeof node[v].p);
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        mesh->tet_tag[t] = tet[t].tag;
        mesh->region[t] = tet[t].region;
        memcpy(mesh->tet + 4 * (size_t)t, tet[t].v, sizeof tet[t].v);
    }
    for (int i = 0; i < r->count; i++) {
        tm_status status = group_name(3, r->tag[i], mesh->region_name[i], error);
        if (status) return status;
    }
    memcpy(mesh->group_name, g->name, (size_t)g->count * sizeof *g->name);
    memcpy(mesh->group_begin, g->begin, ((size_t)g->count + 1) * sizeof(int32_t));
    if (g->members) memcpy(mesh->group_vertex, g->vertex, (size_t)g->members * sizeof(int32_t));
    return TM_OK;
}

/* Memory is left to the end of the process on failure: it is about to come. */
static tm_status read_model(app_mesh *mesh, tm_error *error) {
    int64_t tets = 0;
    tagged *node = NULL;
    regions r = {0};
    groups g = {0};
    int *group = NULL, *volume = NULL, wrong = 0;
    size_t length = 0, volumes = 0;
    tm_status status = refuse_other_elements(&tets, error);
    if (status || (status = read_nodes(mesh, &node, error))) return status;
    mesh->tet_count = (int32_t)tets;
    element *tet = malloc((size_t)tets * sizeof *tet);
    mesh->vertex_tag = malloc(((size_t)mesh->vertex_count + 1) * sizeof *mesh->vertex_tag);
    if (!tet || !mesh->vertex_tag || tets > INT32_MAX / 16)
        return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh");
    for (int32_t v = 0; v < mesh->vertex_count; v++) mesh->vertex_tag[v] = node[v].tag;
    gmshModelGetPhysicalGroups(&volume, &volumes, 3, &wrong);
    r.tag = malloc((volumes + 1) * sizeof *r.tag);
    if (wrong || !r.tag) return tm_gmsh_failed(error, "its physical groups cannot be read");
    for (size_t i = 0; i + 1 < volumes; i += 2) r.tag[r.count++] = volume[i + 1];
    if ((status = read_tets(mesh, &r, tet, tets, error))) return status;
    gmshModelGetPhysicalGroups(&group, &length, -1, &wrong);
    if (wrong) return tm_gmsh_failed(error, "its physical groups cannot be read");
    if ((status = read_groups(mesh, group, length, &g, error))) return status;
    return assemble(mesh, node, tet, &g, &r, error);
}

__attribute__((visibility("default"))) tm_status tm_gmsh_read(const char *path, app_mesh *mesh, tm_error *error) {
    tm_status status = tm_gmsh_open(path, error);
    return status ? status : read_model(mesh, error);
}
