/* Small text files and values: device profiles, hand scripts, recorded samples, fibres, STL, quantities with units.
 * They are rejected, or all results are finite. */
#include <math.h>

#include "app.h"
#include "device/hand_file.h"
#include "fuzz.h"
#include "io/profile.h"
#include "io/samples.h"
#include "mesh/signed_distance.h"
#include "scene/units.h"
#include "tensormass_io.h"

static void try_profile(const char *path) {
    hrt_params params;
    hrt_params_default(&params);
    if (hrt_profile_read(path, &params)) PROMISE(hrt_params_check(&params) < 0);
}

static void try_hand(const char *path) {
    hrt_hand_script script = {0};
    if (!hrt_hand_file_read(path, hrt_device_types[0], &script)) return;
    for (int32_t i = 0; i < script.key_count; i++)
        for (int j = 0; j < HRT_JOINTS; j++)
            PROMISE(isfinite(script.key[i].joint[j]) && isfinite(script.key[i].time_s));
    free((void *)(uintptr_t)script.key);
}

static void try_samples(const char *path) {
    hrt_samples samples;
    memset(&samples, 0, sizeof samples);
    if (hrt_samples_read(&samples, path)) hrt_table_free(&samples.table);
}

static void try_fibres(const char *path) {
    double fibre[3 * 4];
    tm_error error = {0};
    if (tm_fibres_load(path, 4, fibre, &error) == TM_OK)
        for (int t = 0; t < 4; t++)
            PROMISE(fabs(hypot(hypot(fibre[3 * t], fibre[3 * t + 1]), fibre[3 * t + 2]) - 1) < 1e-9);
    else
        PROMISE(error.message[0] && strchr(error.message, ';'));
}

static void try_stl(const char *path) {
    shell *s = NULL;
    tm_error error = {0};
    double *corner = NULL;
    int triangles = 0;
    tm_status status = shell_read_stl(path, 1, &corner, &triangles, &error);
    if (status)
        free(corner);
    else
        status = shell_of_triangles(corner, triangles, true, &s, &error);
    if (status) {
        PROMISE(error.message[0] && strchr(error.message, ';'));
        return;
    }
    growing_solid body = shell_solid(s);
    double p[3] = {body.low[0], body.low[1], body.low[2]};
    body.inside(body.shape, p);
    body.project(body.shape, p);
    shell_free(s);
}

static void try_quantity(const uint8_t *data, size_t size) {
    static const char *const dimension[] = {"pressure", "length", "angle", "density", "force", "time", "rate", "none"};
    char *text = malloc(size + 1), why[60];
    if (size) memcpy(text, data, size);
    text[size] = 0;
    for (int i = 0; i < 8; i++) {
        double si = NAN;
        if (app_parse_quantity(text, dimension[i], &si, why, sizeof why)) PROMISE(isfinite(si));
    }
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1) return 0;
    uint8_t which = data[0] % 6;
    if (which == 5) {
        try_quantity(data + 1, size - 1);
        return 0;
    }
    const char *path = fuzz_file(data + 1, size - 1, which == 4 ? ".stl" : ".csv");
    void (*const try[])(const char *) = {try_profile, try_hand, try_samples, try_fibres, try_stl};
    try[which](path);
    return 0;
}
