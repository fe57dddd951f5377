/* Random sequences of public calls: two worlds, each in its own thread and then both in one, dynamic or hybrid, with
 * a precomputed model; numbers that are not finite, removed tetrahedra, stages added and removed.
 *
 * No access is out of bounds, no number that is not finite is accepted, a failed step changes nothing, and two
 * worlds are independent: bit-identical in two threads and in one. */
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

#include "fuzz.h"
#include "tensormass/energy.h"
#include "tensormass_solve.h"

enum { CALLS = 32, CELLS = 2 };

/* One world and its objects; a handle is null while its stage is absent. */
typedef struct actor {
    fuzz_bytes bytes;
    fuzz_body body;
    uint8_t *dynamic;
    tm_hybrid *hybrid;
    tm_tissue *tissue; /* of the world: owned by body or by the hybrid */
    tm_world *world;
    tm_contact *contact;
    tm_grasp *grasp;
    tm_patch_builder *maker;
    tm_precomputed *stored;
    int stored_calls;
    uint64_t hash;
} actor;

static atomic_int broken;
static _Thread_local int broken_here;

static void on_broken(const char *function, const char *sentence, void *user) {
    (void)user;
    PROMISE(function[0] && sentence[0]);
    atomic_fetch_add(&broken, 1);
    broken_here++;
}

static const tm_instrument_def tools[2] = {
    {TM_TOOL_GRASPER, false, {0.005, 0.005, 0.1}, 0.002, 0.012, {.tip_m = {0.005, 0.005, 0.014}, .active = true}},
    {TM_TOOL_CAUTERY, false, {0.002, 0.002, 0.1}, 0.002, 0.012, {.tip_m = {0.002, 0.002, 0.014}, .active = true}}};

/* --- numbers: small and plausible, or arbitrary --- */

static double any_number(fuzz_bytes *b) {
    static const double odd[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 0, -1, 1e-320};
    const uint8_t how = fuzz_u8(b);
    if (how < 8) return odd[how];
    if (how < 12) {
        double x;
        fuzz_take(b, &x, sizeof x);
        return x;
    }
    return (how - 128) * 1e-4;
}

static int32_t any_index(fuzz_bytes *b, int32_t count) {
    const uint8_t how = fuzz_u8(b);
    if (how == 0) return -1;
    if (how == 1) return INT32_MIN;
    if (how == 2) return count;
    if (how == 3) return INT32_MAX;
    return count > 0 ? (how * 7 + fuzz_u8(b)) % count : 0;
}

static tm_tool_pose any_pose(fuzz_bytes *b) {
    tm_tool_pose pose = {.roll_rad = any_number(b), .active = fuzz_u8(b) % 4 != 0};
    for (int c = 0; c < 3; c++) pose.tip_m[c] = any_number(b) + (c == 2 ? 0.008 : 0.004);
    pose.grip = fuzz_u8(b) % 3 == 0 ? any_number(b) : fuzz_u8(b) / 255.0;
    return pose;
}

/* --- set-up --- */

static void add_contact(actor *a) {
    tm_contact_def def = tm_contact_def_default();
    def.instrument_count = 2, def.instrument = tools;
    tm_contact *contact = NULL;
    if (tm_stage_contact(a->world, &def, &contact, NULL) == TM_OK) a->contact = contact;
}

static bool has(const actor *a, const char *name) {
    tm_stage_report report[TM_MAX_STAGES];
    for (int32_t i = tm_world_stages(a->world, report) - 1; i >= 0; i--)
        if (!strcmp(report[i].name, name)) return true;
    return false;
}

static void open_world(actor *a) {
    tm_world_def def = tm_world_def_default();
    def.tissue = a->tissue;
    if (a->hybrid) def.dt_s = 0.9 * tm_hybrid_critical_step(a->hybrid, NULL);
    PROMISE(tm_world_create(&def, &a->world, NULL) == TM_OK);
}

static void open_actor(actor *a, const uint8_t *data, size_t size) {
    *a = (actor){.bytes = {data, size}, .body = fuzz_block(CELLS, true), .hash = TM_HASH_SEED};
    const int32_t tets = a->body.mesh->tet_count;
    if (fuzz_u8(&a->bytes) % 3 == 0) {
        a->dynamic = calloc((size_t)tets, 1);
        for (int32_t t = 0; t < tets; t++) a->dynamic[t] = a->body.mesh->rest_m[3 * a->body.mesh->tet[4 * t]] > 0.004;
        tm_contact_def contact = tm_contact_def_default();
        contact.instrument_count = 2, contact.instrument = tools;
        tm_hybrid_def def = tm_hybrid_def_default();
        def.problem.tissue = a->body.tissue, def.problem.fixed = a->body.fixed, def.problem.threads = 1;
        def.dynamic = a->dynamic, def.contact = &contact;
        PROMISE(tm_hybrid_create(&def, &a->hybrid, NULL, NULL) == TM_OK);
        tm_material material;
        PROMISE(tm_material_young(5000, 0.4, &material, NULL) == TM_OK);
        material.damping_1_s = 20;
        tm_tissue_def tissue = tm_tissue_def_default();
        tissue.mesh = a->body.mesh, tissue.material_count = 1, tissue.material = &material;
        tissue.form = TM_FORCE_PLAIN, tissue.cuttable = true;
        tm_hybrid_tissue(a->hybrid, &tissue);
        PROMISE(tm_tissue_create(&tissue, &a->tissue, NULL) == TM_OK);
    } else {
        a->tissue = a->body.tissue;
    }
    open_world(a);
    add_contact(a);
}

static void close_actor(actor *a) {
    tm_world_destroy(a->world);
    tm_hybrid_destroy(a->hybrid);
    tm_precomputed_destroy(a->stored);
    if (a->tissue != a->body.tissue) tm_tissue_destroy(a->tissue);
    tm_tissue_destroy(a->body.tissue);
    tm_mesh_destroy(a->body.mesh);
    free(a->body.fixed), free(a->dynamic);
}

/* --- the calls --- */

static void add_stage(actor *a, int which) {
    fuzz_bytes *b = &a->bytes;
    tm_error error = {0};
    tm_status status = TM_OK;
    const int before = broken_here;
    double three[3] = {any_number(b), any_number(b), any_number(b)};
    switch (which) {
    case 0: {
        tm_support_def def = tm_support_def_default();
        int32_t dof[3] = {any_index(b, 3 * a->body.mesh->vertex_count), 0, 1};
        def.count = any_index(b, 4), def.dof = dof, def.value_m = three;
        if (def.count > 3) def.count = 3;
        status = tm_stage_support(a->world, &def, &error);
        break;
    }
    case 1: status = tm_stage_gravity(a->world, three, &error); break;
    case 2:
        if (!a->contact) add_contact(a);
        break;
    case 3: {
        tm_grasp_def def = tm_grasp_def_default();
        if (fuzz_u8(b) % 4 == 0) def.release_time_s = any_number(b);
        if (fuzz_u8(b) % 8 == 0) def.cookie = 0;
        tm_grasp *grasp = NULL;
        status = tm_stage_grasp(a->world, a->contact, &def, &grasp, &error);
        if (status == TM_OK) a->grasp = grasp;
        break;
    }
    case 4: {
        tm_patch_def def = tm_patch_def_default();
        def.iterations = 8;
        tm_patch_builder *maker = NULL;
        status = tm_stage_patch(a->world, a->contact, &def, &maker, &error);
        if (status == TM_OK) a->maker = maker;
        break;
    }
    case 5: {
        tm_cut_def def = tm_cut_def_default();
        def.rate_1_s = fuzz_u8(b) % 4 ? 2000 : any_number(b), def.loose = (tm_cut_loose)(fuzz_u8(b) % 3);
        status = tm_stage_cut(a->world, a->contact, &def, &error);
        break;
    }
    case 6: status = tm_stage_energy(a->world, &error); break;
    case 7:
        if (a->hybrid && !has(a, "hybrid")) status = tm_stage_hybrid(a->world, a->hybrid, a->contact, &error);
        break;
    }
    PROMISE(status == TM_OK || error.status == status || broken_here > before);
}

static void remove_stage(actor *a, int which) {
    static const char *const name[] = {"support", "gravity", "contact", "grasp", "patch",
                                       "cut",     "energy",  "hybrid",  "none"};
    tm_error error = {0};
    const tm_status status = tm_world_remove_stage(a->world, name[which], &error);
    PROMISE(status == TM_OK || (error.status == status && strchr(error.message, ';')));
    if (status != TM_OK) return;
    if (which == 2) a->contact = NULL;
    if (which == 3) a->grasp = NULL;
    if (which == 4) a->maker = NULL;
}

static void check_finite(actor *a) {
    const tm_state *state = tm_world_state(a->world);
    for (int32_t i = 0; i < 3 * a->body.mesh->vertex_count; i++) PROMISE(isfinite(state->u_m[i]));
    for (int t = 0; a->contact && t < 2; t++) {
        const tm_tool_reaction r = tm_contact_reaction(a->contact, t);
        for (int c = 0; c < 3; c++) PROMISE(isfinite(r.force_N[c]) && isfinite(r.tip_m[c]));
        PROMISE(r.flags < 128);
    }
}

/* Sets a displacement that is not a number: the step fails and the state is as before it. */
static void spoil(actor *a) {
    const int32_t n = 3 * a->body.mesh->vertex_count;
    double *u = tm_world_state(a->world)->u_m;
    int32_t at = any_index(&a->bytes, n);
    if (at < 0 || at >= n || tm_tissue_mass_kg(a->tissue)[at / 3] <= 0) return;
    const double was = u[at];
    const int64_t step = tm_world_state(a->world)->step;
    const int32_t alive = tm_tissue_alive_count(a->tissue);
    u[at] = NAN;
    tm_settle_def def = tm_settle_def_default();
    PROMISE(tm_world_settle(a->world, &def, NULL, NULL) == TM_ERR_ARGUMENT);
    tm_world_state(a->world)->u_m[at] = NAN;
    const tm_status status = tm_world_step(a->world, 1 + fuzz_u8(&a->bytes) % 8);
    PROMISE(status == TM_ERR_UNSTABLE || (status == TM_OK && has(a, "support"))); /* unless a support overwrites it */
    if (status == TM_ERR_UNSTABLE) {
        PROMISE(tm_world_state(a->world)->step == step && isnan(tm_world_state(a->world)->u_m[at]));
        PROMISE(tm_tissue_alive_count(a->tissue) == alive);
        tm_world_state(a->world)->u_m[at] = was;
    }
}

static void snapshot(actor *a) {
    tm_world_step(a->world, 0); /* updates for cuts since the last call: vertices without mass stop */
    const int64_t bytes = tm_snapshot_bytes(a->world);
    void *buffer = malloc((size_t)bytes);
    PROMISE(tm_snapshot_save(a->world, buffer, bytes, NULL) == TM_OK);
    const uint64_t before = tm_world_hash(a->world);
    tm_world_step(a->world, fuzz_u8(&a->bytes) % 8);
    tm_error error = {0};
    const tm_status status = tm_snapshot_restore(a->world, buffer, bytes, &error);
    if (status != TM_OK) fprintf(stderr, "%s\n", error.message);
    PROMISE(status == TM_OK);
    PROMISE(tm_world_hash(a->world) == before);
    free(buffer);
}

static void stored_model(actor *a) {
    fuzz_bytes *b = &a->bytes;
    if (a->stored_calls++ > 1) return; /* they are expensive */
    if (!a->stored) {
        tm_contact_def contact = tm_contact_def_default();
        contact.instrument_count = 2, contact.instrument = tools;
        tm_grasp_def grasp = tm_grasp_def_default();
        tm_precomputed_def def = tm_precomputed_def_default();
        def.problem.tissue = a->body.tissue, def.problem.fixed = a->body.fixed, def.problem.threads = 1;
        def.contact = &contact, def.grasp = &grasp;
        tm_error error = {0};
        /* After cuts a part may have no support. */
        const tm_status status = tm_precomputed_create(&def, &a->stored, NULL, &error);
        PROMISE(status == TM_OK || error.message[0]);
        if (status != TM_OK) return;
    }
    static _Thread_local tm_patch patch;
    double force[3] = {0}, u[3] = {any_number(b), any_number(b), any_number(b)};
    const tm_tool_pose pose[2] = {any_pose(b), any_pose(b)};
    const int32_t vertex = any_index(b, a->body.mesh->vertex_count), instrument = any_index(b, 2);
    switch (fuzz_u8(b) % 6) {
    case 0: tm_precomputed_update(a->stored, pose); break;
    case 1: tm_precomputed_impose(a->stored, 1, &vertex, u, any_number(b), NULL); break;
    case 2: tm_precomputed_set_pose(a->stored, instrument, pose); break;
    case 3: tm_precomputed_patch(a->stored, instrument, u, any_number(b), 24, 32, &patch); break;
    case 4: tm_precomputed_reaction(a->stored, instrument); break;
    case 5: tm_precomputed_imposed_force(a->stored, instrument, force); break;
    }
    tm_precomputed_force(a->stored, 0, force);
    for (int c = 0; c < 3; c++) PROMISE(isfinite(force[c]));
    a->hash = tm_hash(force, sizeof force, a->hash);
}

static void cut(actor *a) {
    int32_t tet[4], removed[64];
    const int32_t tets = a->body.mesh->tet_count, alive = tm_tissue_alive_count(a->tissue);
    for (int i = 0; i < 4; i++) tet[i] = any_index(&a->bytes, tets);
    const int32_t n = tm_cut_remove(a->tissue, tet, fuzz_u8(&a->bytes) % 5, removed, 64);
    PROMISE(tm_tissue_alive_count(a->tissue) == alive - n);
}

static void call(actor *a) {
    fuzz_bytes *b = &a->bytes;
    static _Thread_local tm_patch patch;
    const uint8_t what = fuzz_u8(b) % 18;
    const int32_t instrument = any_index(b, 2), count = fuzz_u8(b) % 24;
    switch (what) {
    case 0:
    case 1:
    case 2: tm_world_step(a->world, count); break;
    case 3:
    case 4:
    case 5: {
        const tm_tool_pose pose = any_pose(b);
        tm_contact_begin_frame(a->contact, count, any_index(b, 24));
        tm_contact_set_target(a->contact, instrument, &pose, count);
        break;
    }
    case 6: {
        const tm_tool_pose pose = any_pose(b);
        tm_contact_set_pose(a->contact, instrument, &pose);
        break;
    }
    case 7:
    case 8: add_stage(a, count % 8); break;
    case 9: remove_stage(a, count % 9); break;
    case 10: cut(a); break;
    case 11: spoil(a); break;
    case 12: snapshot(a); break;
    case 13: tm_world_set_step(a->world, any_number(b), NULL); break;
    case 14: tm_support_move(a->world, any_index(b, 3), any_number(b)); break;
    case 15:
        tm_patch_compute(a->maker, instrument, &patch);
        tm_grasp_vertices(a->grasp, instrument, NULL, NULL);
        if (a->hybrid && has(a, "hybrid")) tm_hybrid_recover(a->hybrid, a->world);
        break;
    case 16: {
        tm_settle_def def = tm_settle_def_default();
        def.max_steps = 1 + count;
        tm_world_settle(a->world, &def, NULL, NULL);
        break;
    }
    case 17: stored_model(a); break;
    }
    check_finite(a);
}

static void *play(void *of) {
    actor *a = of;
    for (int i = 0; i < CALLS && a->bytes.left; i++) call(a);
    a->hash ^= tm_world_hash(a->world);
    return NULL;
}

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    tm_set_contract_handler(on_broken, NULL);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const size_t half = size / 2;
    actor a[4];
    const int64_t before = tm_memory_in_use();
    for (int i = 0; i < 4; i++) open_actor(a + i, i % 2 ? data + half : data, i % 2 ? size - half : half);
    pthread_t thread;
    PROMISE(!pthread_create(&thread, NULL, play, a));
    play(a + 1);
    pthread_join(thread, NULL);
    play(a + 2);
    play(a + 3);
    PROMISE(a[0].hash == a[2].hash && a[1].hash == a[3].hash);
    for (int i = 0; i < 4; i++) close_actor(a + i);
    PROMISE(tm_memory_in_use() == before);
    return 0;
}
