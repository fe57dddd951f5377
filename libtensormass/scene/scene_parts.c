/* Converts a scene's laws, materials and selectors to the library's arrays. */
#include "scene_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "law_keys.h"

void app_list_names(const char (*name)[64], int32_t count, char list[512]) {
    size_t used = (size_t)snprintf(list, 512, "%s", count ? "" : "none");
    for (int32_t i = 0; i < count && used < 512; i++)
        used += (size_t)snprintf(list + used, 512 - used, "%s%s", i ? ", " : "", name[i]);
}

int32_t app_find_group(const tm_mesh_file *mesh, const char *name) {
    int32_t g = 0;
    while (g < mesh->group_count && strcmp(mesh->group_name[g], name)) g++;
    return g < mesh->group_count ? g : -1;
}

static tm_status select_group(const app_scene *scene, const app_select *select, const tm_mesh_file *mesh,
                              uint8_t *mark) {
    const int32_t g = app_find_group(mesh, select->group.s);
    char names[512];
    if (g < 0) {
        app_list_names((const char(*)[64])mesh->group_name, mesh->group_count, names);
        return app_scene_bad(scene, select->group.line, "the mesh has no group '%s'; it has: %s", select->group.s,
                             names);
    }
    for (int32_t i = mesh->group_begin[g]; i < mesh->group_begin[g + 1]; i++) mark[mesh->group_vertex[i]] = 1;
    return 0;
}

static bool is_selected(const app_select *s, const double x[3]) {
    if (s->box.line) {
        for (int a = 0; a < 3; a++)
            if (x[a] < s->box_min.v[a] || x[a] > s->box_max.v[a]) return false;
        return true;
    }
    const double *n = s->plane_normal.v, *p = s->plane_point.v;
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    double distance = ((x[0] - p[0]) * n[0] + (x[1] - p[1]) * n[1] + (x[2] - p[2]) * n[2]) / length;
    return fabs(distance) <= s->plane_within.si;
}

tm_status app_select_vertices(const app_scene *scene, const app_select *select, int line, const tm_mesh_file *mesh,
                              uint8_t *mark, int32_t *count) {
    memset(mark, 0, (size_t)mesh->vertex_count);
    if (select->group.line) {
        tm_status rc = select_group(scene, select, mesh, mark);
        if (rc) return rc;
    } else if (select->vertex.line) {
        for (int i = 0; i < select->vertex.count; i++) {
            int64_t v = select->vertex.item[i];
            if (v >= mesh->vertex_count)
                return app_scene_bad(scene, select->vertex.line, "vertex %lld does not exist; give 0 to %d",
                                     (long long)v, mesh->vertex_count - 1);
            mark[v] = 1;
        }
    } else
        for (int32_t v = 0; v < mesh->vertex_count; v++) mark[v] = is_selected(select, &mesh->vertex_m[3 * v]);
    *count = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) *count += mark[v];
    if (!*count)
        return app_scene_bad(
            scene,
            select->box.line     ? select->box.line
            : select->plane.line ? select->plane.line
                                 : line,
            "the selector contains no vertex of the mesh; widen it, or compare it with `tm-mesh info %s`",
            scene->mesh.s);
    return 0;
}

static tm_status make_material(const app_material *m, app_law law, tm_material *out, tm_error *error) {
    switch (law) {
    case APP_LAW_YOUNG: return tm_material_young(m->young.si, m->poisson.si, out, error);
    case APP_LAW_LAME: return tm_material_lame(m->lambda.si, m->mu.si, out, error);
    case APP_LAW_PAPER: return tm_material_paper(m->lambda_T.si, m->mu_T.si, m->lambda_L.si, m->mu_L.si, out, error);
    case APP_LAW_FIVE:
        return tm_material_five(m->lambda_T.si, m->mu_T.si, m->lambda_L.si, m->mu_L.si, m->beta.si, out, error);
    case APP_LAW_ENGINEERING:
        return tm_material_engineering(m->E_L.si, m->E_T.si, m->nu_LT.si, m->nu_TT.si, m->G_L.si, out, error);
    }
    return TM_ERR_MATERIAL;
}

static tm_status set_law(const app_material *m, tm_material *out, tm_error *error) {
    const tm_law_kind law = (tm_law_kind)m->law.index;
    double constant[TM_LAW_CONSTANTS] = {0};
    for (int32_t i = 0; tm_law_constant_at(law, i); i++) constant[i] = app_material_constant(m, law, i)->si;
    return tm_material_set_law(out, law, constant, m->stretch.line ? m->stretch.si : 0, error);
}

/* Returns whether a material's name stands for the region: its own name (2), or "body.*" of its body (1). */
static int names_region(const char *name, const char *region) {
    const size_t length = strlen(name);
    if (!strcmp(name, region)) return 2;
    if (length < 2 || strcmp(name + length - 2, ".*")) return 0;
    return !strncmp(name, region, length - 2) && (region[length - 2] == '.' || !region[length - 2]);
}

/* Returns the material of a region: of its own name first, then of its body, then "*"; null: none. */
static const app_material *find_material(const app_scene *scene, const char *region) {
    const app_material *all = scene->material.item, *m = NULL;
    int best = -1;
    for (int i = 0; i < scene->material.count; i++) {
        const int fit = names_region(all[i].region.s, region);
        if ((fit || !strcmp(all[i].region.s, "*")) && fit > best) best = fit, m = &all[i];
    }
    return m;
}

static bool is_rigid(const app_scene *scene, const char *region) {
    const app_body *body = scene->body.item;
    for (int i = 0; i < scene->body.count; i++) {
        const size_t length = strlen(body[i].name.s);
        if (body[i].rigid.on && !strncmp(region, body[i].name.s, length) && (region[length] == '.' || !region[length]))
            return true;
    }
    return false;
}

/* Sets the constants of a rigid body: its vertices are prescribed, so that they bear on nothing; so soft that they do
 * not limit the step. */
static tm_status rigid_material(const app_scene *scene, tm_material *out, tm_error *error) {
    const app_material *all = scene->material.item;
    const double none[TM_LAW_CONSTANTS] = {0};
    bool nonlinear = false;
    for (int i = 0; i < scene->material.count; i++) nonlinear |= all[i].law.index != TM_LAW_LINEAR;
    tm_status rc = tm_material_young(1, 0.3, out, error);
    if (!rc && nonlinear) rc = tm_material_set_law(out, TM_LAW_NEO_HOOKE, none, 0, error);
    out->density_kg_m3 = 1000;
    return rc;
}

tm_status app_scene_materials(const app_scene *scene, const tm_mesh_file *mesh, double default_damping_1_s,
                              tm_material *out) {
    const app_material *all = scene->material.item;
    for (int i = 0; i < scene->material.count; i++) {
        bool found = !strcmp(all[i].region.s, "*");
        for (int32_t r = 0; r < mesh->region_count && !found; r++)
            found = names_region(all[i].region.s, mesh->region_name[r]);
        if (found) continue;
        char names[512];
        app_list_names((const char(*)[64])mesh->region_name, mesh->region_count, names);
        return app_scene_bad(scene, all[i].region.line,
                             "the mesh has no region '%s'; it has: %s (or write \"*\" for all)", all[i].region.s,
                             names);
    }
    for (int32_t r = 0; r < mesh->region_count; r++) {
        const app_material *m = find_material(scene, mesh->region_name[r]);
        tm_error error = {0};
        if (is_rigid(scene, mesh->region_name[r])) {
            if (rigid_material(scene, &out[r], &error))
                return app_scene_bad(scene, scene->body.line, "rigid body: %s", error.message);
            continue;
        }
        if (!m)
            return app_scene_bad(
                scene, scene->material.line,
                "region '%s' of the mesh has no material; add it to tissue.materials, or \"*\" for all",
                mesh->region_name[r]);
        app_law law;
        tm_status rc = app_scene_law(scene, m, &law);
        if (rc) return rc;
        if (make_material(m, law, &out[r], &error))
            return app_scene_bad(scene, m->region.line, "material '%s': %s", m->region.s, error.message);
        if (set_law(m, &out[r], &error))
            return app_scene_bad(scene, m->law.line, "material '%s': %s", m->region.s, error.message);
        out[r].density_kg_m3 = m->density.si;
        out[r].damping_1_s = m->damping.line ? m->damping.si : default_damping_1_s;
    }
    return 0;
}
