/* Stage "patch": for each instrument the surface near it, its compliance and the contact stiffness, from the dynamic
 * model. */
#include "material/material_internal.h"
#include "patch/patch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "law/skin.h"

tm_patch_def tm_patch_def_default(void) {
    return (tm_patch_def){.cookie = TM_COOKIE_PATCH,
                          .size = sizeof(tm_patch_def),
                          .max_vertices = TM_PATCH_VERTICES,
                          .max_triangles = TM_PATCH_TRIANGLES,
                          .column_vertices = 64,
                          .tolerance = 3e-3,
                          .horizon_s = 0.08};
}

static void observe_motion(tm_patch_maker *maker, int32_t t) {
    const tm_tool *tool = maker->contact->tool + t;
    double now = maker->world->state.time_s, passed = now - maker->time_s[t];
    if (passed > 0 && passed < 0.5)
        for (int c = 0; c < 3; c++) maker->velocity_m_s[t][c] = (tool->pose.tip_m[c] - maker->tip_m[t][c]) / passed;
    else if (passed != 0)
        memset(maker->velocity_m_s[t], 0, sizeof maker->velocity_m_s[t]);
    vset(tool->pose.tip_m, maker->tip_m[t]);
    maker->time_s[t] = now;
}

/* Vertices that the instrument's jaws hold; -1 while they let go. */
static int32_t held(const tm_patch_maker *maker, int32_t t, tm_patch_hold *hold) {
    *hold = (tm_patch_hold){.force_N = tm_contact_load(maker->contact, t).force_N};
    hold->count = tm_contact_held(maker->contact, t, &hold->vertex, &hold->target_m, &hold->compliance_m_N);
    return hold->count;
}

static void describe(const tm_patch_maker *maker, int32_t t, tm_patch *patch) {
    const tm_contact *contact = maker->contact;
    const tm_tool *tool = contact->tool + t;
    patch->kind = tm_patch_known_kind(maker);
    patch->topology_revision = tm_patch_surface_of(maker).revision;
    patch->skin_compliance_m_N = contact->def.skin_compliance_m_N;
    patch->force_cap_N = contact->def.force_cap_N;
    patch->radius_m = tool->def.radius_m;
    patch->contact_length_m = tool->def.contact_length_m;
    patch->film_s_m = contact->others.solve ? 0 : LAW_FILM_S_M; /* rows of another's block have none */
    vset(tool->def.trocar_m, patch->trocar_m);
}

/* Tissue that a tool shakes sends waves away, which take energy along: as a disc of radius a on half a space does, with
 * a from how stiff it is under the tool at rest, k = 4 G a / (1 - nu). The dashpot is an area's resistance to shear
 * waves, density * c_s * pi a^2, and waves have left after a / c_s. */
#define RADIATES_WITHIN_M 0.02
#define RADIATES_N_S_M 2.0 /* more is of tissue that is stiff rather than heavy, and a controller refuses 10 */

static void radiate(const tm_patch_maker *maker, int32_t t, tm_patch *patch) {
    const tm_tool *tool = maker->contact->tool + t;
    const tm_material *of = tm_tissue_tet_material(maker->world->tissue, maker->surface.view ? 0 : patch->face[0] / 4);
    double normal[3], k = 0;
    if (!(vunit(tool->substep_force_N, normal) > 0)) return;
    for (int i = 0; i < 9; i++) k -= normal[i / 3] * tool->stiffness_N_m[i] * normal[i % 3];
    const double wide = (of->lambda_Pa + 2 * of->mu_Pa) / (2 * (of->lambda_Pa + of->mu_Pa)); /* 1 - nu */
    const double radius = law_clamp(k * wide / (4 * of->mu_Pa), 0, RADIATES_WITHIN_M);
    const double wave_m_s = sqrt(of->mu_Pa / of->density_kg_m3);
    const double dashpot = of->density_kg_m3 * wave_m_s * 3.14159265358979 * radius * radius;
    patch->radiation_N_s_m = law_min(dashpot, RADIATES_N_S_M);
    patch->radiation_s = radius / wave_m_s;
}

/* Surface near a tool that touches or may touch, all of it known. Not for a tool that touches nothing as yet: the patch
 * would touch it. */
static bool find_surface(tm_patch_maker *maker, int32_t t, int32_t max_vertices, double held_N, tm_patch *patch) {
    const tm_tool *tool = maker->contact->tool + t;
    return tm_tool_is_present(tool) && tool->clear && max_vertices >= 3 &&
           tm_patch_find_known(maker, t, max_vertices, held_N, patch);
}

static bool find_stiffness(tm_patch_maker *maker, const tm_patch *patch, tm_tool *tool) {
    return tm_patch_find_stiffness(maker->solver, patch, maker->contact->row, maker->contact->row_count,
                                   tool->pose.tip_m, tool->stiffness_N_m);
}

/* A tool that holds tissue: springs and rows of contact beside them. */
static bool make_held(tm_patch_maker *maker, int32_t t, const tm_patch_hold *hold, tm_patch *patch) {
    const tm_contact *contact = maker->contact;
    tm_tool *tool = maker->contact->tool + t;
    double held_N[3] = {0, 0, 0};
    bool known = hold->count <= TM_HOLD_VERTICES;
    for (int32_t i = 0; i < hold->count && known; i++) {
        known = tm_patch_is_known(maker, hold->vertex[i]);
        vmadd(held_N, 1, hold->force_N + 3 * i, held_N);
    }
    if (!known) return false;
    const bool whole = find_surface(maker, t, maker->def.max_vertices - 1, vnorm(held_N), patch);
    if (!whole) patch->vertex_count = patch->triangle_count = 0;
    if (!whole && tm_patch_bears_outside(patch, vnorm(held_N), contact->row, contact->row_count)) return false;
    describe(maker, t, patch);
    if (!tm_patch_fill_held(maker->solver, patch, hold, tool->pose.tip_m, tm_patch_known_block, maker, contact->row,
                            contact->row_count))
        return false;
    memcpy(tool->stiffness_N_m, patch->hold_stiffness_N_m, sizeof tool->stiffness_N_m);
    if (whole && !find_stiffness(maker, patch, tool)) return false;
    tool->stiffness_kind = patch->kind;
    if (whole) radiate(maker, t, patch);
    return whole;
}

static bool make(tm_patch_maker *maker, int32_t t, tm_patch *patch) {
    const tm_contact *contact = maker->contact;
    tm_tool *tool = maker->contact->tool + t;
    int32_t revision = tm_tissue_surface(maker->world->tissue).revision;
    tool->stiffness_kind = 0;
    memset(patch, 0, sizeof *patch);
    observe_motion(maker, t);
    if (revision != maker->revision && maker->columns) tm_columns_cut(maker->columns);
    maker->revision = revision;
    patch->instrument = t;
    tm_patch_hold hold;
    const int32_t count = held(maker, t, &hold);
    tm_patch_want(maker, t, hold.vertex, count, patch);
    /* Rows that fade bear what no patch knows of, and slip or bear less whatever the tool does. */
    if (tm_fading_has(contact->fading, t)) return false;
    if (count > 0) return make_held(maker, t, &hold, patch);
    if (count < 0 || !find_surface(maker, t, maker->def.max_vertices, 0, patch)) return false;
    describe(maker, t, patch);
    if (!tm_patch_fill(patch, tm_patch_known_block, maker, contact->row, contact->row_count) ||
        !find_stiffness(maker, patch, tool))
        return false;
    tool->stiffness_kind = patch->kind;
    radiate(maker, t, patch);
    return true;
}

/* Behind the stiffness: that is of the shape with friction's forces, as they are held. */
static void rub(const tm_contact *contact, int32_t t, tm_patch *patch) {
    const double(*force_N)[3] = tm_contact_rubbing(contact, t, &patch->friction_static, &patch->friction_sliding);
    for (int32_t i = 0; i < contact->row_count; i++)
        if (contact->row[i].instrument == t) tm_patch_rub(patch, contact->row + i, force_N[i]);
}

bool tm_patch_make(tm_patch_maker *maker, int32_t t, tm_patch *patch) {
    TM_REQUIRE(maker && patch && t >= 0 && t < maker->contact->tool_count,
               "maker or patch is null, or instrument is not one of its contact's", false);
    tm_world *world = maker->world;
    tm_world_work_of(world, maker);
    const bool made = make(maker, t, patch);
    if (!made) patch->kind = 0;
    if (made && tm_contact_rubs(maker->contact, t)) rub(maker->contact, t, patch);
    tm_world_work_of(world, NULL);
    return made;
}

int32_t tm_patch_pending(const tm_patch_maker *maker) {
    TM_REQUIRE(maker, "maker is null", 0);
    if (maker->columns) return tm_columns_pending(maker->columns);
    int32_t pending = 0;
    for (int t = 0; t < maker->contact->tool_count; t++) pending += maker->missing[t];
    return pending;
}

tm_status tm_patch_start(tm_patch_maker *maker, tm_error *error) {
    TM_REQUIRE(maker, "maker is null", TM_ERR_ARGUMENT);
    return maker->source.start ? maker->source.start(maker->source.self, error) : TM_OK;
}

static void destroy(void *self) {
    tm_patch_maker *maker = self;
    if (maker->source.destroy) maker->source.destroy(maker->source.self);
    tm_patch_solver_destroy(maker->solver);
    tm_pool pool = maker->pool;
    tm_pool_release(&pool);
}

tm_status tm_stage_patch(tm_world *world, tm_contact *contact, const tm_patch_def *def, tm_patch_maker **made,
                         tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_PATCH, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && made && contact && contact->world == world,
               "world or maker is null, or contact is not of this world", TM_ERR_ARGUMENT);
    if (def->max_vertices < 3 || def->max_vertices > TM_PATCH_VERTICES || def->max_triangles < 1 ||
        def->max_triangles > TM_PATCH_TRIANGLES || def->column_vertices < def->max_vertices || def->iterations < 0 ||
        !(def->tolerance > 0) || !(def->horizon_s >= 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "patch: %d vertices, %d triangles, %d columns, %d iterations, tolerance %g, horizon %g s; give "
                       "3 to %d vertices, 1 to %d triangles, at least as many columns, and none negative",
                       def->max_vertices, def->max_triangles, def->column_vertices, def->iterations, def->tolerance,
                       def->horizon_s, TM_PATCH_VERTICES, TM_PATCH_TRIANGLES);
    const bool turns = world->nonlinear != NULL;
    if (def->source && turns && !def->source->turns)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "patch: its source of compliance knows tissue that does not turn, and the world has the stage "
                       "rotation; leave source null");
    tm_pool pool = {0};
    tm_patch_maker *maker = TM_TAKE(&pool, tm_patch_maker, 1);
    tm_columns *columns = def->source ? NULL : tm_columns_create(&pool, world, def->column_vertices, def->tolerance);
    tm_status status =
        !pool.failed ? tm_patch_solver_create(&maker->solver, error) : tm_fail_memory(error, "patch stage");
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    maker->pool = pool;
    maker->def = *def;
    if (def->iterations == 0) maker->def.iterations = 4 + 80000 / world->tissue->mesh->vertex_count;
    maker->contact = contact;
    maker->world = world;
    maker->columns = columns;
    maker->turns = turns;
    if (def->surface) maker->surface = *def->surface;
    if (def->source) maker->source = *def->source;
    maker->revision = tm_tissue_surface(world->tissue).revision;
    const tm_stage stage = {.size = sizeof(tm_stage),
                            .name = "patch",
                            .phase = TM_PHASE_BETWEEN,
                            .destroy = destroy,
                            .self = maker,
                            .needs = {"contact"}};
    status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        maker->source.destroy = NULL; /* it was not taken over */
        destroy(maker);
        return status;
    }
    *made = maker;
    return TM_OK;
}
