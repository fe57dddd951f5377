/* State of grasps between steps: for snapshots and rollback. */
#include "contact/grasp_internal.h"

#include <string.h>

/* State of one instrument's grasp; the arrays of its vertices follow it. */
typedef struct saved {
    int32_t state, was_closed, count, seen;
    double axis_m[3][3], origin[3], fade, embedded_m[TM_MAX_STATIONS], contact_stored_J[2];
    tm_jaw_place place[3];
} saved;

static int64_t saved_bytes(int32_t count) {
    return (int64_t)sizeof(saved) + count * (int64_t)(sizeof(int64_t) + 12 * sizeof(double));
}

/* Copies between the arrays of a grasp and the buffer after its header. Vertices as int64, for alignment. */
static void move_arrays(grasp_of_jaw *h, char *buffer, bool out) {
    int64_t *vertex = (int64_t *)buffer;
    double *number = (double *)(vertex + h->count);
    double *const array[4] = {h->offset_m, h->target_m, h->force_N, h->let_go_N};
    for (int32_t i = 0; i < h->count; i++) {
        if (out)
            vertex[i] = h->vertex[i];
        else
            h->vertex[i] = (int32_t)vertex[i];
    }
    for (int a = 0; a < 4; a++, number += 3 * h->count) {
        const size_t bytes = sizeof(double) * 3 * (size_t)h->count;
        if (out)
            memcpy(number, array[a], bytes);
        else
            memcpy(array[a], number, bytes);
    }
}

int64_t tm_grasp_snapshot(void *self, void *buffer) {
    tm_grasp *grasp = self;
    int64_t bytes = 0;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) {
        grasp_of_jaw *h = grasp->grasp + t;
        if (buffer) {
            saved k = {
                .state = h->state, .was_closed = h->was_closed, .count = h->count, .seen = h->seen, .fade = h->fade};
            memcpy(k.axis_m, h->jaw.axis_m, sizeof k.axis_m);
            memcpy(k.origin, h->jaw.origin, sizeof k.origin);
            memcpy(k.embedded_m, h->embedded_m, sizeof k.embedded_m);
            memcpy(k.contact_stored_J, h->contact_stored_J, sizeof k.contact_stored_J);
            memcpy(k.place, h->place, sizeof k.place);
            memcpy((char *)buffer + bytes, &k, sizeof k);
            move_arrays(h, (char *)buffer + bytes + sizeof k, true);
        }
        bytes += saved_bytes(h->count);
    }
    return bytes;
}

int64_t tm_grasp_snapshot_max(const tm_grasp *grasp) {
    return grasp->contact->tool_count * saved_bytes(grasp->def.max_vertices);
}

static bool fits(const tm_grasp *grasp, const tm_world *world, const char *buffer, int64_t bytes) {
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) {
        saved k;
        if (bytes < (int64_t)sizeof k) return false;
        memcpy(&k, buffer, sizeof k);
        if (k.count < 0 || k.count > grasp->def.max_vertices || k.state < TM_GRASP_OPEN || k.state > TM_GRASP_RELEASING)
            return false;
        if (bytes < saved_bytes(k.count)) return false;
        const int64_t *vertex = (const int64_t *)(buffer + sizeof k);
        for (int32_t i = 0; i < k.count; i++)
            if (vertex[i] < 0 || vertex[i] >= world->tissue->mesh->vertex_count) return false;
        buffer += saved_bytes(k.count);
        bytes -= saved_bytes(k.count);
    }
    return bytes == 0;
}

bool tm_grasp_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_grasp *grasp = self;
    if (!fits(grasp, world, buffer, bytes)) return false;
    const char *from = buffer;
    for (int32_t t = 0; t < grasp->contact->tool_count && apply; t++) {
        grasp_of_jaw *h = grasp->grasp + t;
        saved k;
        memcpy(&k, from, sizeof k);
        h->state = (tm_grasp_state)k.state;
        h->was_closed = k.was_closed != 0;
        h->placings = grasp->contact->tool[t].placings;
        h->count = k.count;
        h->fade = k.fade;
        memcpy(h->jaw.axis_m, k.axis_m, sizeof k.axis_m);
        memcpy(h->jaw.origin, k.origin, sizeof k.origin);
        memcpy(h->embedded_m, k.embedded_m, sizeof k.embedded_m);
        memcpy(h->contact_stored_J, k.contact_stored_J, sizeof k.contact_stored_J);
        memcpy(h->place, k.place, sizeof k.place);
        h->seen = k.seen != 0;
        move_arrays(h, (char *)(uintptr_t)(from + sizeof k), false);
        from += saved_bytes(k.count);
    }
    return true;
}

/* Copies a grasp; each keeps its own arrays. */
static void copy_hold(const grasp_of_jaw *from, grasp_of_jaw *to) {
    const grasp_of_jaw own = *to;
    const size_t bytes = sizeof(double) * 3 * (size_t)from->count;
    *to = *from;
    to->vertex = own.vertex, to->offset_m = own.offset_m, to->target_m = own.target_m, to->force_N = own.force_N;
    to->let_go_N = own.let_go_N, to->distance_m = own.distance_m;
    memcpy(to->vertex, from->vertex, sizeof *to->vertex * (size_t)from->count);
    memcpy(to->offset_m, from->offset_m, bytes);
    memcpy(to->target_m, from->target_m, bytes);
    memcpy(to->force_N, from->force_N, bytes);
    memcpy(to->let_go_N, from->let_go_N, bytes);
}

void tm_grasp_checkpoint(void *self) {
    tm_grasp *grasp = self;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) copy_hold(grasp->grasp + t, grasp->saved + t);
}

void tm_grasp_rollback(void *self, tm_world *world) {
    (void)world;
    tm_grasp *grasp = self;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) copy_hold(grasp->saved + t, grasp->grasp + t);
}
