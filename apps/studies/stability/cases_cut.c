/* Cutting: thousands of random removals while a tool presses; everything removed; held fragments cut free. After each,
 * the tissue must be bit-identical to tissue newly built from the remaining tetrahedra. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "stability.h"

/* Counts differing bytes of forces and masses between the cut tissue and new tissue with the same active tetrahedra. */
static int64_t differing_bytes(app_bench *b, const app_bench_def *def) {
    tm_tissue_def fresh_def = tm_tissue_def_default();
    tm_tissue *fresh = NULL;
    int64_t count = -1;
    size_t n = 3 * (size_t)b->mesh->vertex_count;
    double *mine = app_zeroed(n, sizeof *mine), *theirs = app_zeroed(n, sizeof *theirs);
    fresh_def.mesh = b->mesh, fresh_def.material = def->material, fresh_def.material_count = 1,
    fresh_def.alive = tm_tissue_alive(b->tissue), fresh_def.strain_smoothing = def->volume,
    fresh_def.smoothed_shear_share = def->smoothed_shear_share;
    if (tm_tissue_create(&fresh_def, &fresh, NULL) == TM_OK) {
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

static bool open_block(int cells, bool volume, const char *y_name, rig_def *def, rig *r, outcome *o) {
    *def = rig_default(1, &(tm_tool_pose){.tip_m = {0.02, 0.02, 0.08}, .active = true});
    def->tool[0].trocar_m[2] = 0.16;
    def->bench.cells[0] = def->bench.cells[1] = def->bench.cells[2] = cells;
    def->bench.material[0].damping_1_s = 40, def->bench.cuttable = true, def->bench.volume = volume;
    return rig_open(def, r, y_name, o);
}

/* Removes random active tetrahedra, one to ten per frame, until `goal` are gone, while the tool presses and slides. */
static void random_cuts_of(bool quick, double whole_goal, bool volume, outcome *o) {
    rig_def def;
    rig r;
    int32_t goal = quick ? 1000 : (int32_t)whole_goal, gone = 0;
    if (!open_block(quick ? 6 : 13, volume, "force N", &def, &r, o)) return;
    app_bench b = r.b;
    uint64_t seed = 2024;
    double peak = 0;
    o->x_name = "tetrahedra removed";
    for (int frame = 0; gone < goal && tm_tissue_alive_count(b.tissue) > 0 && r.finite; frame++) {
        int32_t pick[10], wanted = 1 + (int32_t)(4.5 * (1 + random_unit(&seed)));
        for (int i = 0; i < wanted; i++) pick[i] = (int32_t)(0.5 * (1 + random_unit(&seed)) * (b.mesh->tet_count - 1));
        gone += tm_cut_remove(b.tissue, pick, wanted, NULL, 0);
        r.at[0] = (tm_tool_pose){.tip_m = {0.02 + 0.01 * cos(0.1 * frame), 0.02 + 0.01 * sin(0.07 * frame),
                                           0.038 + 0.004 * sin(0.05 * frame)},
                                 .active = true};
        rig_steps(&r, (int32_t)(0.01 / tm_world_step_s(b.world)), 4, false);
        const double force = fabs(r.force_N[0][2]);
        peak = fmax(peak, force);
        if (frame % 5 == 0) series_add(o, gone, force);
    }
    int64_t bytes = differing_bytes(&b, &def.bench);
    if (!r.finite)
        broken(o, "unstable after %d removals", (int)gone);
    else
        accurate(o, (double)bytes,
                 "%d removed, %d left, peak force %.3g N; %lld bytes of force and mass differ from a fresh build",
                 (int)gone, (int)tm_tissue_alive_count(b.tissue), peak, (long long)bytes);
    app_bench_close(&b);
}

static void random_cuts(bool quick, double whole_goal, outcome *o) { random_cuts_of(quick, whole_goal, false, o); }
static void random_cuts_volume(bool quick, double whole_goal, outcome *o) {
    random_cuts_of(quick, whole_goal, true, o);
}

/* Removes everything, layer by layer from the top, with the tool following. The empty model must be valid and continue
 * to step. */
static void cut_all(bool quick, double argument, outcome *o) {
    (void)argument;
    rig_def def;
    rig r;
    if (!open_block(quick ? 4 : 8, false, "tetrahedra", &def, &r, o)) return;
    app_bench b = r.b;
    o->x_name = "frame";
    for (int32_t t = b.mesh->tet_count - 1, frame = 0; t >= 0 && r.finite; t -= 7, frame++) {
        int32_t pick[7], n = 0;
        while (n < 7 && t - n >= 0) pick[n] = t - n, n++;
        tm_cut_remove(b.tissue, pick, n, NULL, 0);
        r.at[0].tip_m[2] = 0.04 * t / b.mesh->tet_count;
        rig_steps(&r, 8, 4, false);
        series_add(o, frame, tm_tissue_alive_count(b.tissue));
    }
    const bool goes_on = r.finite && tm_world_step(b.world, 1000) == TM_OK;
    double mass = 0;
    for (int32_t v = 0; v < b.mesh->vertex_count; v++) mass += tm_tissue_mass_kg(b.tissue)[v];
    if (!goes_on)
        broken(o, "the emptied model became unstable");
    else
        accurate(o, tm_tissue_alive_count(b.tissue) + mass + tm_tissue_surface(b.tissue).count,
                 "%d tetrahedra, %g kg and %d triangles left; it goes on stepping",
                 (int)tm_tissue_alive_count(b.tissue), mass, (int)tm_tissue_surface(b.tissue).count);
    app_bench_close(&b);
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
