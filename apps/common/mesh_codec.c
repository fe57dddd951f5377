/* A mesh as one block of bytes: what the cache holds and what the reading process sends. */
#include <stdlib.h>
#include <string.h>

#include "mesh_parts.h"

static const char magic[8] = "TMMESH\0";
enum { FORMAT = 1, ORDER_MARK = 0x01020304 };

typedef struct header {
    char magic[8];
    uint32_t format, order_mark; /* a foreign byte order does not read as ORDER_MARK */
    uint64_t hash, payload_bytes, payload_hash;
    int32_t vertex_count, tet_count, region_count, group_count, group_vertex_count, zero;
} header;

typedef struct section {
    void *data;
    size_t bytes;
} section;

enum { SECTIONS = 9 };

/* The arrays in the order of the block: widest first, so that each is aligned. */
static void sections(const app_mesh *m, size_t group_vertices, section out[SECTIONS]) {
    size_t v = (size_t)m->vertex_count, t = (size_t)m->tet_count, r = (size_t)m->region_count,
           g = (size_t)m->group_count;
    const section all[SECTIONS] = {
        {m->vertex_m, 3 * v * sizeof(double)},
        {m->vertex_tag, v * sizeof(int64_t)},
        {m->tet_tag, t * sizeof(int64_t)},
        {m->tet, 4 * t * sizeof(int32_t)},
        {m->region, t * sizeof(int32_t)},
        {m->group_begin, (g + 1) * sizeof(int32_t)},
        {m->group_vertex, group_vertices * sizeof(int32_t)},
        {m->region_name, r * sizeof *m->region_name},
        {m->group_name, g * sizeof *m->group_name},
    };
    memcpy(out, all, sizeof all);
}

bool app_mesh_allocate(app_mesh *mesh, int32_t group_vertex_count) {
    size_t v = (size_t)mesh->vertex_count, t = (size_t)mesh->tet_count;
    size_t r = (size_t)mesh->region_count, g = (size_t)mesh->group_count, n = (size_t)group_vertex_count;
    mesh->vertex_m = calloc(3 * v + 1, sizeof(double));
    mesh->vertex_tag = calloc(v + 1, sizeof(int64_t));
    mesh->tet_tag = calloc(t + 1, sizeof(int64_t));
    mesh->tet = calloc(4 * t + 1, sizeof(int32_t));
    mesh->region = calloc(t + 1, sizeof(int32_t));
    mesh->group_begin = calloc(g + 1, sizeof(int32_t));
    mesh->group_vertex = calloc(n + 1, sizeof(int32_t));
    mesh->region_name = calloc(r + 1, sizeof *mesh->region_name);
    mesh->group_name = calloc(g + 1, sizeof *mesh->group_name);
    if (mesh->vertex_m && mesh->vertex_tag && mesh->tet_tag && mesh->tet && mesh->region && mesh->group_begin &&
        mesh->group_vertex && mesh->region_name && mesh->group_name)
        return true;
    app_mesh_free(mesh);
    return false;
}

void app_mesh_free(app_mesh *mesh) {
    free(mesh->vertex_m);
    free(mesh->vertex_tag);
    free(mesh->tet_tag);
    free(mesh->tet);
    free(mesh->region);
    free(mesh->group_begin);
    free(mesh->group_vertex);
    free(mesh->region_name);
    free(mesh->group_name);
    memset(mesh, 0, sizeof *mesh);
}

void *app_mesh_encode(const app_mesh *mesh, size_t *size) {
    section part[SECTIONS];
    int32_t group_vertices = mesh->group_begin[mesh->group_count];
    sections(mesh, (size_t)group_vertices, part);
    size_t bytes = 0;
    for (int i = 0; i < SECTIONS; i++) bytes += part[i].bytes;
    char *block = malloc(sizeof(header) + bytes);
    if (!block) return NULL;
    char *at = block + sizeof(header);
    for (int i = 0; i < SECTIONS; i++) {
        if (part[i].bytes) memcpy(at, part[i].data, part[i].bytes);
        at += part[i].bytes;
    }
    header head = {.format = FORMAT,
                   .order_mark = ORDER_MARK,
                   .hash = mesh->hash,
                   .payload_bytes = bytes,
                   .payload_hash = tm_hash(block + sizeof head, bytes, TM_HASH_SEED),
                   .vertex_count = mesh->vertex_count,
                   .tet_count = mesh->tet_count,
                   .region_count = mesh->region_count,
                   .group_count = mesh->group_count,
                   .group_vertex_count = group_vertices};
    memcpy(head.magic, magic, sizeof magic);
    memcpy(block, &head, sizeof head);
    *size = sizeof head + bytes;
    return block;
}

static tm_status damaged(tm_error *error, const char *what) {
    return app_mesh_fail(error, TM_ERR_FILE, -1, "damaged mesh block: %s; delete the mesh cache", what);
}

/* Indices and names in their ranges: a block with a right checksum may still come from a wrong hand. */
static const char *unsound(const app_mesh *m) {
    for (int64_t i = 0; i < 4 * (int64_t)m->tet_count; i++)
        if (m->tet[i] < 0 || m->tet[i] >= m->vertex_count) return "a vertex index out of range";
    for (int32_t i = 0; i < m->tet_count; i++)
        if (m->region[i] < 0 || m->region[i] >= m->region_count) return "a region index out of range";
    if (m->group_begin[0] != 0) return "groups do not begin at 0";
    for (int32_t g = 0; g < m->group_count; g++) {
        if (m->group_begin[g + 1] < m->group_begin[g]) return "group bounds descend";
        if (!memchr(m->group_name[g], 0, sizeof m->group_name[g])) return "a group name without end";
    }
    for (int32_t r = 0; r < m->region_count; r++)
        if (!memchr(m->region_name[r], 0, sizeof m->region_name[r])) return "a region name without end";
    for (int32_t i = 0; i < m->group_begin[m->group_count]; i++)
        if (m->group_vertex[i] < 0 || m->group_vertex[i] >= m->vertex_count) return "a group vertex out of range";
    return NULL;
}

tm_status app_mesh_decode(const void *bytes, size_t size, uint64_t hash, app_mesh *mesh, tm_error *error) {
    header head;
    memset(mesh, 0, sizeof *mesh);
    if (size < sizeof head) return damaged(error, "shorter than its header");
    memcpy(&head, bytes, sizeof head);
    const char *payload = (const char *)bytes + sizeof head;
    if (memcmp(head.magic, magic, sizeof magic) != 0 || head.format != FORMAT || head.order_mark != ORDER_MARK)
        return damaged(error, "written by another version or machine");
    if (head.hash != hash) return damaged(error, "of another file");
    if (head.vertex_count < 0 || head.tet_count < 0 || head.region_count < 0 || head.group_count < 0 ||
        head.group_vertex_count < 0 || head.zero != 0)
        return damaged(error, "negative counts");
    app_mesh m = {.vertex_count = head.vertex_count,
                  .tet_count = head.tet_count,
                  .region_count = head.region_count,
                  .group_count = head.group_count,
                  .hash = head.hash};
    section part[SECTIONS];
    sections(&m, (size_t)head.group_vertex_count, part);
    size_t wanted = 0;
    for (int i = 0; i < SECTIONS; i++) wanted += part[i].bytes;
    if (head.payload_bytes != wanted || size - sizeof head != wanted)
        return damaged(error, "length and counts disagree");
    if (tm_hash(payload, wanted, TM_HASH_SEED) != head.payload_hash) return damaged(error, "checksum");
    if (!app_mesh_allocate(&m, head.group_vertex_count))
        return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
    sections(&m, (size_t)head.group_vertex_count, part);
    for (int i = 0; i < SECTIONS; i++) {
        if (part[i].bytes) memcpy(part[i].data, payload, part[i].bytes);
        payload += part[i].bytes;
    }
    const char *what =
        m.group_begin[m.group_count] == head.group_vertex_count ? unsound(&m) : "group bounds and counts disagree";
    if (what) {
        app_mesh_free(&m);
        return damaged(error, what);
    }
    *mesh = m;
    return TM_OK;
}
