/* Converts supports and loads of a scene to arrays, for all models. */
#include "sim.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Returns the index of the vertex's body; the scene has bodies. */
static int32_t body_of(const sim *s, int32_t vertex) {
    const int32_t in_file = tm_mesh_original_vertex(s->mesh, vertex);
    int32_t i = 0;
    while (in_file >= s->body[i].vertex_end) i++;
    return i;
}

/* Refuses a load that rigid bodies alone would bear. */
static tm_status check_load(const sim *s, const app_load *load, const uint8_t *mark) {
    const sim_body *rigid = NULL;
    for (int32_t v = 0; v < s->mesh->vertex_count && s->rigid_tet; v++) {
        if (!mark[v]) continue;
        rigid = s->body + body_of(s, v);
        if (!rigid->rigid) return 0;
    }
    if (!rigid) return 0;
    return app_scene_bad(
        s->scene, load->here.line,
        "this load acts on the body '%s' alone, which is rigid, so that it moves nothing; name another "
        "selector, or remove the load",
        rigid->name);
}

/* Prescribes all components of rigid bodies. */
static tm_status hold_rigid(const sim *s, uint8_t *held) {
    for (int32_t v = 0; v < s->mesh->vertex_count && s->rigid_tet; v++) {
        const int32_t i = body_of(s, v);
        for (int32_t d = 3 * v; d < 3 * v + 3 && s->body[i].rigid; d++) {
            if (held[d])
                return app_scene_bad(s->scene, ((const app_support *)s->scene->support.item)[held[d] - 1].here.line,
                                     "this support holds vertices of the body '%s', which is rigid; make the selector "
                                     "narrower, or give the body a path",
                                     s->body[i].name);
            held[d] = (uint8_t)(SIM_RIGID + i);
        }
    }
    return 0;
}

/* Refuses a support whose position of a component differs from that of an earlier one. */
static tm_status contradict(const sim *s, const app_support *support, int earlier, int32_t dof, double fixed_m) {
    char where[600];
    const app_support *all = s->scene->support.item;
    app_scene_where(s->scene, all[earlier].here.line, where, sizeof where);
    return app_scene_bad(
        s->scene, support->here.line,
        "vertex %d is already fixed at %g m along %c by another support (%s); make the selectors disjoint",
        tm_mesh_original_vertex(s->mesh, dof / 3), fixed_m, "xyz"[dof % 3], where);
}

tm_status sim_build_supports(sim *s) {
    const app_scene *scene = s->scene;
    if (!scene->support.count && !s->rigid_tet) return 0;
    int32_t n = s->mesh->vertex_count, selected;
    uint8_t *mark = malloc((size_t)n);
    uint8_t *held = calloc((size_t)n * 3, 1); /* as fixed_by, per component; one byte, since supports are few */
    double *value = calloc((size_t)n * 3, sizeof *value);
    s->support_of = calloc((size_t)n, 1);
    s->fixed_dof = malloc(sizeof *s->fixed_dof * (size_t)n * 3);
    s->fixed_m = malloc(sizeof *s->fixed_m * (size_t)n * 3);
    s->fixed_by = malloc((size_t)n * 3);
    tm_status rc = mark && held && value && s->support_of && s->fixed_dof && s->fixed_m && s->fixed_by
                       ? 0
                       : app_scene_fail(scene, 0, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    if (scene->support.count > 100)
        rc = app_scene_bad(scene, scene->support.line, "the scene has %d supports; give at most 100",
                           scene->support.count);
    for (int i = 0; i < scene->support.count && !rc; i++) {
        const app_support *support = (const app_support *)scene->support.item + i;
        rc = sim_select(s, &support->select, support->here.line, mark, &selected);
        for (int32_t v = 0; v < n && !rc; v++)
            for (int a = 0; a < 3 && mark[v] && !rc; a++) {
                if (!strchr(support->axes.s, "xyz"[a])) continue;
                int32_t d = 3 * v + a;
                if (held[d] && value[d] != support->displace.v[a])
                    rc = contradict(s, support, held[d] - 1, d, value[d]);
                if (!held[d]) held[d] = (uint8_t)(i + 1);
                value[d] = support->displace.v[a];
                if (!s->support_of[v]) s->support_of[v] = (uint8_t)(i + 1);
            }
    }
    if (!rc) rc = hold_rigid(s, held);
    for (int32_t d = 0; d < 3 * n && !rc; d++)
        if (held[d]) {
            s->fixed_by[s->fixed_count] = held[d];
            s->fixed_dof[s->fixed_count] = d;
            s->fixed_m[s->fixed_count++] = value[d];
        }
    free(value);
    free(held);
    free(mark);
    return rc;
}

/* Lists the surface triangles whose three vertices are marked, in tm_mesh.surface; to free. */
static tm_status list_triangles(const sim *s, int line, const uint8_t *mark, int32_t **list, int32_t *count) {
    const tm_mesh *mesh = s->mesh;
    *list = malloc(sizeof **list * (size_t)mesh->surface_count), *count = 0;
    if (!*list) return app_scene_fail(s->scene, 0, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    for (int32_t t = 0; t < mesh->surface_count; t++) {
        const int32_t *v = &mesh->surface[3 * t];
        if (mark[v[0]] && mark[v[1]] && mark[v[2]]) (*list)[(*count)++] = t;
    }
    return *count ? 0
                  : app_scene_bad(s->scene, line,
                                  "the selector contains no complete surface triangle; widen the selector");
}

static tm_status add_traction(sim *s, const app_load *load, const uint8_t *mark, double *force) {
    int32_t *list, count;
    const tm_status rc = list_triangles(s, load->traction.line, mark, &list, &count);
    for (int32_t i = 0; i < count && !rc; i++)
        tm_load_add_traction(s->mesh, s->mesh->surface + 3 * list[i], 1, load->traction.v, force);
    free(list);
    return rc;
}

static double area_of(const tm_mesh *mesh, const int32_t v[3]) {
    double normal[3], edge[2][3];
    for (int i = 0; i < 6; i++)
        edge[i / 3][i % 3] = mesh->rest_m[3 * v[1 + i / 3] + i % 3] - mesh->rest_m[3 * v[0] + i % 3];
    for (int i = 0; i < 3; i++)
        normal[i] = edge[0][(i + 1) % 3] * edge[1][(i + 2) % 3] - edge[0][(i + 2) % 3] * edge[1][(i + 1) % 3];
    return 0.5 * sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
}

/* Adds a total force: over the area of the marked surface triangles, so that it does not depend on the mesh; of
 * vertices without a triangle, in equal parts. */
static void add_total(const sim *s, const app_load *load, const uint8_t *mark, int32_t selected, double *force) {
    const tm_mesh *mesh = s->mesh;
    const double *total = load->total.v;
    double area = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int32_t t = 0; t < mesh->surface_count; t++) {
            const int32_t *v = &mesh->surface[3 * t];
            if (!mark[v[0]] || !mark[v[1]] || !mark[v[2]]) continue;
            if (pass == 0) area += area_of(mesh, v);
            if (pass == 1)
                tm_load_add_traction(mesh, v, 1, (double[]){total[0] / area, total[1] / area, total[2] / area}, force);
        }
    for (int32_t v = 0; v < mesh->vertex_count && area == 0; v++)
        for (int a = 0; a < 3 && mark[v]; a++) force[3 * v + a] += total[a] / selected;
}

/* Adds a load's pressure to those of the surface triangles [surface_count]. */
static tm_status add_pressure(sim *s, const app_load *load, uint8_t *mark, double *pressure_Pa) {
    int32_t *list = NULL, count = 0, selected;
    tm_status rc = sim_select(s, &load->select, load->here.line, mark, &selected);
    if (!rc) rc = check_load(s, load, mark);
    if (!rc) rc = list_triangles(s, load->pressure.line, mark, &list, &count);
    for (int32_t i = 0; i < count && !rc; i++) pressure_Pa[list[i]] += load->pressure.si;
    free(list);
    return rc;
}

tm_status sim_add_pressures(sim *s) {
    const app_scene *scene = s->scene;
    const int32_t faces = s->mesh->surface_count;
    int line = 0;
    tm_error error = {0};
    uint8_t *mark = malloc((size_t)s->mesh->vertex_count);
    double *pressure_Pa = calloc((size_t)faces, sizeof *pressure_Pa);
    tm_status rc =
        mark && pressure_Pa ? 0 : app_scene_fail(scene, 0, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    for (int i = 0; i < scene->load.count && !rc; i++) {
        const app_load *load = (const app_load *)scene->load.item + i;
        if (!load->pressure.line) continue;
        line = load->pressure.line;
        rc = add_pressure(s, load, mark, pressure_Pa);
    }
    if (!rc && line && tm_stage_pressure(s->model->world, pressure_Pa, &error)) rc = sim_report(scene, line, &error);
    free(pressure_Pa);
    free(mark);
    return rc;
}

tm_status sim_build_loads(sim *s) {
    const app_scene *scene = s->scene;
    if (!scene->load.count) return 0;
    int32_t n = s->mesh->vertex_count, selected;
    uint8_t *mark = malloc((size_t)n);
    double *force = s->load_N = calloc((size_t)n * 3, sizeof *force);
    tm_status rc = mark && force ? 0 : app_scene_fail(scene, 0, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    for (int i = 0; i < scene->load.count && !rc; i++) {
        const app_load *load = (const app_load *)scene->load.item + i;
        rc = sim_select(s, &load->select, load->here.line, mark, &selected);
        if (!rc) rc = check_load(s, load, mark);
        if (!rc && load->traction.line) rc = add_traction(s, load, mark, force);
        if (!rc && load->total.line) add_total(s, load, mark, selected, force);
        for (int32_t v = 0; v < n && !rc && load->force.line; v++)
            for (int a = 0; a < 3 && mark[v]; a++) force[3 * v + a] += load->force.v[a];
    }
    free(mark);
    return rc;
}
