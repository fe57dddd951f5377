/* Stage "patch": computes for each instrument the surface near it, its compliance and the contact stiffness, from the
 * dynamic model. */
#include "material/material_internal.h"
#include "patch/patch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "contact_law/compliance.h"

tm_patch_def tm_patch_def_default(void) {
    return (tm_patch_def){.cookie = TM_COOKIE_PATCH,
                          .size = sizeof(tm_patch_def),
                          .max_vertices = TM_PATCH_VERTICES,
                          .max_triangles = TM_PATCH_TRIANGLES,
                          .column_vertices = 64,
                          .tolerance = 3e-3,
                          .horizon_s = 0.08};
}

static void observe_motion(tm_patch_builder *builder, int32_t t) {
    const tm_tool *tool = builder->contact->tool + t;
    double now = builder->world->state.time_s, passed = now - builder->time_s[t];
    if (passed > 0 && passed < 0.5)
        for (int c = 0; c < 3; c++) builder->velocity_m_s[t][c] = (tool->pose.tip_m[c] - builder->tip_m[t][c]) / passed;
    else if (passed != 0)
        memset(builder->velocity_m_s[t], 0, sizeof builder->velocity_m_s[t]);
    vset(tool->pose.tip_m, builder->tip_m[t]);
    builder->time_s[t] = now;
}

/* Returns the number of vertices that the instrument's jaws hold; -1 while they release. */
static int32_t held(const tm_patch_builder *builder, int32_t t, tm_patch_grasp *grasp) {
    *grasp = (tm_patch_grasp){.force_N = tm_contact_load(builder->contact, t).force_N};
    grasp->count = tm_contact_grasped(builder->contact, t, &grasp->vertex, &grasp->target_m, &grasp->compliance_m_N);
    return grasp->count;
}

static void describe(const tm_patch_builder *builder, int32_t t, tm_patch *patch) {
    const tm_contact *contact = builder->contact;
    const tm_tool *tool = contact->tool + t;
    patch->kind = tm_patch_known_kind(builder);
    patch->topology_revision = tm_patch_surface_of(builder).revision;
    patch->contact_compliance_m_N = contact->def.contact_compliance_m_N;
    patch->force_cap_N = contact->def.force_cap_N;
    patch->radius_m = tool->def.radius_m;
    patch->contact_length_m = tool->def.contact_length_m;
    patch->age = builder->columns         ? tm_columns_age(builder->columns)
                 : builder->columns_known ? builder->columns_known->age
                                          : 0;
    patch->drag_s_m = contact->others.solve ? 0 : LAW_DRAG_S_M; /* rows of another block have none */
    vset(tool->def.trocar_m, patch->trocar_m);
    patch->is_free = tool->def.is_free;
    vset(tool->pose.direction, patch->direction);
}

/* Radiation of waves: tissue that a tool moves radiates waves, which carry energy away, as from a disc of radius a on a
 * half space. The radius follows from the static stiffness under the tool, k = 4 G a / (1 - nu). The dashpot is the
 * resistance of the area to shear waves, density * c_s * pi a^2; they have left after a / c_s. */
#define RADIATES_WITHIN_M 0.02
#define RADIATES_N_S_M 2.0 /* larger values come from stiff rather than heavy tissue; a controller refuses 10 */

static void radiate(const tm_patch_builder *builder, int32_t t, tm_patch *patch) {
    const tm_tool *tool = builder->contact->tool + t;
    const tm_material *of =
        tm_tissue_tet_material(builder->world->tissue, builder->surface.view ? 0 : patch->face[0] / 4);
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

/* Finds the surface near a tool in contact or near contact, with all compliance known. Not for a tool that has
 * not been outside since it was placed: it has no contact, but would touch the patch. */
static bool find_surface(tm_patch_builder *builder, int32_t t, int32_t max_vertices, double held_N, tm_patch *patch) {
    const tm_tool *tool = builder->contact->tool + t;
    return tm_tool_is_present(tool) && tool->outside && max_vertices >= 3 &&
           tm_patch_find_known(builder, t, max_vertices, held_N, patch);
}

static bool find_stiffness(tm_patch_builder *builder, const tm_patch *patch, tm_tool *tool) {
    return tm_patch_find_stiffness(builder->solver, patch, builder->contact->row, builder->contact->row_count,
                                   tool->pose.tip_m, tool->stiffness_N_m);
}

/* Computes patch and stiffness of a tool with a grasp: springs and contact rows together. */
static bool compute_grasped(tm_patch_builder *builder, int32_t t, const tm_patch_grasp *grasp, tm_patch *patch) {
    const tm_contact *contact = builder->contact;
    tm_tool *tool = builder->contact->tool + t;
    double held_N[3] = {0, 0, 0};
    bool known = grasp->count <= TM_GRASP_VERTICES;
    for (int32_t i = 0; i < grasp->count && known; i++) {
        known = tm_patch_is_known(builder, grasp->vertex[i]);
        vmadd(held_N, 1, grasp->force_N + 3 * i, held_N);
    }
    if (!known) return false;
    const bool whole = find_surface(builder, t, builder->def.max_vertices - 1, vnorm(held_N), patch);
    if (!whole) patch->vertex_count = patch->triangle_count = 0;
    if (!whole && tm_patch_has_outside_load(patch, vnorm(held_N), contact->row, contact->row_count)) return false;
    describe(builder, t, patch);
    if (!tm_patch_fill_grasped(builder->solver, patch, grasp, tool->pose.tip_m, tm_patch_coupled_block, builder,
                               contact->row, contact->row_count))
        return false;
    memcpy(tool->stiffness_N_m, patch->grasp_stiffness_N_m, sizeof tool->stiffness_N_m);
    if (whole && !find_stiffness(builder, patch, tool)) return false;
    tool->stiffness_kind = patch->kind;
    if (whole) radiate(builder, t, patch);
    return whole;
}

static bool compute(tm_patch_builder *builder, int32_t t, tm_patch *patch) {
    const tm_contact *contact = builder->contact;
    tm_tool *tool = builder->contact->tool + t;
    int32_t revision = tm_tissue_surface(builder->world->tissue).revision;
    tool->stiffness_kind = 0;
    memset(patch, 0, sizeof *patch);
    observe_motion(builder, t);
    if (revision != builder->revision && builder->columns) tm_columns_cut(builder->columns);
    builder->revision = revision;
    patch->instrument = t;
    tm_patch_grasp grasp;
    const int32_t count = held(builder, t, &grasp);
    if (builder->behind) builder->behind_count = tm_patch_behind_choose(builder->behind, &builder->behind_vertex);
    if (builder->behind && builder->columns_known) tm_patch_behind_prepare(builder->behind, builder);
    tm_patch_want(builder, t, grasp.vertex, count, patch);
    /* The patch does not contain the force of fading rows, which slip or weaken independently of the tool. */
    if (tm_fading_has(contact->fading, t)) return false;
    if (count > 0) return compute_grasped(builder, t, &grasp, patch);
    if (count < 0 || !find_surface(builder, t, builder->def.max_vertices, 0, patch)) return false;
    describe(builder, t, patch);
    if (!tm_patch_fill(patch, tm_patch_coupled_block, builder, contact->row, contact->row_count) ||
        !find_stiffness(builder, patch, tool))
        return false;
    tool->stiffness_kind = patch->kind;
    radiate(builder, t, patch);
    return true;
}

/* Removes friction after the stiffness is computed: the stiffness is that of the shape under constant friction
 * forces. */
static void remove_friction(const tm_contact *contact, int32_t t, tm_patch *patch) {
    const double(*force_N)[3] =
        tm_contact_friction_forces(contact, t, &patch->friction_static, &patch->friction_kinetic);
    for (int32_t i = 0; i < contact->row_count; i++)
        if (contact->row[i].instrument == t) tm_patch_remove_friction(patch, contact->row + i, force_N[i]);
}

bool tm_patch_compute(tm_patch_builder *builder, int32_t t, tm_patch *patch) {
    TM_REQUIRE(builder && patch && t >= 0 && t < builder->contact->tool_count,
               "builder or patch is null, or instrument is not one of its contact's", false);
    tm_world *world = builder->world;
    tm_world_profile_stage(world, builder);
    const bool made = compute(builder, t, patch);
    if (!made) patch->kind = 0;
    if (made && tm_contact_has_friction(builder->contact, t)) remove_friction(builder->contact, t, patch);
    tm_world_profile_stage(world, NULL);
    return made;
}

int32_t tm_patch_pending(const tm_patch_builder *builder) {
    TM_REQUIRE(builder, "builder is null", 0);
    if (builder->columns) return tm_columns_pending(builder->columns);
    int32_t pending = 0;
    for (int t = 0; t < builder->contact->tool_count; t++) pending += builder->missing[t];
    return pending;
}

tm_status tm_patch_start(tm_patch_builder *builder, tm_error *error) {
    TM_REQUIRE(builder, "builder is null", TM_ERR_ARGUMENT);
    return builder->source.start ? builder->source.start(builder->source.self, error) : TM_OK;
}

static void destroy(void *self) {
    tm_patch_builder *builder = self;
    if (builder->source.destroy) builder->source.destroy(builder->source.self);
    tm_patch_solver_destroy(builder->solver);
    tm_pool pool = builder->pool;
    tm_pool_release(&pool);
}

tm_status tm_stage_patch(tm_world *world, tm_contact *contact, const tm_patch_def *def, tm_patch_builder **made,
                         tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_PATCH, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && made && contact && contact->world == world,
               "world or builder is null, or contact is not of this world", TM_ERR_ARGUMENT);
    if (def->max_vertices < 3 || def->max_vertices > TM_PATCH_VERTICES || def->max_triangles < 1 ||
        def->max_triangles > TM_PATCH_TRIANGLES || def->column_vertices < def->max_vertices || def->iterations < 0 ||
        !(def->tolerance > 0) || !(def->horizon_s >= 0))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "patch has %d vertices, %d triangles, %d columns, %d iterations, tolerance %g, horizon %g s; give 3 "
            "to %d vertices, 1 to %d triangles, at least as many columns as vertices, and nothing negative",
            def->max_vertices, def->max_triangles, def->column_vertices, def->iterations, def->tolerance,
            def->horizon_s, TM_PATCH_VERTICES, TM_PATCH_TRIANGLES);
    const bool turns = world->nonlinear != NULL;
    if (def->source && turns && !def->source->corotated)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "patch: the compliance source is for linear tissue, and this world is corotational or nonlinear; "
            "leave source null");
    tm_pool pool = {0};
    tm_patch_builder *builder = TM_ALLOC(&pool, tm_patch_builder, 1);
    const int32_t kept = contact->tool_count * def->column_vertices;
    tm_columns *columns = def->source ? NULL : tm_columns_create(&pool, world, kept, def->tolerance);
    tm_patch_behind *behind = def->source ? tm_patch_behind_create(&pool, world) : NULL;
    tm_status status =
        !pool.failed ? tm_patch_solver_create(&builder->solver, error) : tm_fail_memory(error, "patch stage");
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    builder->pool = pool;
    builder->def = *def;
    if (def->iterations == 0) builder->def.iterations = 4 + 80000 / world->tissue->mesh->vertex_count;
    builder->contact = contact;
    builder->world = world;
    builder->columns = columns;
    builder->behind = behind;
    builder->corotated = turns;
    if (def->surface) builder->surface = *def->surface;
    if (def->source) builder->source = *def->source;
    builder->revision = tm_tissue_surface(world->tissue).revision;
    const tm_stage stage = {.size = sizeof(tm_stage),
                            .name = "patch",
                            .phase = TM_PHASE_ON_DEMAND,
                            .destroy = destroy,
                            .self = builder,
                            .needs = {"contact"}};
    status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        builder->source.destroy = NULL; /* the caller still owns it */
        destroy(builder);
        return status;
    }
    *made = builder;
    return TM_OK;
}
