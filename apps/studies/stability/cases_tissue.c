/* Tissue: nearly incompressible, stiff next to soft, fibres at the limit of definiteness, slivers, broken meshes,
 * supports, long runs. */
#include <fenv.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bandwidth.h"
#include "block.h"
#include "stability.h"
#include "tensormass_io.h"

static int64_t steps(bool quick) { return quick ? 20000 : 200000; }

/* Runs undamped from random velocities at 0.95 times the guaranteed step and judges the scheme's energy. */
static void swing(app_bench *b, bool quick, outcome *o, const char *loss) {
    double dt = tm_world_step_s(b->world), drift = energy_drift(b, steps(quick), o);
    if (drift < 0)
        broken(o, "displacements stopped being finite");
    else
        stable(o, drift, "energy within %.1e over %lld steps of %.3g us; %s", drift, (long long)steps(quick), 1e6 * dt,
               loss);
}

static void poisson(bool quick, double nu, outcome *o) {
    app_bench_def def = bench_default();
    app_bench b;
    tm_error error = {0};
    if (tm_material_young(5e3, nu, &def.material[0], &error) != TM_OK) {
        refused(o, &error);
        return;
    }
    if (!bench_open(&def, &b, o)) return;
    app_bench_def soft = bench_default();
    soft.material[0] = def.material[0];
    if (tm_material_young(5e3, 0.3, &soft.material[0], NULL) != TM_OK) abort();
    app_bench s;
    char loss[200] = "";
    outcome ignored = {0};
    if (bench_open(&soft, &s, &ignored)) {
        snprintf(loss, sizeof loss,
                 "the step is %.1f times shorter than at nu = 0.3, and linear tetrahedra lock (see make accuracy)",
                 tm_world_step_s(s.world) / tm_world_step_s(b.world));
        app_bench_close(&s);
    }
    swing(&b, quick, o, loss);
    app_bench_close(&b);
}

static void contrast(bool quick, double ratio, outcome *o) {
    app_bench_def def = bench_default();
    app_bench b;
    def.material_count = 2;
    if (tm_material_young(5e3 * ratio, 0.45, &def.material[1], NULL) != TM_OK) abort();
    if (!bench_open(&def, &b, o)) return;
    char loss[120];
    snprintf(loss, sizeof loss, "the step is that of the stiff half, %.0f times shorter", sqrt(ratio));
    swing(&b, quick, o, loss);
    app_bench_close(&b);
}

/* lambda = mu = 1 kPa, C13 = lambda: positive definite while C33 > C13^2 / (lambda_T + mu_T) = 500 Pa. `margin` above
 * or below it. */
static void fibre_margin(bool quick, double margin, outcome *o) {
    static const double oblique[3] = {1.0 / 3, 2.0 / 3, 2.0 / 3};
    app_bench_def def = bench_default();
    app_bench b;
    tm_error error = {0};
    double beta = 500.0 * (1 + margin) - 3000.0;
    if (tm_material_five(1e3, 1e3, 1e3, 1e3, beta, &def.material[0], &error) != TM_OK) {
        refused(o, &error);
        return;
    }
    def.fibre = oblique;
    if (!bench_open(&def, &b, o)) return;
    swing(&b, quick, o, "one mode is a thousand times softer than the others");
    app_bench_close(&b);
}

/* Moves one inner vertex towards the opposite face of one of its tetrahedra: aspect ratios up to 1e6. */
static void squash(double *v, int32_t count, double aspect) {
    (void)count;
    double *inner = v + 3 * (2 + 5 * (2 + 5 * 2)), *base = v + 3 * (1 + 5 * (2 + 5 * 2));
    double cell = 0.01, keep = 1 / aspect;
    inner[0] = base[0] + cell * keep;
}

static void sliver(bool quick, double aspect, outcome *o) {
    app_bench_def def = bench_default();
    app_bench b;
    def.deform = squash, def.argument = aspect;
    if (!bench_open(&def, &b, o)) return;
    int32_t tet = -1;
    double worst = 0;
    for (int32_t t = 0; t < b.mesh->tet_count; t++) worst = fmax(worst, tm_mesh_tet_quality(b.mesh, t).aspect);
    double step = tm_critical_step_guaranteed(b.tissue, &tet);
    char loss[160];
    snprintf(loss, sizeof loss, "aspect %.1e, and tetrahedron %d alone sets the step: %.3g us", worst, (int)tet,
             1e6 * step);
    swing(&b, quick, o, loss);
    app_bench_close(&b);
}

typedef enum damage { FLAT, INVERTED, TWICE, UNUSED, VERTEX_TWICE, NOT_A_NUMBER, OUT_OF_RANGE } damage;

static void damaged(bool quick, double which, outcome *o) {
    (void)quick;
    app_block block;
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    if (!app_block_build(&block, (int32_t[3]){2, 2, 2}, (double[3]){0.02, 0.02, 0.02})) {
        broken(o, "no memory");
        return;
    }
    int32_t swap;
    switch ((damage)(int)which) {
    case FLAT: memcpy(block.vertex_m + 3 * block.tet[3], block.vertex_m + 3 * block.tet[2], 3 * sizeof(double)); break;
    case INVERTED: swap = block.tet[4], block.tet[4] = block.tet[5], block.tet[5] = swap; break;
    case TWICE: memcpy(block.tet + 4, block.tet, 4 * sizeof(int32_t)); break;
    case UNUSED: block.tet_count -= 6; break; /* the last cube: its far corner is now in no tetrahedron */
    case VERTEX_TWICE: block.tet[1] = block.tet[0]; break;
    case NOT_A_NUMBER: block.vertex_m[10] = NAN; break;
    case OUT_OF_RANGE: block.tet[7] = block.vertex_count; break;
    }
    if (app_block_mesh(&block, NULL, &mesh, &error) == TM_OK)
        broken(o, "a damaged mesh was taken for good");
    else
        refused(o, &error);
    tm_mesh_destroy(mesh);
    app_block_free(&block);
}

/* Writes a file with every defect that tm-mesh can repair. The repaired mesh must swing like any other. */
static void write_damaged(FILE *file, const app_block *block) {
    const int32_t n = block->vertex_count;
    fprintf(file, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n%d\n", (int)n + 1);
    for (int32_t v = 0; v < n; v++)
        fprintf(file, "%d %.17g %.17g %.17g\n", (int)v + 1, block->vertex_m[3 * v], block->vertex_m[3 * v + 1],
                block->vertex_m[3 * v + 2]);
    fprintf(file, "%d 9 9 9\n$EndNodes\n$Elements\n%d\n", (int)n + 1, (int)block->tet_count + 3);
    for (int32_t t = 0; t < block->tet_count; t++) {
        const int32_t *v = block->tet + 4 * t;
        const bool inverted = t % 7 == 0;
        fprintf(file, "%d 4 2 1 1 %d %d %d %d\n", (int)t + 1, (int)v[0] + 1, (int)v[1] + 1,
                (int)v[inverted ? 3 : 2] + 1, (int)v[inverted ? 2 : 3] + 1);
    }
    const int32_t *v = block->tet + 4 * 20, next = block->tet_count + 1;
    fprintf(file, "%d 4 2 1 1 %d %d %d %d\n", (int)next, (int)v[3] + 1, (int)v[2] + 1, (int)v[1] + 1, (int)v[0] + 1);
    fprintf(file, "%d 4 2 1 1 1 2 2 3\n%d 4 2 1 1 1 2 3 4\n$EndElements\n", (int)next + 1, (int)next + 2);
}

static void repaired(bool quick, double argument, outcome *o) {
    (void)argument;
    char folder[] = "/tmp/tm-stability-XXXXXX", bad[64], good[64], command[1400], here[1024] = "";
    app_bench_def def = bench_default();
    app_bench b = {0};
    app_block block = {0};
    tm_mesh_file file = {0};
    tm_error error = {0};
    const ssize_t length = readlink("/proc/self/exe", here, sizeof here - 1);
    char *slash = length > 0 ? strrchr(here, '/') : NULL;
    if (!slash || !mkdtemp(folder) || !app_block_build(&block, def.cells, def.size_m)) {
        broken(o, "no room in /tmp");
        return;
    }
    *slash = '\0';
    snprintf(bad, sizeof bad, "%s/bad.msh", folder);
    snprintf(good, sizeof good, "%s/good.msh", folder);
    FILE *out = fopen(bad, "w");
    if (out) write_damaged(out, &block), fclose(out);
    const bool refused_first =
        tm_mesh_file_load(bad, 1, &file, &error) != TM_OK || tm_mesh_file_build(&file, &b.mesh, &error) != TM_OK;
    tm_mesh_file_free(&file);
    snprintf(command, sizeof command, "'%s/tm-mesh' repair %s -o %s > /dev/null", here, bad, good);
    if (!refused_first)
        broken(o, "the damaged mesh was taken as it is");
    else if (system(command) != 0)
        broken(o, "tm-mesh repair gave up");
    else if (tm_mesh_file_load(good, 1, &file, &error) != TM_OK || tm_mesh_file_build(&file, &b.mesh, &error) != TM_OK)
        refused(o, &error);
    else if (b.mesh->tet_count != block.tet_count || b.mesh->vertex_count != block.vertex_count)
        broken(o, "%d tetrahedra are left of %d", b.mesh->tet_count, block.tet_count);
    else if (bench_start(&def, &b, o))
        swing(
            &b, quick, o,
            "every seventh tetrahedron turned; a double, a flat, one with a vertex twice and an unused vertex dropped");
    app_bench_close(&b);
    tm_mesh_file_free(&file);
    app_block_free(&block);
    unlink(bad);
    unlink(good);
    rmdir(folder);
}

/* Two blocks without common vertices; the upper one floats. It must move as a free body, and settling must refuse
 * it. */
static void disconnected(bool quick, double settle, outcome *o) {
    app_block block;
    tm_error error = {0};
    app_bench b = {0};
    if (!app_block_build(&block, (int32_t[3]){2, 2, 3}, (double[3]){0.02, 0.02, 0.03})) return;
    /* Omits the middle layer; each layer has four cubes of six. */
    memmove(block.tet + 4 * 24, block.tet + 4 * 48, sizeof(int32_t) * 4 * 24);
    block.tet_count = 48;
    app_bench_def def = bench_default();
    def.cells[0] = def.cells[1] = 2, def.cells[2] = 3, def.step_fraction = 0.9;
    tm_status status = app_block_mesh(&block, NULL, &b.mesh, &error);
    app_block_free(&block);
    if (status == TM_OK) status = app_bench_start(&def, &b, &error);
    static const double g[3] = {0, 0, -9.81};
    if (status == TM_OK) status = tm_stage_gravity(b.world, g, &error);
    if (status == TM_OK && settle != 0) {
        tm_settle_def how = tm_settle_def_default();
        tm_settle_result result;
        status = tm_world_settle(b.world, &how, &result, &error);
        if (status == TM_OK) broken(o, "a floating piece came to rest under gravity");
    } else if (status == TM_OK) {
        int64_t n = quick ? 2000 : 20000;
        status = tm_world_step(b.world, (int32_t)n);
        const tm_state *s = tm_world_state(b.world);
        double fall = -0.5 * 9.81 * s->time_s * (s->time_s + s->dt_s), got = s->u_m[3 * (b.mesh->vertex_count - 1) + 2];
        accurate(o, fabs(got / fall - 1), "the free block fell %.6g m, the scheme's closed form says %.6g m", -got,
                 -fall);
    }
    if (status != TM_OK) refused(o, &error);
    app_bench_close(&b);
}

/* Supports nowhere, at one vertex, everywhere: the motion stays bounded, and the rigid-body modes of the clamp are
 * correct. */
static void supports(bool quick, double held, outcome *o) {
    app_bench_def def = bench_default();
    app_bench b;
    def.held = (int)held;
    if (!bench_open(&def, &b, o)) return;
    if (held == 3) {
        tm_status status = tm_world_step(b.world, 1000);
        double moved = 0;
        for (int32_t i = 0; i < 3 * b.mesh->vertex_count; i++)
            moved = fmax(moved, fabs(tm_world_state(b.world)->u_m[i]));
        if (status == TM_OK)
            accurate(o, moved, "nothing moved");
        else
            broken(o, "a fully held block became unstable");
    } else
        swing(&b, quick, o, held == 1 ? "swings about its one vertex" : "flies freely");
    app_bench_close(&b);
}

/* A damped block comes to rest and stays: no drift. Remaining values may be subnormal; the curve shows whether that is
 * slower. */
static void ten_million(bool quick, double argument, outcome *o) {
    (void)argument;
    app_bench_def def = bench_default();
    app_bench b;
    def.cells[0] = def.cells[1] = def.cells[2] = 1;
    def.material[0].damping_1_s = 60;
    if (!bench_open(&def, &b, o)) return;
    random_velocities(&b, 7, 0.1);
    int64_t total = quick ? 1000000 : 10000000, piece = total / 100;
    double first = 0, last = 0;
    tm_status status = TM_OK;
    o->x_name = "steps", o->y_name = "ns a step";
    for (int i = 0; i < 100 && status == TM_OK; i++) {
        double start = app_seconds();
        status = tm_world_step(b.world, (int32_t)piece);
        double ns = 1e9 * (app_seconds() - start) / (double)piece;
        *(i < 10 ? &first : &last) += i < 10 || i >= 90 ? ns / 10 : 0;
        series_add(o, (double)(i + 1) * (double)piece, ns);
    }
    double moved = 0;
    int subnormal = 0;
    for (int32_t i = 0; i < 3 * b.mesh->vertex_count; i++) {
        double u = fabs(tm_world_state(b.world)->u_m[i]);
        moved = fmax(moved, u);
        subnormal += u > 0 && u < DBL_MIN;
    }
    if (status != TM_OK)
        broken(o, "the run became unstable");
    else
        accurate(
            o, moved,
            "after %lld steps the block is %.1e m from rest with %d subnormal components; the last steps took %.2f of the first ones' time",
            (long long)total, moved, subnormal, last / first);
    app_bench_close(&b);
}

static void step_above(bool quick, double factor, outcome *o) {
    (void)quick;
    app_bench_def def = bench_default();
    app_bench b;
    if (!bench_open(&def, &b, o)) return;
    double guaranteed = tm_critical_step_guaranteed(b.tissue, NULL);
    app_bench_close(&b);
    def.dt_s = guaranteed * factor;
    if (bench_open(&def, &b, o)) {
        broken(o, "a step of %.3g times the guaranteed one was taken", factor);
        app_bench_close(&b);
    }
}

/* Changes the step at random within the guaranteed one while the block swings. */
static void changing_step(bool quick, double argument, outcome *o) {
    (void)argument;
    app_bench_def def = bench_default();
    app_bench b;
    def.material[0].damping_1_s = 1;
    if (!bench_open(&def, &b, o)) return;
    double guaranteed = tm_critical_step_guaranteed(b.tissue, NULL), most = 0, start = 0;
    double *scratch = app_zeroed(3 * (size_t)b.mesh->vertex_count, sizeof *scratch);
    random_velocities(&b, 3, 0.1);
    start = scheme_energy(&b, scratch);
    uint64_t seed = 99;
    tm_status status = TM_OK;
    o->x_name = "simulated s", o->y_name = "energy / energy at the start";
    for (int i = 0; i < (quick ? 500 : 5000) && status == TM_OK; i++) {
        status = tm_world_set_step(b.world, guaranteed * (0.55 + 0.4 * random_unit(&seed)), NULL);
        if (status == TM_OK) status = tm_world_step(b.world, 30); /* one frame's duration */
        double now = scheme_energy(&b, scratch) / start;
        most = fmax(most, now);
        if (i % 10 == 0) series_add(o, tm_world_state(b.world)->time_s, now);
    }
    free(scratch);
    if (status != TM_OK)
        broken(o, "changing the step made it unstable");
    else
        stable(o, most, "the largest energy was %.3f of the first", most);
    app_bench_close(&b);
}

#define TISSUE "tissue"
const hard_case cases_tissue[] = {
    {TISSUE, "poisson-0.3", "nu = 0.3", STABLE, 1e-9, "energy drift", poisson, 0.3},
    {TISSUE, "poisson-0.45", "nu = 0.45", STABLE, 1e-9, "energy drift", poisson, 0.45},
    {TISSUE, "poisson-0.49", "nu = 0.49", STABLE, 1e-9, "energy drift", poisson, 0.49},
    {TISSUE, "poisson-0.499", "nu = 0.499", STABLE, 1e-9, "energy drift", poisson, 0.499},
    {TISSUE, "poisson-0.4999", "nu = 0.4999, nearly incompressible", STABLE, 1e-9, "energy drift", poisson, 0.4999},
    {TISSUE, "poisson-0.5", "nu = 0.5, incompressible", REFUSED, 0, "", poisson, 0.5},
    {TISSUE, "contrast-1e2", "stiffness contrast 1e2 across a face", STABLE, 1e-9, "energy drift", contrast, 1e2},
    {TISSUE, "contrast-1e4", "stiffness contrast 1e4 across a face", STABLE, 1e-9, "energy drift", contrast, 1e4},
    {TISSUE, "contrast-1e6", "stiffness contrast 1e6 across a face", STABLE, 1e-8, "energy drift", contrast, 1e6},
    {TISSUE, "fibre-barely", "fibres 0.1 % from indefinite", STABLE, 1e-9, "energy drift", fibre_margin, 1e-3},
    {TISSUE, "fibre-indefinite", "fibres 0.1 % past definite", REFUSED, 0, "", fibre_margin, -1e-3},
    {TISSUE, "sliver-1e1", "sliver of aspect 10", STABLE, 1e-9, "energy drift", sliver, 1e1},
    {TISSUE, "sliver-1e3", "sliver of aspect 1e3", STABLE, 1e-8, "energy drift", sliver, 1e3},
    {TISSUE, "sliver-1e6", "sliver of aspect 1e6", STABLE, 1e-6, "energy drift", sliver, 1e6},
    {TISSUE, "flat", "a flat tetrahedron", REFUSED, 0, "", damaged, FLAT},
    {TISSUE, "inverted", "an inverted tetrahedron", REFUSED, 0, "", damaged, INVERTED},
    {TISSUE, "duplicate", "a tetrahedron twice", REFUSED, 0, "", damaged, TWICE},
    {TISSUE, "unused", "a vertex in no tetrahedron", REFUSED, 0, "", damaged, UNUSED},
    {TISSUE, "vertex-twice", "a vertex twice in one tetrahedron", REFUSED, 0, "", damaged, VERTEX_TWICE},
    {TISSUE, "nan-vertex", "a coordinate that is NaN", REFUSED, 0, "", damaged, NOT_A_NUMBER},
    {TISSUE, "out-of-range", "an index past the last vertex", REFUSED, 0, "", damaged, OUT_OF_RANGE},
    {TISSUE, "repaired", "all of these but the last two in one file, after tm-mesh repair", STABLE, 1e-9,
     "energy drift", repaired, 0},
    {TISSUE, "disconnected-falls", "a piece held by nothing, under gravity", ACCURATE, 1e-6, "error of the fall",
     disconnected, 0},
    {TISSUE, "disconnected-settles", "a piece held by nothing, asked to settle", REFUSED, 0, "", disconnected, 1},
    {TISSUE, "held-nowhere", "no fixed vertex: it flies tens of metres, whose rounding is in the figure", STABLE, 1e-8,
     "energy drift", supports, 0},
    {TISSUE, "held-once", "one fixed vertex", STABLE, 1e-8, "energy drift", supports, 1},
    {TISSUE, "held-everywhere", "every vertex fixed", ACCURATE, 0, "m moved", supports, 3},
    {TISSUE, "ten-million-steps", "1e7 steps (quick: 1e6) of a damped block", ACCURATE, 1e-12, "m from rest",
     ten_million, 0},
    {TISSUE, "step-too-long", "a user step 1 % above the guaranteed one", REFUSED, 0, "", step_above, 1.01},
    {TISSUE, "step-changes", "the step changes at random every frame of 30 steps", STABLE, 5,
     "largest energy over the first", changing_step, 0},
};
const int cases_tissue_count = sizeof cases_tissue / sizeof *cases_tissue;
