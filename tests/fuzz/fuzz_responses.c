/* Response files of the precomputed model: for any file content the model is bit-identical to the requested one. */
#include "fuzz.h"
#include "tensormass_solve.h"

static fuzz_body body;
static tm_precomputed_def def;
static uint8_t *good;
static size_t good_bytes;
static double *shape;
static char path[200];

static void write_file(const void *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    PROMISE(file && (!size || fwrite(bytes, 1, size, file) == size) && fclose(file) == 0);
}

/* The displacement under one imposed vertex. */
static bool opens_right(bool *from_file) {
    const int32_t vertex = body.mesh->vertex_count - 1;
    const double push[3] = {1e-4, -2e-4, 3e-4};
    tm_precomputed *model = NULL;
    tm_solve_report report = {0};
    if (tm_precomputed_create(&def, &model, &report, NULL) != TM_OK) return false;
    PROMISE(tm_precomputed_impose(model, 1, &vertex, push, 0, NULL) == TM_OK &&
            tm_precomputed_update(model, NULL) >= 0);
    const double *u = tm_precomputed_displacement(model);
    size_t bytes = 3 * (size_t)body.mesh->vertex_count * sizeof *u;
    if (!shape) shape = fuzz_copy(u, bytes);
    bool same = memcmp(shape, u, bytes) == 0;
    tm_precomputed_destroy(model);
    *from_file = report.from_file;
    return same;
}

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    bool from_file;
    body = fuzz_block(2, false);
    snprintf(path, sizeof path, "%s/tm-fuzz-%ld.tmr", fuzz_folder(), (long)getpid());
    unlink(path);
    def = tm_precomputed_def_default();
    def.problem.tissue = body.tissue;
    def.problem.fixed = body.fixed;
    def.problem.threads = 1;
    def.file = path;
    PROMISE(opens_right(&from_file) && !from_file);
    PROMISE(opens_right(&from_file) && from_file);
    FILE *file = fopen(path, "rb");
    PROMISE(file && fseek(file, 0, SEEK_END) == 0);
    good_bytes = (size_t)ftell(file);
    rewind(file);
    good = malloc(good_bytes);
    PROMISE(fread(good, 1, good_bytes, file) == good_bytes);
    fclose(file);
    return 0;
}

/* The input is the file, or a list of changes to the right one: (offset, length, bytes). */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    bool from_file, changed = false;
    if (fuzz_u8(&b) & 1) {
        uint8_t *bytes = fuzz_copy(good, good_bytes);
        size_t length = good_bytes;
        while (b.left >= 4) {
            uint32_t at = 0;
            fuzz_take(&b, &at, 3);
            uint8_t count = fuzz_u8(&b) % 16;
            if (count == 0) length = at % (good_bytes + 1);
            for (uint8_t i = 0; i < count; i++) bytes[(at + i) % good_bytes] = fuzz_u8(&b);
        }
        changed = length != good_bytes || memcmp(bytes, good, good_bytes) != 0;
        write_file(bytes, length);
        free(bytes);
    } else {
        changed = true;
        write_file(b.at, b.left);
    }
    PROMISE(opens_right(&from_file));
    PROMISE(from_file == !changed);
    return 0;
}
