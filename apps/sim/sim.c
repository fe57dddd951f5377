/* From a scene to a world that can be stepped, and one frame of it. */
#include "sim.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int sim_report(const app_scene *scene, int line, const tm_error *error) {
    if (line < 0) return app_scene_bad(scene, line, "%s", error->message);
    return app_report(scene->file, line, error);
}

/* --- effects by name --- */

const sim_effect *sim_effect_find(const char *name, int *index) {
    for (int i = 0; i < sim_effect_count; ++i)
        if (!strcmp(sim_effects[i]->name, name)) {
            if (index) *index = i;
            return sim_effects[i];
        }
    return NULL;
}

int sim_effect_line(const app_scene *scene, int index) { return ((const app_section *)scene->effect[index])->line; }

const void *sim_options(const app_scene *scene, const char *effect) {
    int i;
    return sim_effect_find(effect, &i) && sim_effect_line(scene, i) ? scene->effect[i] : NULL;
}

bool sim_has(const sim *s, const char *effect) { return sim_options(s->scene, effect) != NULL; }

/* --- the scene as a whole --- */

int sim_scene_load(const char *file, char *const *set, int set_count, app_scene **scene) {
    app_schema schema[SIM_MAX_EFFECTS];
    for (int i = 0; i < sim_effect_count; ++i) schema[i] = sim_effects[i]->schema;
    return app_scene_load(file, set, set_count, schema, sim_effect_count, scene);
}

static int check_effect(const app_scene *scene, int index) {
    const sim_effect *e = sim_effects[index];
    int line = sim_effect_line(scene, index), other;
    char where[600];
    for (int i = 0; i < 4 && e->needs[i]; ++i) {
        if (!strcmp(e->needs[i], "instruments") ? scene->instrument.count > 0 : sim_options(scene, e->needs[i]) != NULL) continue;
        return app_scene_bad(scene, line, "%s needs %s, which the scene does not name; add '%s:' or remove '%s:'", e->name, e->needs[i], e->needs[i], e->name);
    }
    for (int i = 0; i < 4 && e->excludes[i].other; ++i) {
        if (!sim_effect_find(e->excludes[i].other, &other) || !sim_effect_line(scene, other)) continue;
        app_scene_where(scene, sim_effect_line(scene, other), where, sizeof where);
        return app_scene_bad(scene, line, "%s and %s (%s) exclude each other: %s", e->name, e->excludes[i].other, where, e->excludes[i].why);
    }
    return e->check ? e->check(scene, scene->effect[index]) : 0;
}

static int check_scene(const app_scene *scene) {
    int rc = app_scene_check(scene);
    for (int i = 0; i < sim_effect_count && !rc; ++i)
        if (sim_effect_line(scene, i)) rc = check_effect(scene, i);
    for (int i = 0; i < scene->material.count && !rc; ++i) {
        const app_material *m = (const app_material *)scene->material.item + i;
        app_law law;
        rc = app_scene_law(scene, m, &law);
        if (!rc && app_law_fibred(law) && !sim_options(scene, "anisotropy"))
            rc = app_scene_bad(scene, m->region.line, "material '%s' is fibred, but the scene names no fibres; add 'anisotropy:' with a file or a rule, or give isotropic constants", m->region.s);
        if (!rc && m->damping.line && !sim_options(scene, "damping"))
            rc = app_scene_bad(scene, m->damping.line, "material '%s' has a damping rate, but the scene does not name the effect; add 'damping:' or remove the rate", m->region.s);
    }
    for (int i = 0; i < scene->instrument.count && !rc; ++i) {
        const app_instrument *t = (const app_instrument *)scene->instrument.item + i;
        const char *needed = t->mode.index == TM_TOOL_GRASPER ? "grasp" : t->mode.index == TM_TOOL_CAUTERY ? "cut" : NULL;
        if (needed && !sim_options(scene, needed))
            rc = app_scene_bad(scene, t->mode.line, "instrument %d is a %s, but the scene does not name the effect '%s'; add '%s:' or use the mode probe", i, t->mode.index == TM_TOOL_GRASPER ? "grasper" : "cautery", needed, needed);
    }
    return rc;
}

/* --- supports and loads --- */

static int make_supports(sim *s) {
    const app_scene *scene = s->scene;
    if (!scene->support.count) return 0;
    int32_t n = s->mesh->vertex_count, selected;
    uint8_t *mark = malloc((size_t)n);
    int8_t *held = calloc((size_t)n * 3, 1); /* 1 + support, of each component: supports are few */
    double *value = calloc((size_t)n * 3, sizeof *value);
    s->support_of = calloc((size_t)n, 1);
    tm_support_def def = tm_support_def_default();
    int32_t *dof = malloc(sizeof *dof * (size_t)n * 3);
    double *packed = malloc(sizeof *packed * (size_t)n * 3);
    int rc = mark && held && value && s->support_of && dof && packed ? 0 : app_scene_bad(scene, 0, "out of memory; use a smaller mesh");
    if (scene->support.count > 100) rc = app_scene_bad(scene, scene->support.line, "%d supports; give at most 100", scene->support.count);
    for (int i = 0; i < scene->support.count && !rc; ++i) {
        const app_support *support = (const app_support *)scene->support.item + i;
        rc = app_select_vertices(scene, &support->select, support->here.line, &s->file, mark, &selected);
        for (int32_t v = 0; v < n && !rc; ++v)
            for (int a = 0; a < 3 && mark[v] && !rc; ++a) {
                if (!strchr(support->axes.s, "xyz"[a])) continue;
                int32_t d = 3 * v + a;
                if (held[d] && value[d] != support->displace.v[a])
                    rc = app_scene_bad(scene, support->here.line, "vertex %d is already held at %g m along %c by the support on line %d; make the selectors disjoint",
                                       v, value[d], "xyz"[a], ((const app_support *)scene->support.item)[held[d] - 1].here.line);
                if (!held[d]) held[d] = (int8_t)(i + 1);
                value[d] = support->displace.v[a];
                if (!s->support_of[v]) s->support_of[v] = (uint8_t)(i + 1);
            }
    }
    for (int32_t d = 0; d < 3 * n && !rc; ++d)
        if (held[d]) {
            dof[def.count] = d;
            packed[def.count++] = value[d];
        }
    def.dof = dof;
    def.value_m = packed;
    tm_error error = {0};
    if (!rc && tm_stage_support(s->world, &def, &error)) rc = sim_report(scene, scene->support.line, &error);
    free(packed);
    free(dof);
    free(value);
    free(held);
    free(mark);
    return rc;
}

static int add_traction(sim *s, const app_load *load, const uint8_t *mark, double *force) {
    const tm_mesh *mesh = s->mesh;
    int32_t *triangle = malloc(sizeof *triangle * 3 * (size_t)mesh->surface_count), count = 0;
    if (!triangle) return app_scene_bad(s->scene, 0, "out of memory; use a smaller mesh");
    for (int32_t t = 0; t < mesh->surface_count; ++t) {
        const int32_t *v = &mesh->surface[3 * t];
        if (mark[v[0]] && mark[v[1]] && mark[v[2]]) memcpy(&triangle[3 * count++], v, 3 * sizeof *v);
    }
    int rc = count ? 0 : app_scene_bad(s->scene, load->traction.line, "no surface triangle has its three vertices selected; widen the selector");
    if (!rc) tm_load_add_traction(mesh, triangle, count, load->traction.v, force);
    free(triangle);
    return rc;
}

static int make_loads(sim *s) {
    const app_scene *scene = s->scene;
    if (!scene->load.count) return 0;
    int32_t n = s->mesh->vertex_count, selected;
    uint8_t *mark = malloc((size_t)n);
    double *force = calloc((size_t)n * 3, sizeof *force);
    int rc = mark && force ? 0 : app_scene_bad(scene, 0, "out of memory; use a smaller mesh");
    for (int i = 0; i < scene->load.count && !rc; ++i) {
        const app_load *load = (const app_load *)scene->load.item + i;
        rc = app_select_vertices(scene, &load->select, load->here.line, &s->file, mark, &selected);
        if (!rc && load->traction.line) rc = add_traction(s, load, mark, force);
        for (int32_t v = 0; v < n && !rc && load->force.line; ++v)
            for (int a = 0; a < 3 && mark[v]; ++a) force[3 * v + a] += load->force.v[a];
    }
    tm_error error = {0};
    if (!rc && tm_stage_load(s->world, force, &error)) rc = sim_report(scene, scene->load.line, &error);
    free(force);
    free(mark);
    return rc;
}

/* --- instruments --- */

static void normalise(double v[3]) {
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int a = 0; a < 3; ++a) v[a] /= length;
}

static void make_axes(const app_instrument *t, double axes[9]) {
    double z[3], x[3], y[3];
    memcpy(z, t->axis.v, sizeof z);
    normalise(z);
    const double *u = t->up.v;
    x[0] = u[1] * z[2] - u[2] * z[1];
    x[1] = u[2] * z[0] - u[0] * z[2];
    x[2] = u[0] * z[1] - u[1] * z[0];
    normalise(x);
    y[0] = z[1] * x[2] - z[2] * x[1];
    y[1] = z[2] * x[0] - z[0] * x[2];
    y[2] = z[0] * x[1] - z[1] * x[0];
    for (int a = 0; a < 3; ++a) {
        axes[3 * a] = x[a];
        axes[3 * a + 1] = y[a];
        axes[3 * a + 2] = z[a];
    }
}

tm_tool_pose sim_pose(const sim *s, int instrument, const double joint[SIM_JOINTS], bool active) {
    const double *r = s->axes[instrument];
    double d[3] = {sin(joint[1]), sin(joint[0]) * cos(joint[1]), cos(joint[0]) * cos(joint[1])};
    tm_tool_pose pose = {.roll_rad = joint[3], .grip = joint[4], .active = active};
    for (int a = 0; a < 3; ++a)
        pose.tip_m[a] = s->instrument_def[instrument].trocar_m[a] + joint[2] * (r[3 * a] * d[0] + r[3 * a + 1] * d[1] + r[3 * a + 2] * d[2]);
    return pose;
}

bool sim_joints(const sim *s, int instrument, const double tip_m[3], double joint[SIM_JOINTS]) {
    const double *r = s->axes[instrument];
    double world[3], d[3] = {0, 0, 0};
    for (int a = 0; a < 3; ++a) world[a] = tip_m[a] - s->instrument_def[instrument].trocar_m[a];
    for (int a = 0; a < 3; ++a)
        for (int c = 0; c < 3; ++c) d[c] += r[3 * a + c] * world[a];
    double insertion = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    if (!(insertion > 1e-9)) return false;
    joint[0] = atan2(d[1], d[2]);
    joint[1] = asin(d[0] / insertion);
    joint[2] = insertion;
    return true;
}

void sim_scene_joints(const sim *s, int instrument, const app_pose *pose, double joint[SIM_JOINTS]) {
    joint[0] = pose->pitch.si;
    joint[1] = pose->yaw.si;
    joint[2] = pose->insertion.si;
    joint[3] = pose->roll.si;
    joint[4] = pose->grip.si;
    if (pose->tip.line) sim_joints(s, instrument, pose->tip.v, joint);
}

const app_hand *sim_hand(const sim *s, int instrument) {
    for (int i = 0; i < s->scene->hand.count; ++i) {
        const app_hand *h = (const app_hand *)s->scene->hand.item + i;
        if (h->instrument.value == instrument) return h;
    }
    return NULL;
}

static void make_instruments(sim *s) {
    s->instrument_count = s->scene->instrument.count;
    for (int i = 0; i < s->instrument_count; ++i) {
        const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
        tm_instrument_def *def = &s->instrument_def[i];
        def->mode = (tm_tool_mode)t->mode.index;
        memcpy(def->trocar_m, t->trocar.v, sizeof def->trocar_m);
        def->radius_m = t->radius.si;
        def->contact_length_m = t->contact_length.si;
        make_axes(t, s->axes[i]);
        const app_hand *hand = sim_hand(s, i);
        const app_pose *start = t->start_here.line || !hand ? &t->start : &((const app_waypoint *)hand->path.item)->pose;
        sim_scene_joints(s, i, start, s->start_joint[i]);
        /* A probe is in the body from the start; a cautery burns only when told. */
        s->pose[i] = def->pose = sim_pose(s, i, s->start_joint[i], def->mode == TM_TOOL_PROBE);
    }
}

/* --- building --- */

void sim_add_bytes(sim *s, int64_t bytes) { s->declared_bytes += bytes; }

static int load_mesh(sim *s) {
    tm_error error = {0};
    const app_scene *scene = s->scene;
    if (access(scene->mesh.s, R_OK))
        return app_scene_bad(scene, scene->mesh.line, "tissue.mesh: %s cannot be read: %s; correct the path (it is relative to the scene's folder)", scene->mesh.s, strerror(errno));
    if (app_mesh_load(scene->mesh.s, scene->scale.si, &s->file, &error) || app_mesh_build(&s->file, &s->mesh, &error))
        return app_report(scene->mesh.s, 0, &error);
    return 0;
}

/* Books the stages that have come since the last call on `effect`. */
static void own_stages(sim *s, int effect) {
    tm_stage_report report[TM_MAX_STAGES];
    int count = tm_world_stages(s->world, report);
    for (int i = 0; i < count; ++i) {
        bool known = false;
        for (int j = 0; j < s->owner_count; ++j) known |= !strcmp(s->owner[j].stage, report[i].name);
        if (!known) s->owner[s->owner_count++] = (sim_owner){report[i].name, effect};
    }
}

/* Runs one hook of every named effect and books memory and stages. */
static int run_hook(sim *s, bool build) {
    int rc = 0;
    for (int i = 0; i < sim_effect_count && !rc; ++i) {
        int (*hook)(sim *, const void *) = build ? sim_effects[i]->build : sim_effects[i]->prepare;
        if (!sim_effect_line(s->scene, i) || !hook) continue;
        int64_t before = tm_memory_in_use() + s->declared_bytes;
        rc = hook(s, s->scene->effect[i]);
        s->cost[i].bytes += tm_memory_in_use() + s->declared_bytes - before;
        if (build && !rc) own_stages(s, i);
    }
    return rc;
}

static int make_tissue(sim *s) {
    tm_error error = {0};
    s->material = calloc((size_t)s->mesh->region_count, sizeof *s->material);
    if (!s->material) return app_scene_bad(s->scene, 0, "out of memory; use a smaller mesh");
    s->tissue_def = tm_tissue_def_default();
    s->world_def = tm_world_def_default();
    int rc = run_hook(s, false);
    if (!rc) rc = app_scene_materials(s->scene, &s->file, s->damping_1_s, s->material);
    if (rc) return rc;
    s->tissue_def.mesh = s->mesh;
    s->tissue_def.material_count = s->mesh->region_count;
    s->tissue_def.material = s->material;
    s->tissue_def.fibre = s->fibre;
    s->tissue_def.precision = (tm_precision)s->scene->precision.index;
    s->tissue_def.form = (tm_force_form)s->scene->force.index;
    if (tm_tissue_create(&s->tissue_def, &s->tissue, &error)) return sim_report(s->scene, s->scene->tissue.line, &error);
    return 0;
}

/* A whole number of equal substeps a frame, none above what the scene or the guaranteed bound allows. */
static int choose_step(sim *s) {
    const app_scene *scene = s->scene;
    double largest = s->critical_s * scene->step_fraction.si;
    if (scene->step.line) {
        largest = scene->step.si;
        if (largest > s->critical_s)
            return app_scene_bad(scene, scene->step.line, "time.step = %.4g s is above the guaranteed critical step %.4g s, set by tetrahedron %lld of the mesh file; lower it or leave it out", largest, s->critical_s, (long long)s->file.tet_tag[s->critical_tet]);
    }
    s->frame_s = 1 / scene->frame_rate.si;
    double count = ceil(s->frame_s / largest - 1e-9);
    if (!(count < 1e8)) return app_scene_bad(scene, scene->step.line, "a frame would take %.3g substeps; repair tetrahedron %lld, whose critical step is %.3g s", count, (long long)s->file.tet_tag[s->critical_tet], s->critical_s);
    s->substeps = count < 1 ? 1 : (int32_t)count;
    s->dt_s = s->frame_s / s->substeps;
    s->average = (int32_t)(scene->average.si * s->substeps + 0.5);
    if (s->average < 1) s->average = 1;
    return 0;
}

static int make_world(sim *s) {
    tm_error error = {0};
    s->critical_s = tm_critical_step_guaranteed(s->tissue, &s->critical_tet);
    int rc = choose_step(s);
    if (rc) return rc;
    s->world_def.tissue = s->tissue;
    s->world_def.dt_s = s->dt_s;
    if (tm_world_create(&s->world_def, &s->world, &error)) return sim_report(s->scene, s->scene->step.line, &error);
    own_stages(s, SIM_OWNER_ALL);
    rc = make_supports(s);
    if (!rc) own_stages(s, SIM_OWNER_SUPPORTS);
    if (!rc) rc = make_loads(s);
    if (!rc) own_stages(s, SIM_OWNER_LOADS);
    return rc;
}

int sim_create(app_scene *scene, sim **out) {
    sim *s = calloc(1, sizeof *s);
    if (!s) abort();
    s->scene = scene;
    int rc = check_scene(scene);
    if (!rc) rc = load_mesh(s);
    if (!rc) rc = make_tissue(s);
    if (!rc) make_instruments(s);
    if (!rc) rc = make_world(s);
    if (!rc) rc = run_hook(s, true);
    if (rc) sim_destroy(s);
    else *out = s;
    return rc;
}

void sim_destroy(sim *s) {
    if (!s) return;
    for (int i = 0; i < sim_effect_count; ++i)
        if (s->own[i] && sim_effects[i]->destroy) sim_effects[i]->destroy(s->own[i]);
    if (s->world) tm_world_destroy(s->world);
    if (s->tissue) tm_tissue_destroy(s->tissue);
    if (s->mesh) tm_mesh_destroy(s->mesh);
    app_mesh_free(&s->file);
    free(s->support_of);
    free(s->fibre);
    free(s->material);
    app_scene_free(s->scene);
    free(s);
}

/* --- one frame --- */

tm_status sim_frame(sim *s, const tm_tool_pose *to, int32_t substeps) {
    if (s->contact) {
        tm_contact_begin_frame(s->contact, substeps, s->average < substeps ? s->average : substeps);
        for (int i = 0; i < s->instrument_count; ++i) tm_contact_move(s->contact, i, &to[i], substeps);
    }
    tm_status status = tm_world_step(s->world, substeps);
    for (int i = 0; i < s->instrument_count; ++i) {
        s->pose[i] = to[i];
        if (s->contact) s->reaction[i] = tm_contact_reaction(s->contact, i);
    }
    for (int i = 0; i < sim_effect_count; ++i)
        if (sim_effects[i]->frame && sim_effect_line(s->scene, i)) sim_effects[i]->frame(s, s->own[i]);
    ++s->frames;
    return status;
}

tm_surface_view sim_surface(const sim *s) { return tm_tissue_surface(s->tissue); }
const double *sim_displacement(const sim *s) { return tm_world_state(s->world)->u_m; }
double sim_time_s(const sim *s) { return tm_world_state(s->world)->time_s; }
uint64_t sim_hash(const sim *s) { return tm_world_hash(s->world); }
