/* Capacity of this machine: the largest organ that runs in real time with a probe pressed into it. A block of a
 * liver's volume, E 5 kPa, nu 0.45, 1060 kg/m3, double precision, at its own critical step. */
#include <math.h>
#include <stdio.h>

#include "bandwidth.h"
#include "bench.h"

static const double SIDE_M = 0.115, FRAME_S = 0.04; /* 1.5 litres, 25 Hz */
enum { FEWEST = 4, MAX_COUNT = 44, QUICK_MAX = 6 }; /* cells along a side: 384 to 511,000 tetrahedra */

static tm_tissue *make_tissue(const tm_mesh *mesh) {
    tm_material material;
    tm_error error;
    bench_must(tm_material_young(5e3, 0.45, &material, &error), &error);
    material.damping_1_s = 50, material.density_kg_m3 = 1060;
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh, def.material_count = 1, def.material = &material;
    tm_tissue *tissue = NULL;
    bench_must(tm_tissue_create(&def, &tissue, &error), &error);
    return tissue;
}

/* Makes the world: bottom fixed, gravity, a probe over the middle. */
static tm_world *make_world(tm_tissue *tissue, int threads, tm_contact **contact) {
    tm_world *world = bench_world(tissue, threads);
    tm_error error;
    tm_instrument_def probe = {.mode = TM_TOOL_PROBE,
                               .trocar_m = {SIDE_M / 2, SIDE_M / 2, 3 * SIDE_M},
                               .radius_m = 0.0025,
                               .contact_length_m = 0.1,
                               .pose = {.tip_m = {SIDE_M / 2, SIDE_M / 2, SIDE_M + 0.004}}};
    tm_contact_def contact_def = tm_contact_def_default();
    contact_def.instrument_count = 1, contact_def.instrument = &probe;
    bench_must(tm_stage_contact(world, &contact_def, contact, &error), &error);
    return world;
}

/* Returns the seconds of the fastest of a few frames in which the probe is 4 mm deep. */
static double frame_s(int cells, int threads, bool quick, int32_t *tets) {
    tm_mesh *mesh = bench_block_of(cells, SIDE_M);
    tm_tissue *tissue = make_tissue(mesh);
    tm_contact *contact = NULL;
    tm_world *world = make_world(tissue, threads, &contact);
    const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(world));
    const tm_tool_pose pressed = {.tip_m = {SIDE_M / 2, SIDE_M / 2, SIDE_M - 0.004}};
    double least = INFINITY;
    for (int frame = 0; frame < (quick ? 2 : 8); frame++) {
        tm_contact_begin_frame(contact, substeps, substeps);
        tm_contact_set_target(contact, 0, &pressed, substeps);
        const double begin = app_seconds();
        tm_world_step(world, substeps);
        if (frame > 0) least = fmin(least, app_seconds() - begin);
    }
    *tets = mesh->tet_count;
    tm_world_destroy(world);
    tm_tissue_destroy(tissue);
    tm_mesh_destroy(mesh);
    return least;
}

/* Finds the largest block that fits, between the smallest and largest cell counts; both size and critical step make
 * a frame costlier. */
static cJSON *largest(double cores, bool quick) {
    const int threads = cores > 1 ? (int)cores : 1;
    int low = FEWEST - 1, high = (quick ? QUICK_MAX : MAX_COUNT) + 1;
    int32_t tets = 0;
    double took = 0;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        int32_t count;
        const double seconds = frame_s(middle, threads, quick, &count);
        if (seconds <= FRAME_S * (cores < 1 ? cores : 1))
            low = middle, tets = count, took = seconds;
        else
            high = middle;
    }
    cJSON *row = cJSON_CreateObject();
    cJSON_AddNumberToObject(row, "cores", cores);
    cJSON_AddNumberToObject(row, "tets", tets);
    cJSON_AddNumberToObject(row, "frame_ms", 1e3 * took);
    cJSON_AddBoolToObject(row, "and_more", low == (quick ? QUICK_MAX : MAX_COUNT));
    printf("most  %7d tets  in real time at 25 Hz on %g core%s, pressed by a probe: %.1f ms a frame%s\n", tets, cores,
           cores == 1 ? "" : "s", 1e3 * took,
           low == (quick ? QUICK_MAX : MAX_COUNT) ? "; larger ones were not tried" : "");
    return row;
}

cJSON *bench_capacity(const bench_run *run) {
    cJSON *rows = cJSON_CreateArray();
    cJSON_AddItemToArray(rows, largest(0.5, run->quick));
    cJSON_AddItemToArray(rows, largest(1, run->quick));
    cJSON_AddItemToArray(rows, largest(2, run->quick));
    return rows;
}
