/* Snapshot of contact: tools on their paths, rows with their forces, sums of the frame, and the triangles that each
 * tool has gathered (their topology is rebuilt from them). */
#include "contact/contact_internal.h"
#include "contact/row_snapshot.h"

#include <string.h>

typedef struct saved {
    int32_t tool_count, row_count, frame_step, frame_steps, frame_average, gathered[TM_MAX_INSTRUMENTS];
} saved;

/* Without padding: equal worlds have equal bytes, and no stack contents leak. */
typedef struct saved_pose {
    double tip_m[3], roll_rad, grip;
    int64_t active;
} saved_pose;

typedef struct saved_capsule {
    double tip_m[3], tail_m[3], radius_m;
} saved_capsule;

typedef struct saved_tool {
    saved_pose pose, from, to;
    saved_capsule capsule, previous, earlier, gathered_at;
    double station_depth_m[TM_MAX_STATIONS], placed_J, reserve_J, throughput_J, stored_J, contact_stored_J[2], debt_J,
        generated_J, min_generated_J[LAW_LEDGER], ledger_s, edge_m, margin_used_m, sum_tip_m[3], sum_time_s,
        sum_force_N[3], sum_resultant_N[3], substep_force_N[3], substep_resultant_N[3], stiffness_N_m[9];
    int32_t path_step, path_steps, outside, axis_outside, placed_inside, gathered_age, sum_count, flags, stiffness_kind,
        surface_overflowed;
} saved_tool;

#define COPY(to, from) memcpy((to), (from), sizeof(to))

static saved_pose pack_pose(const tm_tool_pose *pose) {
    saved_pose k = {.roll_rad = pose->roll_rad, .grip = pose->grip, .active = pose->active};
    COPY(k.tip_m, pose->tip_m);
    return k;
}

static tm_tool_pose unpack_pose(const saved_pose *k) {
    tm_tool_pose pose = {.roll_rad = k->roll_rad, .grip = k->grip, .active = k->active != 0};
    COPY(pose.tip_m, k->tip_m);
    return pose;
}

static saved_capsule pack_capsule(const tm_capsule *capsule) {
    saved_capsule k = {.radius_m = capsule->radius_m};
    COPY(k.tip_m, capsule->tip_m);
    COPY(k.tail_m, capsule->tail_m);
    return k;
}

static tm_capsule unpack_capsule(const saved_capsule *k, int32_t instrument) {
    tm_capsule capsule = {.radius_m = k->radius_m, .instrument = instrument};
    COPY(capsule.tip_m, k->tip_m);
    COPY(capsule.tail_m, k->tail_m);
    return capsule;
}

static saved_tool pack_tool(const tm_tool *tool) {
    saved_tool k = {.pose = pack_pose(&tool->pose),
                    .from = pack_pose(&tool->from),
                    .to = pack_pose(&tool->to),
                    .capsule = pack_capsule(&tool->capsule),
                    .previous = pack_capsule(&tool->previous),
                    .earlier = pack_capsule(&tool->earlier),
                    .placed_J = tool->placed_J,
                    .reserve_J = tool->reserve_J,
                    .throughput_J = tool->throughput_J,
                    .stored_J = tool->stored_J,
                    .debt_J = tool->debt_J,
                    .generated_J = tool->generated_J,
                    .ledger_s = tool->ledger_s,
                    .contact_stored_J = {tool->contact_stored_J[0], tool->contact_stored_J[1]},
                    .gathered_at = pack_capsule(&tool->gathered_at),
                    .sum_time_s = tool->sum_time_s,
                    .path_step = tool->path_step,
                    .path_steps = tool->path_steps,
                    .outside = tool->outside,
                    .axis_outside = tool->axis_outside,
                    .placed_inside = tool->placed_inside,
                    .gathered_age = tool->gathered_age,
                    .sum_count = tool->sum_count,
                    .flags = (int32_t)tool->flags,
                    .stiffness_kind = tool->stiffness_kind,
                    .surface_overflowed = tool->surface->overflowed,
                    .margin_used_m = tool->margin_used_m,
                    .edge_m = tool->surface->edge_m};
    COPY(k.station_depth_m, tool->station_depth_m);
    COPY(k.min_generated_J, tool->min_generated_J);
    COPY(k.sum_tip_m, tool->sum_tip_m);
    COPY(k.sum_force_N, tool->sum_force_N);
    COPY(k.sum_resultant_N, tool->sum_resultant_N);
    COPY(k.substep_force_N, tool->substep_force_N);
    COPY(k.substep_resultant_N, tool->substep_resultant_N);
    COPY(k.stiffness_N_m, tool->stiffness_N_m);
    return k;
}

/* Restores a tool, except its definition and its surface. */
static void unpack_tool(const saved_tool *k, int32_t instrument, tm_tool *tool) {
    tool->pose = unpack_pose(&k->pose);
    tool->from = unpack_pose(&k->from);
    tool->to = unpack_pose(&k->to);
    tool->capsule = unpack_capsule(&k->capsule, instrument);
    tool->previous = unpack_capsule(&k->previous, instrument);
    tool->earlier = unpack_capsule(&k->earlier, instrument);
    tool->placed_J = k->placed_J;
    tool->reserve_J = k->reserve_J;
    tool->throughput_J = k->throughput_J;
    tool->stored_J = k->stored_J;
    tool->debt_J = k->debt_J;
    tool->generated_J = k->generated_J;
    tool->ledger_s = k->ledger_s;
    COPY(tool->min_generated_J, k->min_generated_J);
    tool->contact_stored_J[0] = k->contact_stored_J[0];
    tool->contact_stored_J[1] = k->contact_stored_J[1];
    tool->gathered_at = unpack_capsule(&k->gathered_at, instrument);
    tool->path_step = k->path_step;
    tool->path_steps = k->path_steps;
    tool->outside = k->outside != 0;
    tool->axis_outside = k->axis_outside != 0;
    tool->placed_inside = k->placed_inside != 0;
    tool->gathered_age = k->gathered_age;
    tool->margin_used_m = k->margin_used_m;
    tool->sum_time_s = k->sum_time_s;
    tool->sum_count = k->sum_count;
    tool->flags = (uint32_t)k->flags;
    tool->stiffness_kind = k->stiffness_kind;
    COPY(tool->station_depth_m, k->station_depth_m);
    COPY(tool->sum_tip_m, k->sum_tip_m);
    COPY(tool->sum_force_N, k->sum_force_N);
    COPY(tool->sum_resultant_N, k->sum_resultant_N);
    COPY(tool->substep_force_N, k->substep_force_N);
    COPY(tool->substep_resultant_N, k->substep_resultant_N);
    COPY(tool->stiffness_N_m, k->stiffness_N_m);
}

/* Directions of a free tool's three poses, after its saved_tool; others have none. */
typedef struct saved_directions {
    double pose[3], from[3], to[3];
} saved_directions;

static int64_t bytes_of(const saved *k, int32_t free_tools) {
    int64_t bytes = (int64_t)sizeof *k + (int64_t)sizeof(saved_directions) * free_tools +
                    (int64_t)sizeof(saved_tool) * k->tool_count + (int64_t)sizeof(tm_packed_row) * k->row_count;
    for (int32_t t = 0; t < k->tool_count; t++) bytes += (int64_t)sizeof(int32_t) * k->gathered[t];
    return bytes;
}

static void *put(void *to, const void *from, size_t bytes) { return (char *)memcpy(to, from, bytes) + bytes; }
static const void *take(void *to, const void *from, size_t bytes) {
    memcpy(to, from, bytes);
    return (const char *)from + bytes;
}

static int32_t count_free(const tm_contact *contact) {
    int32_t count = 0;
    for (int32_t t = 0; t < contact->tool_count; t++) count += contact->tool[t].def.is_free;
    return count;
}

static void *put_directions(void *to, const tm_tool *tool) {
    saved_directions k;
    COPY(k.pose, tool->pose.direction);
    COPY(k.from, tool->from.direction);
    COPY(k.to, tool->to.direction);
    return put(to, &k, sizeof k);
}

static const void *take_directions(tm_tool *tool, const void *from) {
    saved_directions k;
    from = take(&k, from, sizeof k);
    COPY(tool->pose.direction, k.pose);
    COPY(tool->from.direction, k.from);
    COPY(tool->to.direction, k.to);
    return from;
}

int64_t tm_contact_snapshot(void *self, void *buffer) {
    const tm_contact *contact = self;
    saved k;
    memset(&k, 0, sizeof k);
    k.tool_count = contact->tool_count;
    k.row_count = contact->row_count;
    k.frame_step = contact->frame_step;
    k.frame_steps = contact->frame_steps;
    k.frame_average = contact->frame_average;
    for (int32_t t = 0; t < k.tool_count; t++)
        if (contact->tool[t].gathered_age >= 0) k.gathered[t] = contact->tool[t].surface->face_count;
    if (!buffer) return bytes_of(&k, count_free(contact));
    void *to = put(buffer, &k, sizeof k);
    for (int32_t i = 0; i < k.row_count; i++) {
        const tm_packed_row row = tm_row_pack(contact->row + i);
        to = put(to, &row, sizeof row);
    }
    for (int32_t t = 0; t < k.tool_count; t++) {
        const saved_tool tool = pack_tool(contact->tool + t);
        to = put(to, &tool, sizeof tool);
        to = put(to, contact->tool[t].surface->face_id, sizeof(int32_t) * (size_t)k.gathered[t]);
        if (contact->tool[t].def.is_free) to = put_directions(to, contact->tool + t);
    }
    return bytes_of(&k, count_free(contact));
}

/* Finds the surface slots of the active faces that a tool had gathered; -1 if one is missing. */
static int32_t slots_of(const tm_tissue *tissue, const int32_t *face, int32_t count, int32_t *slot) {
    const tm_surface_view *surface = &tissue->surface;
    for (int32_t i = 0; i < count; i++) {
        int32_t low = 0, high = surface->count;
        if (tissue->face_slot) {
            low = face[i] >= 0 && face[i] < 4 * tissue->mesh->tet_count ? tissue->face_slot[face[i]] : -1;
        } else {
            while (low < high) {
                const int32_t middle = (low + high) / 2;
                if (surface->face[middle] < face[i])
                    low = middle + 1;
                else
                    high = middle;
            }
        }
        if (low < 0 || low >= surface->count || surface->face[low] != face[i]) return -1;
        slot[i] = low;
    }
    return count;
}

static void gather_again(tm_contact *contact, tm_tool *tool, const int32_t *face, int32_t count) {
    const tm_tissue *tissue = contact->world->tissue;
    int32_t slot[TM_LOCAL_FACES];
    if (tool->gathered_age < 0 || slots_of(tissue, face, count, slot) < 0) {
        tool->gathered_age = -1;
        return;
    }
    tm_local_gather(tool->surface, tissue->mesh->rest_m, contact->world->state.u_m, tissue->surface.triangle,
                    tissue->surface.face, slot, count, &tool->gathered_at, 1e9);
}

static bool rows_fit(const tm_contact *contact, const saved *k, const void *from) {
    const tm_mesh *mesh = contact->world->tissue->mesh;
    for (int32_t i = 0; i < k->row_count; i++) {
        tm_packed_row row;
        from = take(&row, from, sizeof row);
        bool fits = row.face >= 0 && row.face < 4 * mesh->tet_count && row.instrument >= 0 &&
                    row.instrument < contact->tool_count;
        for (int j = 0; j < 3; j++) fits = fits && row.vertex[j] >= 0 && row.vertex[j] < mesh->vertex_count;
        if (!fits) return false;
    }
    return true;
}

bool tm_contact_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_contact *contact = self;
    saved k;
    if (bytes < (int64_t)sizeof k) return false;
    const void *from = take(&k, buffer, sizeof k);
    if (k.tool_count != contact->tool_count || k.row_count < 0 ||
        k.row_count > contact->def.max_rows * contact->tool_count)
        return false;
    for (int32_t t = 0; t < k.tool_count; t++)
        if (k.gathered[t] < 0 || k.gathered[t] > TM_LOCAL_FACES) return false;
    if (bytes != bytes_of(&k, count_free(contact)) || !rows_fit(contact, &k, from)) return false;
    if (!apply) return true;
    contact->frame_step = k.frame_step;
    contact->frame_steps = k.frame_steps;
    contact->frame_average = k.frame_average;
    contact->row_count = k.row_count;
    contact->previous_row_count = 0;
    contact->revision = world->tissue->surface.revision;
    for (int32_t i = 0; i < k.row_count; i++) {
        tm_packed_row row;
        from = take(&row, from, sizeof row);
        contact->row[i] = tm_row_unpack(&row);
    }
    for (int32_t t = 0; t < k.tool_count; t++) {
        saved_tool tool;
        int32_t face[TM_LOCAL_FACES];
        from = take(&tool, from, sizeof tool);
        from = take(face, from, sizeof(int32_t) * (size_t)k.gathered[t]);
        unpack_tool(&tool, t, contact->tool + t);
        if (contact->tool[t].def.is_free) from = take_directions(contact->tool + t, from);
        gather_again(contact, contact->tool + t, face, k.gathered[t]);
        contact->tool[t].surface->edge_m = tool.edge_m; /* estimate for the next gathering, not this one's */
        contact->tool[t].surface->overflowed = tool.surface_overflowed != 0;
    }
    return true;
}

int64_t tm_contact_snapshot_max(const tm_contact_def *def) {
    saved k = {.tool_count = def->instrument_count, .row_count = def->max_rows * def->instrument_count};
    for (int32_t t = 0; t < k.tool_count; t++) k.gathered[t] = TM_LOCAL_FACES;
    return bytes_of(&k, def->instrument_count);
}

void tm_contact_checkpoint(void *self) {
    tm_contact *contact = self;
    contact->saved_bytes = tm_contact_snapshot(contact, contact->saved);
    for (int32_t t = 0; t < contact->tool_count; t++)
        contact->tool[t].maybe_moved = true, contact->tool[t].longer_m = 0;
}

void tm_contact_rollback(void *self, tm_world *world) {
    const tm_contact *contact = self;
    tm_contact_restore(self, world, contact->saved, contact->saved_bytes, true);
}
