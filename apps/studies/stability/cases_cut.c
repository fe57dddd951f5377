/* Hard cutting: thousands of random removals while a tool presses; everything removed; held pieces cut free. After each
 * the tissue must equal a fresh build of what is left, bit for bit. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "stability.h"

/* Differing bytes of forces and masses between the cut tissue and a fresh one with the same living tetrahedra. */
static int64_t differing_bytes(bench *b, const bench_def *def) {
    tm_tissue_def fresh_def = tm_tissue_def_default();
    tm_tissue *fresh = NULL;
    int64_t count = -1;
    size_t n = 3 * (size_t)b->mesh->vertex_count;
    double *mine = malloc(n * sizeof *mine), *theirs = malloc(n * sizeof *theirs);
    fresh_def.mesh = b->mesh, fresh_def.material = def->material, fresh_def.material_count = 1,
    fresh_def.alive = tm_tissue_alive(b->tissue), fresh_def.volume = def->volume,
    fresh_def.volume_shear = def->volume_shear;
    if (mine && theirs && tm_tissue_create(&fresh_def, &fresh, NULL) == TM_OK) {
        const double *u = tm_world_state(b->world)->u_m;
        tm_tissue_force(b->tissue, u, mine);
        tm_tissue_force(fresh, u, theirs);
        count = 0;
        for (size_t i = 0; i < n * sizeof *mine; i++)
            count += ((unsigned char *)mine)[i] != ((unsigned char *)theirs)[i];
        for (size_t i = 0; i < n / 3 * sizeof *mine; i++)
            count += ((const unsigned char *)tm_tissue_mass_kg(b->tissue))[i] !=
                     ((const unsigned char *)tm_tissue_mass_kg(fresh))[i];
    }
    tm_tissue_destroy(fresh);
    free(mine);
    free(theirs);
    return count;
}

static tm_status add_tool(bench *b, double size_m, tm_contact **contact) {
    tm_instrument_def tool = {.mode = TM_TOOL_PROBE,
                              .radius_m = 0.0025,
                              .contact_length_m = 0.1,
                              .trocar_m = {size_m / 2, size_m / 2, 4 * size_m},
                              .pose = {.tip_m = {size_m / 2, size_m / 2, 2 * size_m}, .active = true}};
    tm_contact_def def = tm_contact_def_default();
    def.instrument_count = 1, def.instrument = &tool;
    return tm_stage_contact(b->world, &def, contact, NULL);
}

/* Random living tetrahedra, one to ten a frame, until `goal` are gone; the tool presses and slides all the while. */
static void random_cuts_of(bool quick, double whole_goal, bool volume, outcome *o) {
    bench_def def = bench_default();
    bench b;
    tm_contact *contact = NULL;
    int cells = quick ? 6 : 13;
    int32_t goal = quick ? 1000 : (int32_t)whole_goal, gone = 0;
    def.cells[0] = def.cells[1] = def.cells[2] = cells;
    def.material[0].damping_1_s = 40, def.cuttable = true, def.volume = volume;
    if (!bench_open(&def, &b, o)) return;
    tm_status status = add_tool(&b, def.size_m[0], &contact);
    uint64_t seed = 2024;
    double peak = 0;
    o->x_name = "tetrahedra removed", o->y_name = "force N";
    for (int frame = 0; gone < goal && tm_tissue_alive_count(b.tissue) > 0 && status == TM_OK; frame++) {
        int32_t pick[10], wanted = 1 + (int32_t)(4.5 * (1 + random_unit(&seed)));
        for (int i = 0; i < wanted; i++) pick[i] = (int32_t)(0.5 * (1 + random_unit(&seed)) * (b.mesh->tet_count - 1));
        gone += tm_cut_remove(b.tissue, pick, wanted, NULL, 0);
        int32_t n = (int32_t)(0.01 / tm_world_step_s(b.world));
        tm_tool_pose to = {.tip_m = {0.02 + 0.01 * cos(0.1 * frame), 0.02 + 0.01 * sin(0.07 * frame),
                                     0.038 + 0.004 * sin(0.05 * frame)},
                           .active = true};
        tm_contact_begin_frame(contact, n, 4);
        tm_contact_move(contact, 0, &to, n);
        status = tm_world_step(b.world, n);
        double force = fabs(tm_contact_reaction(contact, 0).force_N[2]);
        peak = fmax(peak, force);
        if (frame % 5 == 0) series_add(o, gone, force);
    }
    int64_t bytes = differing_bytes(&b, &def);
    if (status != TM_OK)
        broken(o, "unstable after %d removals", (int)gone);
    else
        accurate(o, (double)bytes,
                 "%d removed, %d left, peak force %.3g N; %lld bytes of force and mass differ from a fresh build",
                 (int)gone, (int)tm_tissue_alive_count(b.tissue), peak, (long long)bytes);
    bench_close(&b);
}

static void random_cuts(bool quick, double whole_goal, outcome *o) { random_cuts_of(quick, whole_goal, false, o); }
static void random_cuts_volume(bool quick, double whole_goal, outcome *o) {
    random_cuts_of(quick, whole_goal, true, o);
}

/* Everything goes, layer by layer from the top, the tool following; what is left is an empty, valid model that goes on
 * stepping. */
static void cut_all(bool quick, double argument, outcome *o) {
    (void)argument;
    bench_def def = bench_default();
    bench b;
    tm_contact *contact = NULL;
    def.cells[0] = def.cells[1] = def.cells[2] = quick ? 4 : 8;
    def.material[0].damping_1_s = 40, def.cuttable = true;
    if (!bench_open(&def, &b, o)) return;
    tm_status status = add_tool(&b, def.size_m[0], &contact);
    o->x_name = "frame", o->y_name = "tetrahedra";
    for (int32_t t = b.mesh->tet_count - 1, frame = 0; t >= 0 && status == TM_OK; t -= 7, frame++) {
        int32_t pick[7], n = 0;
        while (n < 7 && t - n >= 0) pick[n] = t - n, n++;
        tm_cut_remove(b.tissue, pick, n, NULL, 0);
        tm_tool_pose to = {.tip_m = {0.02, 0.02, 0.04 * t / b.mesh->tet_count}, .active = true};
        tm_contact_begin_frame(contact, 8, 4);
        tm_contact_move(contact, 0, &to, 8);
        status = tm_world_step(b.world, 8);
        series_add(o, frame, tm_tissue_alive_count(b.tissue));
    }
    if (status == TM_OK) status = tm_world_step(b.world, 1000);
    double mass = 0;
    for (int32_t v = 0; v < b.mesh->vertex_count; v++) mass += tm_tissue_mass_kg(b.tissue)[v];
    if (status != TM_OK)
        broken(o, "the emptied model became unstable");
    else
        accurate(o, tm_tissue_alive_count(b.tissue) + mass + tm_tissue_surface(b.tissue).count,
                 "%d tetrahedra, %g kg and %d triangles left; it goes on stepping",
                 (int)tm_tissue_alive_count(b.tissue), mass, (int)tm_tissue_surface(b.tissue).count);
    bench_close(&b);
}

#define CUT "cut"
const hard_case cases_cut[] = {
    {CUT, "cut-10000", "10,000 random cuts (quick: 1,000) in contact", ACCURATE, 0, "differing bytes", random_cuts,
     10000},
    {CUT, "cut-volume", "1,000 random cuts in contact of tissue with the effect volume", ACCURATE, 0, "differing bytes",
     random_cuts_volume, 1000},
    {CUT, "cut-everything", "everything cut away under the tool", ACCURATE, 0, "tetrahedra + kg + triangles left",
     cut_all, 0},
};
const int cases_cut_count = sizeof cases_cut / sizeof *cases_cut;
