/* Mesh cache files: refused, or decoded into a mesh that encodes into the same bytes and can be checked and built. */
#include "common/mesh_check.h"
#include "common/mesh_parts.h"
#include "fuzz.h"

enum { HASH_AT = 16, BYTES_AT = 24, SUM_AT = 32, HEADER = 64 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    app_mesh mesh;
    uint64_t hash = 0;
    uint8_t *block = fuzz_copy(data, size);
    if (size > HEADER) { /* the right checksum, or nothing behind it would ever be reached */
        uint64_t bytes = size - HEADER, sum = tm_hash(block + HEADER, bytes, TM_HASH_SEED);
        memcpy(&hash, block + HASH_AT, 8);
        memcpy(block + BYTES_AT, &bytes, 8);
        if (!(data[size - 1] & 1)) memcpy(block + SUM_AT, &sum, 8);
    }
    if (app_mesh_decode(block, size, hash, &mesh, NULL) == TM_OK) {
        size_t again;
        void *back = app_mesh_encode(&mesh, &again);
        PROMISE(back && again == size && memcmp(back, block, size) == 0);
        free(back);
        tm_mesh *built = NULL;
        tm_error error = {0};
        if (mesh.tet_count > 0 && app_mesh_build(&mesh, &built, &error) != TM_OK)
            PROMISE(error.message[0] && strchr(error.message, ';'));
        tm_mesh_destroy(built);
        app_mesh_free(&mesh);
    }
    free(block);
    return 0;
}
