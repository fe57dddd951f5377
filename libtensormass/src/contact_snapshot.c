/* What contact keeps between steps: the tools on their paths, the rows with their multipliers, the frame's sums, and which triangles each
 * tool has gathered (their small topology is built again from that). */
#include "contact_internal.h"

#include <string.h>

typedef struct kept {
    int32_t tool_count, row_count, frame_step, frame_steps, frame_average, gathered[TM_MAX_INSTRUMENTS];
} kept;

static int64_t bytes_of(const kept *k) {
    int64_t bytes = (int64_t)sizeof *k + (int64_t)sizeof(tm_tool) * k->tool_count + (int64_t)sizeof(tm_contact_row) * k->row_count;
    for (int32_t t = 0; t < k->tool_count; t++) bytes += (int64_t)sizeof(int32_t) * k->gathered[t];
    return bytes;
}

static void *put(void *to, const void *from, size_t bytes) { return (char *)memcpy(to, from, bytes) + bytes; }
static const void *take(void *to, const void *from, size_t bytes) {
    memcpy(to, from, bytes);
    return (const char *)from + bytes;
}

int64_t tm_contact_snapshot(void *self, void *buffer) {
    const tm_contact *contact = self;
    kept k;
    memset(&k, 0, sizeof k);
    k.tool_count = contact->tool_count;
    k.row_count = contact->row_count;
    k.frame_step = contact->frame_step;
    k.frame_steps = contact->frame_steps;
    k.frame_average = contact->frame_average;
    for (int32_t t = 0; t < k.tool_count; t++)
        if (contact->tool[t].gathered_age >= 0) k.gathered[t] = contact->tool[t].surface->face_count;
    if (!buffer) return bytes_of(&k);
    void *to = put(buffer, &k, sizeof k);
    for (int32_t t = 0; t < k.tool_count; t++) {
        tm_tool tool = contact->tool[t];
        tool.surface = NULL; /* an address means nothing elsewhere */
        to = put(to, &tool, sizeof tool);
        to = put(to, contact->tool[t].surface->face_id, sizeof(int32_t) * (size_t)k.gathered[t]);
    }
    put(to, contact->row, sizeof(tm_contact_row) * (size_t)k.row_count);
    return bytes_of(&k);
}

/* Slots of the living faces that a tool had gathered; -1 if one is not there. */
static int32_t slots_of(const tm_tissue *tissue, const int32_t *face, int32_t count, int32_t *slot) {
    const tm_surface_view *surface = &tissue->surface;
    for (int32_t i = 0; i < count; i++) {
        int32_t low = 0, high = surface->count;
        if (tissue->face_slot) {
            low = face[i] >= 0 && face[i] < 4 * tissue->mesh->tet_count ? tissue->face_slot[face[i]] : -1;
        } else {
            while (low < high) {
                const int32_t middle = (low + high) / 2;
                if (surface->face[middle] < face[i]) low = middle + 1;
                else high = middle;
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
    tm_local_gather(tool->surface, tissue->mesh->rest_m, contact->world->state.u_m, tissue->surface.triangle, tissue->surface.face, slot, count,
                    &tool->gathered_at, 1e9);
}

bool tm_contact_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_contact *contact = self;
    kept k;
    if (bytes < (int64_t)sizeof k) return false;
    const void *from = take(&k, buffer, sizeof k);
    if (k.tool_count != contact->tool_count || k.row_count < 0 || k.row_count > contact->def.max_rows * contact->tool_count) return false;
    for (int32_t t = 0; t < k.tool_count; t++)
        if (k.gathered[t] < 0 || k.gathered[t] > TM_LOCAL_FACES) return false;
    if (bytes != bytes_of(&k)) return false;
    if (!apply) return true;
    contact->frame_step = k.frame_step;
    contact->frame_steps = k.frame_steps;
    contact->frame_average = k.frame_average;
    contact->row_count = k.row_count;
    contact->row_count_before = 0;
    contact->revision = world->tissue->surface.revision;
    for (int32_t t = 0; t < k.tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        const tm_instrument_def def = tool->def;
        tm_local_surface *surface = tool->surface;
        int32_t face[TM_LOCAL_FACES];
        from = take(tool, from, sizeof *tool);
        tool->def = def;
        tool->surface = surface;
        from = take(face, from, sizeof(int32_t) * (size_t)k.gathered[t]);
        gather_again(contact, tool, face, k.gathered[t]);
    }
    take(contact->row, from, sizeof(tm_contact_row) * (size_t)k.row_count);
    return true;
}
