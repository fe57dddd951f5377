/* Builds regions and groups of vertices from the physical groups of a mesh file. Groups ascend by dimension and number;
 * groups with equal names are merged. */
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/order.h"
#include "mesh_raw.h"

enum { MAX_MEMBERS = INT32_MAX / 16 };

static tm_status no_memory(tm_error *error) {
    return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the groups of the mesh; use fewer");
}

/* The elements of one entity and their vertices. */
typedef struct part {
    int32_t dim, entity, vertices, region;
    int32_t *vertex;
} part;

/* A physical group: members [begin, end) of the raw mesh. */
typedef struct group {
    char name[64];
    int64_t begin, end;
    int32_t same; /* next group with this name, -1 */
    bool first;   /* first with its name */
} group;

typedef struct work {
    const tm_io_raw *raw;
    int32_t parts, groups;
    part *part;
    group *group;
    int32_t *part_of; /* [elements] */
} work;

static int by_place(const void *a, const void *b) {
    const part *x = a, *y = b;
    if (x->dim != y->dim) return x->dim < y->dim ? -1 : 1;
    return (x->entity > y->entity) - (x->entity < y->entity);
}

static int32_t find_part(const work *w, int32_t dim, int32_t entity) {
    const part wanted = {.dim = dim, .entity = entity};
    const part *found = w->parts ? bsearch(&wanted, w->part, (size_t)w->parts, sizeof wanted, by_place) : NULL;
    return found ? (int32_t)(found - w->part) : -1;
}

/* --- parts --- */

static bool find_parts(work *w) {
    const tm_io_raw *raw = w->raw;
    const tm_io_element *e = raw->element;
    w->part = calloc((size_t)raw->elements + 1, sizeof *w->part);
    w->part_of = malloc(((size_t)raw->elements + 1) * sizeof *w->part_of);
    if (!w->part || !w->part_of) return false;
    int32_t found = 0;
    for (int64_t i = 0; i < raw->elements; i++)
        if (!i || e[i].dim != e[i - 1].dim || e[i].entity != e[i - 1].entity)
            w->part[found++] = (part){.dim = e[i].dim, .entity = e[i].entity, .region = -1};
    qsort(w->part, (size_t)found, sizeof *w->part, by_place);
    for (int32_t i = 0; i < found; i++)
        if (!i || by_place(&w->part[i], &w->part[i - 1]) != 0) w->part[w->parts++] = w->part[i];
    for (int64_t i = 0; i < raw->elements; i++)
        w->part_of[i] = i && e[i].dim == e[i - 1].dim && e[i].entity == e[i - 1].entity
                            ? w->part_of[i - 1]
                            : find_part(w, e[i].dim, e[i].entity);
    return true;
}

/* Finds each part's vertices, each once: groups elements by part, with a mark per vertex. */
static bool find_vertices(work *w) {
    const tm_io_raw *raw = w->raw;
    int64_t *begin = calloc((size_t)w->parts + 2, sizeof *begin);
    int32_t *order = malloc(((size_t)raw->elements + 1) * sizeof *order);
    int32_t *mark = calloc((size_t)raw->vertices + 1, sizeof *mark);
    int32_t *seen = malloc(((size_t)raw->vertices + 1) * sizeof *seen);
    bool good = begin && order && mark && seen;
    for (int64_t i = 0; good && i < raw->elements; i++) begin[w->part_of[i] + 2]++;
    for (int32_t p = 0; good && p < w->parts; p++) begin[p + 2] += begin[p + 1];
    for (int64_t i = 0; good && i < raw->elements; i++) order[begin[w->part_of[i] + 1]++] = (int32_t)i;
    for (int32_t p = 0; good && p < w->parts; p++) {
        int32_t count = 0;
        for (int64_t i = begin[p]; i < begin[p + 1]; i++) {
            const tm_io_element *e = &raw->element[order[i]];
            for (int k = 0; k < e->corners; k++)
                if (mark[e->corner[k]] != p + 1) mark[seen[count++] = e->corner[k]] = p + 1;
        }
        good = (w->part[p].vertex = malloc(((size_t)count + 1) * sizeof(int32_t))) != NULL;
        if (good) memcpy(w->part[p].vertex, seen, (size_t)count * sizeof *seen);
        w->part[p].vertices = count;
    }
    free(begin);
    free(order);
    free(mark);
    free(seen);
    return good;
}

/* --- groups --- */

static void name_of(const tm_io_raw *raw, int32_t dim, int32_t tag, char out[64]) {
    static const char *const plain[] = {"point", "line", "surface", "volume"};
    int64_t low = 0, high = raw->names;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        const tm_io_name *n = &raw->name[middle];
        if (n->dim < dim || (n->dim == dim && n->group < tag))
            low = middle + 1;
        else
            high = middle;
    }
    const tm_io_name *found = low < raw->names ? &raw->name[low] : NULL;
    if (found && found->dim == dim && found->group == tag && found->name[0])
        memcpy(out, found->name, 64);
    else
        snprintf(out, 64, "%s_%d", plain[dim], tag);
}

static bool find_groups(work *w) {
    const tm_io_raw *raw = w->raw;
    const tm_io_member *m = raw->member;
    if (!(w->group = calloc((size_t)raw->members + 1, sizeof *w->group))) return false;
    for (int64_t i = 0; i < raw->members; i++) {
        if (!i || m[i].dim != m[i - 1].dim || m[i].group != m[i - 1].group) {
            group *g = &w->group[w->groups++];
            *g = (group){.begin = i, .same = -1, .first = true};
            name_of(raw, m[i].dim, m[i].group, g->name);
        }
        w->group[w->groups - 1].end = i + 1;
    }
    return true;
}

typedef struct named {
    const group *g;
} named;

static int by_name(const void *a, const void *b) {
    const group *x = ((const named *)a)->g, *y = ((const named *)b)->g;
    int order = strcmp(x->name, y->name);
    return order ? order : (x > y) - (x < y);
}

static bool join_names(work *w) {
    named *sorted = malloc(((size_t)w->groups + 1) * sizeof *sorted);
    if (!sorted) return false;
    for (int32_t g = 0; g < w->groups; g++) sorted[g].g = &w->group[g];
    qsort(sorted, (size_t)w->groups, sizeof *sorted, by_name);
    for (int32_t i = 1; i < w->groups; i++) {
        const int32_t before = (int32_t)(sorted[i - 1].g - w->group), here = (int32_t)(sorted[i].g - w->group);
        if (strcmp(w->group[before].name, w->group[here].name) != 0) continue;
        w->group[before].same = here;
        w->group[here].first = false;
    }
    free(sorted);
    return true;
}

/* --- into the mesh --- */

/* Gathers the vertices of group g and of the others with its name, ascending. Only counts if `out` is null. Returns -1
 * if there are too many. */
static int64_t gather(const work *w, int32_t g, int32_t *mark, int32_t *out) {
    int64_t count = 0, looked = 0;
    for (int32_t i = g; i >= 0; i = w->group[i].same)
        for (int64_t j = w->group[i].begin; j < w->group[i].end; j++) {
            int32_t p = find_part(w, w->raw->member[j].dim, w->raw->member[j].entity);
            if (p < 0) continue;
            if ((looked += w->part[p].vertices) > MAX_MEMBERS) return -1;
            for (int32_t k = 0; k < w->part[p].vertices; k++) {
                int32_t v = w->part[p].vertex[k];
                if (mark[v] == g + 1) continue;
                mark[v] = g + 1;
                if (out) out[count] = v;
                count++;
            }
        }
    if (out) qsort(out, (size_t)count, sizeof *out, num_ascending_int32);
    return count;
}

static tm_status put_groups(const work *w, tm_mesh_file *mesh, tm_error *error) {
    size_t vertices = (size_t)mesh->vertex_count + 1;
    int32_t *mark = calloc(vertices, sizeof *mark);
    int64_t members = 0;
    for (int32_t g = 0; mark && g < w->groups && members >= 0; g++) {
        int64_t more = w->group[g].first ? gather(w, g, mark, NULL) : 0;
        members = more < 0 || members + more > MAX_MEMBERS ? -1 : members + more;
        mesh->group_count += w->group[g].first;
    }
    mesh->group_vertex = mark && members >= 0 ? malloc(((size_t)members + 1) * sizeof(int32_t)) : NULL;
    mesh->group_begin = calloc((size_t)mesh->group_count + 1, sizeof(int32_t));
    mesh->group_name = calloc((size_t)mesh->group_count + 1, sizeof *mesh->group_name);
    bool good = mesh->group_vertex && mesh->group_begin && mesh->group_name;
    if (good) memset(mark, 0, vertices * sizeof *mark);
    for (int32_t g = 0, n = 0; good && g < w->groups; g++) {
        if (!w->group[g].first) continue;
        memcpy(mesh->group_name[n], w->group[g].name, sizeof *mesh->group_name);
        mesh->group_begin[n + 1] =
            mesh->group_begin[n] + (int32_t)gather(w, g, mark, mesh->group_vertex + mesh->group_begin[n]);
        n++;
    }
    free(mark);
    return good ? TM_OK : no_memory(error);
}

/* Sets the regions. A volume in several groups belongs to the first; volumes in none form one more region, without a
 * name. */
static tm_status put_regions(const work *w, tm_mesh_file *mesh, tm_error *error) {
    const tm_io_raw *raw = w->raw;
    int32_t regions = 0;
    bool rest = false;
    for (int32_t g = 0; g < w->groups; g++) {
        if (raw->member[w->group[g].begin].dim != 3) continue;
        for (int64_t j = w->group[g].begin; j < w->group[g].end; j++) {
            int32_t p = find_part(w, 3, raw->member[j].entity);
            if (p >= 0 && w->part[p].region < 0) w->part[p].region = regions;
        }
        regions++;
    }
    for (int32_t p = 0; p < w->parts; p++) rest = rest || (w->part[p].dim == 3 && w->part[p].region < 0);
    mesh->region_count = regions + rest;
    if (!(mesh->region_name = calloc((size_t)mesh->region_count + 1, sizeof *mesh->region_name)))
        return no_memory(error);
    for (int32_t g = 0, r = 0; g < w->groups; g++)
        if (raw->member[w->group[g].begin].dim == 3)
            memcpy(mesh->region_name[r++], w->group[g].name, sizeof *mesh->region_name);
    for (int64_t i = 0, t = 0; i < raw->elements; i++)
        if (raw->element[i].dim == 3) {
            int32_t region = w->part[w->part_of[i]].region;
            mesh->region[t++] = region >= 0 ? region : regions;
        }
    return TM_OK;
}

tm_status tm_io_raw_groups(const tm_io_raw *raw, tm_mesh_file *mesh, tm_error *error) {
    work w = {.raw = raw};
    bool good = find_parts(&w) && find_vertices(&w) && find_groups(&w) && join_names(&w);
    tm_status status = good ? put_regions(&w, mesh, error) : no_memory(error);
    if (!status) status = put_groups(&w, mesh, error);
    for (int32_t p = 0; p < w.parts; p++) free(w.part[p].vertex);
    free(w.part);
    free(w.part_of);
    free(w.group);
    return status;
}
