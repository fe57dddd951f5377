/* Snapshot: a header with a checksum, then state, active tetrahedra, the surface's slots and data of stages. Everything
 * is checked before anything is restored. */
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

enum { VERSION = 3, ORDER = 0x01020304 };
static const char MAGIC[8] = {'T', 'M', 'S', 'N', 'A', 'P', '\r', '\n'};

typedef struct header {
    char magic[8];
    uint32_t version, order; /* byte order and sizes of this machine */
    int64_t bytes;           /* of the snapshot */
    uint64_t checksum;       /* of the snapshot, with this field zero */
    uint64_t scene;          /* hash of mesh, materials, fibres, precision */
    int32_t vertex_count, tet_count, surface_count, stage_count;
    int64_t step;
    double time_s, dt_s;
} header;

typedef struct stage_header {
    char name[24];
    int64_t bytes;
} stage_header;

static int64_t padded(int64_t bytes) { return (bytes + 7) / 8 * 8; }

static uint64_t scene_hash(const tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    uint64_t h = tm_hash(mesh->rest_m, sizeof(double) * 3 * (size_t)mesh->vertex_count, TM_HASH_SEED);
    h = tm_hash(mesh->tet, sizeof(int32_t) * 4 * (size_t)mesh->tet_count, h);
    h = tm_hash(mesh->region, sizeof(int32_t) * (size_t)mesh->tet_count, h);
    h = tm_hash(tissue->material, sizeof(tm_material) * (size_t)tissue->material_count, h);
    h = tm_hash(tissue->region_material, sizeof(int32_t) * (size_t)mesh->region_count, h);
    if (tissue->fibre) h = tm_hash(tissue->fibre, sizeof(double) * 3 * (size_t)mesh->tet_count, h);
    if (tissue->has_single_law) h = tm_hash(&tissue->has_single_law, sizeof tissue->has_single_law, h);
    return tm_hash(&tissue->precision, sizeof tissue->precision, h);
}

static uint64_t checksum(const void *buffer, int64_t bytes) {
    header h;
    memcpy(&h, buffer, sizeof h);
    h.checksum = 0;
    return tm_hash((const char *)buffer + sizeof h, (size_t)bytes - sizeof h, tm_hash(&h, sizeof h, TM_HASH_SEED));
}

static int64_t body_bytes(const tm_mesh *mesh, int32_t surface_count) {
    return 2 * (int64_t)sizeof(double) * 3 * mesh->vertex_count + padded(mesh->tet_count) +
           padded((int64_t)sizeof(int32_t) * surface_count);
}

static bool keeps(const tm_stage *stage) { return stage->snapshot && stage->restore; }

int64_t tm_snapshot_bytes(const tm_world *world) {
    TM_REQUIRE(world, "world is null", 0);
    int64_t bytes = (int64_t)sizeof(header) + body_bytes(world->tissue->mesh, world->tissue->surface.count);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (keeps(stage)) bytes += (int64_t)sizeof(stage_header) + padded(stage->snapshot(stage->self, NULL));
    }
    return bytes;
}

int64_t tm_snapshot_bytes_max(const tm_world *world) {
    TM_REQUIRE(world, "world is null", 0);
    const tm_tissue *tissue = world->tissue;
    const int32_t faces = tissue->cuttable ? tm_tissue_faces_max(tissue->mesh) : tissue->surface.count;
    int64_t bytes = (int64_t)sizeof(header) + body_bytes(tissue->mesh, faces);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (!keeps(stage)) continue;
        const int64_t most = stage->snapshot_max > 0 ? stage->snapshot_max : stage->snapshot(stage->self, NULL);
        bytes += (int64_t)sizeof(stage_header) + padded(most);
    }
    return bytes;
}

/* Writes, and zeroes the padding, so that equal worlds have equal snapshots. */
static char *put(char *to, const void *from, int64_t bytes) {
    memcpy(to, from, (size_t)bytes);
    memset(to + bytes, 0, (size_t)(padded(bytes) - bytes));
    return to + padded(bytes);
}

tm_status tm_snapshot_save(const tm_world *world, void *buffer, int64_t bytes, tm_error *error) {
    TM_REQUIRE(world && buffer, "world or buffer is null", TM_ERR_ARGUMENT);
    const int64_t needed = tm_snapshot_bytes(world);
    if (bytes < needed)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "snapshot: the buffer has %lld bytes and %lld are needed; allocate tm_snapshot_bytes()",
                       (long long)bytes, (long long)needed);
    const tm_tissue *tissue = world->tissue;
    const int64_t n = 3 * (int64_t)tissue->mesh->vertex_count * (int64_t)sizeof(double);
    header h = {.version = VERSION,
                .order = ORDER,
                .bytes = needed,
                .scene = scene_hash(tissue),
                .vertex_count = tissue->mesh->vertex_count,
                .tet_count = tissue->mesh->tet_count,
                .surface_count = tissue->surface.count,
                .step = world->state.step,
                .time_s = world->state.time_s,
                .dt_s = world->state.dt_s};
    memcpy(h.magic, MAGIC, sizeof MAGIC);
    char *to = (char *)buffer + sizeof h;
    to = put(to, world->state.u_m, n);
    to = put(to, world->state.u_prev_m, n);
    to = put(to, tissue->alive, tissue->mesh->tet_count);
    to = put(to, tissue->surface.face, (int64_t)sizeof(int32_t) * tissue->surface.count);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (!keeps(stage)) continue;
        stage_header s = {.bytes = stage->snapshot(stage->self, NULL)};
        for (size_t c = 0; c + 1 < sizeof s.name && stage->name[c]; c++) s.name[c] = stage->name[c];
        memcpy(to, &s, sizeof s);
        to += sizeof s;
        memset(to, 0, (size_t)padded(s.bytes));
        stage->snapshot(stage->self, to);
        to += padded(s.bytes);
        h.stage_count++;
    }
    memcpy(buffer, &h, sizeof h);
    h.checksum = checksum(buffer, needed);
    memcpy(buffer, &h, sizeof h);
    return TM_OK;
}

/* --- restoring --- */

static tm_status check_header(const tm_world *world, const void *buffer, int64_t bytes, header *h, tm_error *error) {
    const tm_mesh *mesh = world->tissue->mesh;
    if (bytes < (int64_t)sizeof *h)
        return tm_fail(error, TM_ERR_FILE, -1, "snapshot: it has only %lld bytes and is truncated; save it again",
                       (long long)bytes);
    memcpy(h, buffer, sizeof *h);
    if (memcmp(h->magic, MAGIC, sizeof MAGIC))
        return tm_fail(error, TM_ERR_FILE, -1, "snapshot: the data is not a snapshot; give a file saved as one");
    if (h->version != VERSION || h->order != ORDER)
        return tm_fail(
            error, TM_ERR_FILE, -1,
            "snapshot: version %u or the byte order is of another library or machine; save it again with this library",
            h->version);
    if (h->bytes != bytes)
        return tm_fail(
            error, TM_ERR_FILE, -1,
            "snapshot: it has %lld bytes and its header says %lld, so it is truncated or data follows it; save it again",
            (long long)bytes, (long long)h->bytes);
    if (h->checksum != checksum(buffer, bytes))
        return tm_fail(error, TM_ERR_FILE, -1, "snapshot: its checksum is wrong, so it is damaged; save it again");
    if (h->vertex_count != mesh->vertex_count || h->tet_count != mesh->tet_count ||
        h->scene != scene_hash(world->tissue))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "snapshot: it is of another mesh or other materials (%d vertices, %d tetrahedra); open the scene it "
            "was saved from",
            h->vertex_count, h->tet_count);
    if (tm_world_check_step(world, h->dt_s, NULL) || h->surface_count < 0 ||
        h->surface_count > 4 * (int64_t)h->tet_count || bytes < (int64_t)sizeof *h + body_bytes(mesh, h->surface_count))
        return tm_fail(error, TM_ERR_FILE, -1, "snapshot: its time step or its sizes are out of range; save it again");
    return TM_OK;
}

/* Checks the data of the stages; with `apply`, restores them. */
static tm_status stages(tm_world *world, const header *h, const char *at, const char *end, bool apply,
                        tm_error *error) {
    int32_t found = 0;
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (!keeps(stage)) continue;
        stage_header s;
        if (end - at < (int64_t)sizeof s)
            return tm_fail(error, TM_ERR_ARGUMENT, -1,
                           "snapshot: it has no data for stage %s; open the scene it was saved from", stage->name);
        memcpy(&s, at, sizeof s);
        at += sizeof s;
        if (strncmp(s.name, stage->name, sizeof s.name - 1) || s.bytes < 0 || s.bytes > end - at ||
            padded(s.bytes) > end - at)
            return tm_fail(
                error, TM_ERR_ARGUMENT, -1,
                "snapshot: it was saved with other stages, without %s at this place; open the scene it was saved from",
                stage->name);
        if (!stage->restore(stage->self, world, at, s.bytes, apply))
            return tm_fail(error, TM_ERR_ARGUMENT, -1,
                           "snapshot: its data for stage %s does not fit; open the scene it was saved from",
                           stage->name);
        at += padded(s.bytes);
        found++;
    }
    if (found != h->stage_count || at != end)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "snapshot: it was saved with more stages; open the scene it was saved from");
    return TM_OK;
}

tm_status tm_snapshot_restore(tm_world *world, const void *buffer, int64_t bytes, tm_error *error) {
    TM_REQUIRE(world && buffer, "world or buffer is null", TM_ERR_ARGUMENT);
    header h;
    if ((uintptr_t)buffer % 8)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "snapshot: its buffer is not aligned to 8 bytes; allocate it with malloc");
    tm_status status = check_header(world, buffer, bytes, &h, error);
    if (status) return status;
    tm_tissue *tissue = world->tissue;
    const int64_t n = 3 * (int64_t)h.vertex_count * (int64_t)sizeof(double);
    const char *u = (const char *)buffer + sizeof h, *u_prev = u + n;
    const uint8_t *alive = (const uint8_t *)(u_prev + n);
    const int32_t *face = (const int32_t *)(alive + padded(h.tet_count));
    const char *rest = (const char *)face + padded((int64_t)sizeof(int32_t) * h.surface_count);
    for (int64_t i = 0; i < 6 * (int64_t)h.vertex_count; i++) {
        double value; /* u, then u_prev */
        memcpy(&value, u + i * (int64_t)sizeof value, sizeof value);
        if (!isfinite(value))
            return tm_fail(error, TM_ERR_FILE, tm_mesh_original_vertex(tissue->mesh, (int32_t)(i / 3 % h.vertex_count)),
                           "snapshot: a displacement is not finite; save it again");
    }
    if (!tm_tissue_surface_fits(tissue, alive, face, h.surface_count))
        return tm_fail(error, TM_ERR_FILE, -1, "snapshot: its surface does not match its tetrahedra; save it again");
    const bool cut = memcmp(alive, tissue->alive, (size_t)h.tet_count) != 0;
    if (cut && !tissue->cuttable)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "snapshot: it is of cut tissue, and this tissue is not cuttable; open the scene it was saved from");
    status = stages(world, &h, rest, (const char *)buffer + bytes, false, error);
    if (status) return status;

    if (tissue->cuttable) tm_tissue_restore(tissue, alive, face, h.surface_count);
    memcpy(world->state.u_m, u, (size_t)n);
    memcpy(world->state.u_prev_m, u_prev, (size_t)n);
    world->state.step = h.step;
    world->state.time_s = h.time_s;
    world->state.dt_s = h.dt_s;
    tm_world_changed(world);
    return stages(world, &h, rest, (const char *)buffer + bytes, true, error);
}
