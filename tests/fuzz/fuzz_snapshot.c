/* Snapshots of a world with contact and cuts are rejected with the world unchanged, or accepted, and later steps are
 * finite. With a valid checksum everything is mutated except the stages' own data: those are structs of the library,
 * protected only by the checksum (a snapshot is for the same build). */
#include <math.h>

#include "fuzz.h"

enum { CHECKSUM_AT = 24, SURFACE_AT = 48, HEADER = 80 };

static fuzz_body body;
static tm_world *world;
static tm_contact *contact;
static void *good;
static int64_t good_bytes;

static void go_on(int frames) {
    for (int i = 0; i < frames; i++) {
        tm_tool_pose probe = {.tip_m = {0.005, 0.005, 0.0105 - 0.0002 * i}, .active = true};
        tm_tool_pose cautery = {.tip_m = {0.002, 0.002, 0.011 - 0.0002 * i}, .active = true};
        tm_contact_begin_frame(contact, 8, 2);
        tm_contact_set_target(contact, 0, &probe, 8);
        tm_contact_set_target(contact, 1, &cautery, 8);
        tm_world_step(world, 8);
    }
}

static uint64_t checksum(const uint8_t *snapshot, size_t bytes) {
    uint8_t head[HEADER];
    memcpy(head, snapshot, HEADER);
    memset(head + CHECKSUM_AT, 0, 8);
    return tm_hash(snapshot + HEADER, bytes - HEADER, tm_hash(head, HEADER, TM_HASH_SEED));
}

static size_t padded(size_t bytes) { return (bytes + 7) / 8 * 8; }

/* Offset of the stages' own data. */
static size_t stages_at(void) {
    int32_t surface;
    memcpy(&surface, (char *)good + SURFACE_AT, 4);
    return HEADER + 48 * (size_t)body.mesh->vertex_count + padded((size_t)body.mesh->tet_count) +
           padded(4 * (size_t)surface);
}

/* Makes the saved snapshot with changes from the input: (offset, length, bytes). */
static uint8_t *patched(fuzz_bytes *b, size_t limit, size_t *size) {
    *size = (size_t)good_bytes;
    uint8_t *bytes = fuzz_copy(good, *size);
    while (b->left >= 3) {
        uint16_t at;
        fuzz_take(b, &at, 2);
        uint8_t length = fuzz_u8(b) % 32;
        for (uint8_t i = 0; i < length; i++) {
            uint8_t value = fuzz_u8(b);
            if ((size_t)at + i < limit) bytes[at + i] = value;
        }
    }
    return bytes;
}

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    body = fuzz_block(3, true);
    tm_world_def def = tm_world_def_default();
    def.tissue = body.tissue;
    def.damped = true;
    PROMISE(tm_world_create(&def, &world, NULL) == TM_OK);
    tm_instrument_def tool[2] = {
        {TM_TOOL_PROBE, false, {0.005, 0.005, 0.1}, 0.002, 0.05, {.tip_m = {0.005, 0.005, 0.02}, .active = true}},
        {TM_TOOL_CAUTERY, false, {0.002, 0.002, 0.1}, 0.002, 0.05, {.tip_m = {0.002, 0.002, 0.02}, .active = true}}};
    tm_contact_def contact_def = tm_contact_def_default();
    contact_def.instrument_count = 2;
    contact_def.instrument = tool;
    PROMISE(tm_stage_contact(world, &contact_def, &contact, NULL) == TM_OK);
    tm_cut_def cut = tm_cut_def_default();
    PROMISE(tm_stage_cut(world, contact, &cut, NULL) == TM_OK);
    go_on(10);
    good_bytes = tm_snapshot_bytes(world);
    good = malloc((size_t)good_bytes);
    PROMISE(tm_snapshot_save(world, good, good_bytes, NULL) == TM_OK);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    uint8_t mode = fuzz_u8(&b);
    size_t bytes = b.left;
    PROMISE(tm_snapshot_restore(world, good, good_bytes, NULL) == TM_OK);
    uint64_t before = tm_world_hash(world);
    uint8_t *snapshot =
        mode & 1 ? patched(&b, mode & 2 ? stages_at() : (size_t)good_bytes, &bytes) : fuzz_copy(b.at, b.left);
    if (mode & 2 && mode & 1) {
        uint64_t sum = checksum(snapshot, bytes);
        memcpy(snapshot + CHECKSUM_AT, &sum, 8);
    }
    tm_error error = {0};
    tm_status status = tm_snapshot_restore(world, snapshot, (int64_t)bytes, &error);
    if (status != TM_OK) {
        PROMISE(error.message[0] && strchr(error.message, ';'));
        PROMISE(tm_world_hash(world) == before);
        int64_t now = tm_snapshot_bytes(world);
        void *again = malloc((size_t)now);
        PROMISE(now == good_bytes && tm_snapshot_save(world, again, now, NULL) == TM_OK &&
                memcmp(again, good, (size_t)now) == 0);
        free(again);
    } else {
        go_on(2);
        for (int32_t i = 0; i < 3 * body.mesh->vertex_count; i++) PROMISE(isfinite(tm_world_state(world)->u_m[i]));
    }
    free(snapshot);
    return 0;
}
