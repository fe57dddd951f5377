/* Contents of a mesh file as its reader finds them. Arrays grow with the data; each tag is looked up once. */
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/order.h"
#include "mesh_raw.h"

enum { MAX_COUNT = INT32_MAX / 16 }; /* four corners and three coordinates of each fit an int32 */

const char *tm_io_find(const char *at, const char *end, const char *word, size_t length) {
    for (const char *p = at; (p = memchr(p, word[0], (size_t)(end - p))); p++)
        if ((size_t)(end - p) >= length && memcmp(p, word, length) == 0) return p;
    return NULL;
}

int tm_io_line(const char *start, const char *at) {
    int line = 1;
    for (; start < at; start++) line += *start == '\n';
    return line;
}

static tm_status no_memory(tm_error *error) {
    return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
}

/* Ensures capacity for one more item; arrays grow at powers of two. */
static bool capacity_for(void **array, int64_t count, size_t each) {
    if ((count & (count - 1)) != 0) return true;
    void *grown = count < MAX_COUNT ? realloc(*array, (size_t)(count ? 2 * count : 1) * each) : NULL;
    if (grown) *array = grown;
    return grown != NULL;
}

tm_status tm_io_add_vertex(tm_io_raw *raw, int64_t tag, const double p[3], tm_error *error) {
    if (!capacity_for((void **)&raw->vertex, raw->vertices, sizeof *raw->vertex)) return no_memory(error);
    raw->vertex[raw->vertices++] = (tm_io_vertex){tag, {p[0], p[1], p[2]}};
    return TM_OK;
}

static int by_tag(const void *a, const void *b) {
    const struct tm_io_rank *x = a, *y = b;
    return (x->tag > y->tag) - (x->tag < y->tag);
}

static tm_status twice(tm_error *error, const char *what, int64_t tag) {
    return tm_fail(error, TM_ERR_MESH, tag, "%s %lld occurs twice; renumber the mesh", what, (long long)tag);
}

tm_status tm_io_vertices_end(tm_io_raw *raw, tm_error *error) {
    int64_t n = 1;
    while (n < raw->vertices && raw->vertex[n].tag - 1 == raw->vertex[n - 1].tag) n++;
    if (n >= raw->vertices) return TM_OK;
    if (!(raw->ranked = malloc((size_t)raw->vertices * sizeof *raw->ranked))) return no_memory(error);
    for (int64_t v = 0; v < raw->vertices; v++) raw->ranked[v] = (struct tm_io_rank){raw->vertex[v].tag, (int32_t)v};
    qsort(raw->ranked, (size_t)raw->vertices, sizeof *raw->ranked, by_tag);
    for (int64_t v = 1; v < raw->vertices; v++)
        if (raw->ranked[v].tag == raw->ranked[v - 1].tag) return twice(error, "vertex", raw->ranked[v].tag);
    return TM_OK;
}

/* Returns the vertex with this tag, -1 if there is none. */
static int32_t vertex_of(const tm_io_raw *raw, int64_t tag) {
    if (!raw->ranked) {
        int64_t first = raw->vertices ? raw->vertex[0].tag : 0;
        return tag >= first && tag - first < raw->vertices ? (int32_t)(tag - first) : -1;
    }
    const struct tm_io_rank wanted = {tag, 0};
    const struct tm_io_rank *found = bsearch(&wanted, raw->ranked, (size_t)raw->vertices, sizeof *raw->ranked, by_tag);
    return found ? found->place : -1;
}

tm_status tm_io_add_element(tm_io_raw *raw, int64_t tag, int dim, int32_t entity, const int64_t *corner, int count,
                            tm_error *error) {
    tm_io_element e = {.tag = tag, .entity = entity, .dim = (int8_t)dim, .corners = (int8_t)count};
    for (int k = 0; k < count; k++)
        if ((e.corner[k] = vertex_of(raw, corner[k])) < 0)
            return tm_fail(error, TM_ERR_MESH, tag,
                           "element %lld has vertex %lld, which does not exist; save the mesh again", (long long)tag,
                           (long long)corner[k]);
    if (!capacity_for((void **)&raw->element, raw->elements, sizeof e)) return no_memory(error);
    raw->element[raw->elements++] = e;
    raw->tets += dim == 3;
    return TM_OK;
}

tm_status tm_io_add_member(tm_io_raw *raw, int dim, int32_t entity, int32_t group, tm_error *error) {
    const tm_io_member new = {dim, group, entity}, *last = raw->members ? raw->member + raw->members - 1 : NULL;
    if (last && memcmp(last, &new, sizeof new) == 0) return TM_OK;
    if (!capacity_for((void **)&raw->member, raw->members, sizeof new)) return no_memory(error);
    raw->member[raw->members++] = new;
    return TM_OK;
}

tm_status tm_io_add_name(tm_io_raw *raw, int dim, int32_t group, const char *name, size_t length, tm_error *error) {
    tm_io_name new = {.dim = dim, .group = group};
    if (length >= sizeof new.name)
        return tm_fail(error, TM_ERR_MESH, group,
                       "the name of physical group %d is longer than 63 characters; shorten it", group);
    memcpy(new.name, name, length);
    if (!capacity_for((void **)&raw->name, raw->names, sizeof new)) return no_memory(error);
    raw->name[raw->names++] = new;
    return TM_OK;
}

tm_status tm_io_higher_order(tm_error *error, int64_t element, int64_t type) {
    return tm_fail(error, TM_ERR_MESH, element,
                   "element %lld is of higher order (type %lld); save first-order elements (gmsh -order 1)",
                   (long long)element, (long long)type);
}

tm_status tm_io_other_volume(tm_error *error, int64_t element, const char *what) {
    return tm_fail(error, TM_ERR_MESH, element, "element %lld is a %s; mesh with tetrahedra only", (long long)element,
                   what);
}

static int by_group(const void *a, const void *b) {
    const tm_io_member *x = a, *y = b;
    if (x->dim != y->dim) return x->dim < y->dim ? -1 : 1;
    if (x->group != y->group) return x->group < y->group ? -1 : 1;
    return (x->entity > y->entity) - (x->entity < y->entity);
}

static int by_dim_and_group(const void *a, const void *b) {
    const tm_io_name *x = a, *y = b;
    if (x->dim != y->dim) return x->dim < y->dim ? -1 : 1;
    return (x->group > y->group) - (x->group < y->group);
}

static tm_status refuse_tet_twice(const tm_io_raw *raw, tm_error *error) {
    int64_t *tag = malloc(((size_t)raw->tets + 1) * sizeof *tag), n = 0;
    if (!tag) return no_memory(error);
    bool ascending = true;
    for (int64_t e = 0; e < raw->elements; e++) {
        if (raw->element[e].dim != 3) continue;
        tag[n++] = raw->element[e].tag;
        ascending = ascending && (n < 2 || tag[n - 2] < tag[n - 1]);
    }
    if (!ascending) qsort(tag, (size_t)n, sizeof *tag, num_ascending_int64);
    tm_status status = TM_OK;
    for (int64_t t = 1; t < n && !status; t++)
        if (tag[t] == tag[t - 1]) status = twice(error, "tetrahedron", tag[t]);
    free(tag);
    return status;
}

tm_status tm_io_raw_sort(tm_io_raw *raw, tm_error *error) {
    if (raw->tets == 0) return tm_fail(error, TM_ERR_MESH, -1, "it has no tetrahedra; mesh the volume (gmsh -3)");
    if (raw->members) qsort(raw->member, (size_t)raw->members, sizeof *raw->member, by_group);
    if (raw->names) qsort(raw->name, (size_t)raw->names, sizeof *raw->name, by_dim_and_group);
    int64_t kept = 0;
    for (int64_t i = 0; i < raw->members; i++)
        if (!i || by_group(&raw->member[i], &raw->member[i - 1]) != 0) raw->member[kept++] = raw->member[i];
    raw->members = kept;
    return refuse_tet_twice(raw, error);
}

void tm_io_raw_free(tm_io_raw *raw) {
    free(raw->vertex);
    free(raw->element);
    free(raw->member);
    free(raw->name);
    free(raw->ranked);
    *raw = (tm_io_raw){0};
}
