/* Bodies of a scene: loads their meshes and merges them into one mesh, so that world, step, supports and files deal
 * with one tissue. Names of regions and groups get the body's name in front; a body's name alone is the group of all
 * its vertices. */
#include "bodies.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "libtensormass/numeric/elementary.h"

/* Largest distance of a body from the origin, m. */
static const double FAR_M = 1e5;

/* --- one body --- */

tm_status sim_load_mesh_file(const app_scene *scene, const char *key, const app_text *path, double scale,
                             tm_mesh_file *file) {
    tm_error error = {0};
    struct stat info;
    if (access(path->s, R_OK))
        return app_scene_bad(scene, path->line,
                             "%s: %s cannot be read: %s; correct the path (it is relative to the %s)", key, path->s,
                             strerror(errno), path->line < 0 ? "working folder" : "scene's folder");
    if (stat(path->s, &info) || !S_ISREG(info.st_mode))
        return app_scene_bad(scene, path->line, "%s: %s is not a file; name a .msh, .vtk or .mesh file", key, path->s);
    return tm_mesh_file_load(path->s, scale, file, &error) ? sim_report_file(scene, path->line, NULL, 0, &error) : 0;
}

static tm_status no_memory(const app_scene *scene) {
    return app_scene_fail(scene, scene->body.line, TM_ERR_MEMORY, "out of memory; use smaller meshes");
}

/* Turns a rest position about the origin of the body's file, then moves it. */
static void place(const app_body *body, double x[3]) {
    const double *w = body->turn.v, angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    if (angle > 0) { /* Rodrigues */
        const double k[3] = {w[0] / angle, w[1] / angle, w[2] / angle};
        double c, s;
        tm_sine_cosine(angle, &s, &c);
        const double along = k[0] * x[0] + k[1] * x[1] + k[2] * x[2];
        const double across[3] = {k[1] * x[2] - k[2] * x[1], k[2] * x[0] - k[0] * x[2], k[0] * x[1] - k[1] * x[0]};
        for (int a = 0; a < 3; a++) x[a] = c * x[a] + s * across[a] + (1 - c) * along * k[a];
    }
    for (int a = 0; a < 3 && body->move.line; a++) x[a] += body->move.v[a];
}

/* Writes "body.name". Returns false if it is too long. */
static bool qualify(char name[64], const char *body) {
    char old[64];
    memcpy(old, name, sizeof old);
    const int length = *old ? snprintf(name, 64, "%s.%s", body, old) : snprintf(name, 64, "%s", body);
    return length < 64;
}

/* Places the body's vertices. */
static tm_status place_all(const app_scene *scene, const app_body *body, tm_mesh_file *file) {
    for (int32_t v = 0; v < file->vertex_count && (body->move.line || body->turn.line); v++) {
        double *x = file->vertex_m + 3 * v;
        place(body, x);
        if (!(fabs(x[0]) + fabs(x[1]) + fabs(x[2]) <= FAR_M))
            return app_scene_bad(scene, body->move.line ? body->move.line : body->turn.line,
                                 "body '%s' would lie more than %g km away; correct 'move:' or 'turn:'", body->name.s,
                                 1e-3 * FAR_M);
    }
    return 0;
}

/* Loads a body: its mesh in place, with qualified names. */
static tm_status load(const app_scene *scene, const app_body *body, bool checked, tm_mesh_file *file) {
    char key[128];
    snprintf(key, sizeof key, "bodies.%.60s.mesh", body->name.s);
    tm_status rc = sim_load_mesh_file(scene, key, &body->mesh, body->scale.si, file);
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    if (!rc && body->part.line) rc = sim_take_part(scene, body, file);
    if (!rc && checked && tm_mesh_file_build(file, &mesh, &error)) /* errors in this file's numbers */
        rc = sim_report_file(scene, body->mesh.line, NULL, 0, &error);
    if (mesh) tm_mesh_destroy(mesh);
    if (!rc) rc = place_all(scene, body, file);
    bool fits = true;
    for (int32_t r = 0; r < file->region_count && !rc; r++) fits &= qualify(file->region_name[r], body->name.s);
    for (int32_t g = 0; g < file->group_count && !rc; g++) fits &= qualify(file->group_name[g], body->name.s);
    return rc || fits ? rc
                      : app_scene_bad(scene, body->name.line,
                                      "body '%s' and the name of a region or group of its mesh have more than 62 "
                                      "characters together; shorten the body's name",
                                      body->name.s);
}

/* --- all bodies --- */

static void add_groups(tm_mesh_file *to, const tm_mesh_file *from, const char *body, int32_t first) {
    int32_t end = to->group_begin[to->group_count];
    for (int32_t g = 0; g <= from->group_count; g++) {
        const bool all = g == from->group_count; /* the body's own group */
        const int32_t begin = all ? 0 : from->group_begin[g],
                      count = (all ? from->vertex_count : from->group_begin[g + 1]) - begin;
        snprintf(to->group_name[to->group_count], sizeof *to->group_name, "%s", all ? body : from->group_name[g]);
        for (int32_t i = 0; i < count; i++) to->group_vertex[end++] = first + (all ? i : from->group_vertex[begin + i]);
        to->group_begin[++to->group_count] = end;
    }
}

static void add_body(tm_mesh_file *to, const tm_mesh_file *from, sim_body *body) {
    const int32_t v = body->vertex_begin, t = body->tet_begin, r = to->region_count;
    memcpy(to->vertex_m + 3 * v, from->vertex_m, sizeof(double) * 3 * (size_t)from->vertex_count);
    memcpy(to->vertex_tag + v, from->vertex_tag, sizeof(int64_t) * (size_t)from->vertex_count);
    memcpy(to->tet_tag + t, from->tet_tag, sizeof(int64_t) * (size_t)from->tet_count);
    for (int32_t i = 0; i < 4 * from->tet_count; i++) to->tet[4 * t + i] = from->tet[i] + v;
    for (int32_t i = 0; i < from->tet_count; i++) to->region[t + i] = from->region[i] + r;
    memcpy(to->region_name + r, from->region_name, sizeof *to->region_name * (size_t)from->region_count);
    to->region_count += from->region_count;
    to->hash = tm_hash(&from->hash, sizeof from->hash, to->hash);
    to->hash = tm_hash(from->vertex_m, sizeof(double) * 3 * (size_t)from->vertex_count, to->hash);
    add_groups(to, from, body->name, v);
}

/* Merges the files. Without memory, `to` is empty. */
static bool merge(const tm_mesh_file *from, int count, sim_body *body, tm_mesh_file *to) {
    int64_t vertices = 0, tets = 0, members = 0;
    for (int i = 0; i < count; i++) {
        body[i].vertex_begin = (int32_t)vertices, body[i].tet_begin = (int32_t)tets;
        vertices += from[i].vertex_count, tets += from[i].tet_count;
        body[i].vertex_end = (int32_t)vertices, body[i].tet_end = (int32_t)tets;
        to->region_count += from[i].region_count, to->group_count += from[i].group_count + 1;
        members += from[i].group_begin[from[i].group_count] + from[i].vertex_count;
    }
    if (vertices > INT32_MAX / 8 || tets > INT32_MAX / 8 || members > INT32_MAX) return false;
    to->vertex_count = (int32_t)vertices, to->tet_count = (int32_t)tets;
    if (!tm_mesh_file_allocate(to, (int32_t)members)) return false;
    to->region_count = to->group_count = 0; /* counted again while they are added */
    to->hash = TM_HASH_SEED;
    for (int i = 0; i < count; i++) add_body(to, from + i, body + i);
    return true;
}

tm_status sim_load_bodies(sim *s) {
    const app_scene *scene = s->scene;
    const app_body *body = scene->body.item;
    const int count = scene->body.count;
    tm_mesh_file *file = calloc((size_t)count, sizeof *file);
    s->body = calloc((size_t)count, sizeof *s->body);
    tm_status rc = file && s->body ? 0 : no_memory(scene);
    for (int i = 0; i < count && !rc; i++) {
        s->body[i].name = body[i].name.s;
        s->body[i].rigid = body[i].rigid.on;
        s->body_count = i + 1;
        rc = load(scene, body + i, count > 1, file + i);
    }
    if (!rc && !merge(file, count, s->body, &s->file)) rc = no_memory(scene);
    if (!rc && count == 1) { /* messages name its file */
        s->file.path = file->path;
        file->path = NULL;
    }
    for (int i = 0; i < count && file; i++) tm_mesh_file_free(file + i);
    free(file);
    return rc;
}

const sim_body *sim_body_find(const sim *s, const char *name) {
    for (int i = 0; i < s->body_count; i++)
        if (!strcmp(s->body[i].name, name)) return s->body + i;
    return NULL;
}

int32_t *sim_bodies_of_tets(const sim *s) {
    int32_t *of = tm_allocate(sizeof *of * (size_t)s->mesh->tet_count);
    for (int32_t t = 0, i = 0; t < s->mesh->tet_count && of; t++) {
        while (i + 1 < s->body_count && t >= s->body[i].tet_end) i++;
        of[t] = i;
    }
    return of;
}

/* --- rigid bodies: all their vertices are prescribed, so that no other part needs to tell them from tissue --- */

tm_status sim_mark_rigid(sim *s) {
    bool any = false;
    for (int32_t i = 0; i < s->body_count; i++) any |= s->body[i].rigid;
    if (!any) return 0;
    s->rigid_tet = calloc((size_t)s->mesh->tet_count, 1);
    if (!s->rigid_tet) return no_memory(s->scene);
    for (int32_t i = 0; i < s->body_count; i++)
        if (s->body[i].rigid)
            memset(s->rigid_tet + s->body[i].tet_begin, 1, (size_t)(s->body[i].tet_end - s->body[i].tet_begin));
    return 0;
}

typedef struct body_path {
    const app_body_waypoint *way;
    int32_t count;
    double now_m[3];
} body_path;

typedef struct moved {
    int32_t component, body; /* of the stage `support` */
    int32_t axis;
} moved;

typedef struct paths {
    int64_t bytes;
    int32_t count;
    body_path body[SIM_MAX_BODIES];
    moved component[];
} paths;

/* Sets the body's displacement at a time: minimum jerk from its place at time 0 to the first waypoint,
 * and from waypoint to waypoint; still after the last. */
static void follow(body_path *p, double time_s) {
    int32_t k = 0;
    while (k < p->count && p->way[k].time.si <= time_s) k++;
    static const app_body_waypoint start; /* at time 0, not moved */
    const app_body_waypoint *from = k > 0 ? p->way + k - 1 : &start, *to = k < p->count ? p->way + k : from;
    const double length_s = to->time.si - from->time.si;
    const double t = length_s > 0 ? (time_s - from->time.si) / length_s : 1;
    const double share = t * t * t * (10 + t * (6 * t - 15));
    for (int a = 0; a < 3; a++) p->now_m[a] = from->move.v[a] + share * (to->move.v[a] - from->move.v[a]);
}

static void move_bodies(void *self, tm_world *world) {
    paths *p = self;
    const tm_state *state = tm_world_state(world);
    for (int32_t i = 0; i < SIM_MAX_BODIES; i++)
        if (p->body[i].count > 0) follow(p->body + i, state->time_s + state->dt_s);
    for (int32_t i = 0; i < p->count; i++)
        tm_support_move(world, p->component[i].component, p->body[p->component[i].body].now_m[p->component[i].axis]);
}

static void destroy_paths(void *self) { tm_release(self, (size_t)((paths *)self)->bytes); }

tm_status sim_build_paths(sim *s) {
    const app_body *body = s->scene->body.item;
    bool any = false;
    for (int32_t i = 0; i < s->body_count; i++) any |= body[i].path.count > 0;
    if (!any) return 0;
    tm_error error = {0};
    const size_t bytes = sizeof(paths) + sizeof(moved) * (size_t)s->fixed_count;
    paths *p = tm_allocate(bytes);
    if (!p) return no_memory(s->scene);
    *p = (paths){.bytes = (int64_t)bytes};
    for (int32_t i = 0; i < s->body_count; i++) p->body[i] = (body_path){body[i].path.item, body[i].path.count, {0}};
    for (int32_t i = 0; i < s->fixed_count; i++) {
        const int32_t of = s->fixed_by[i] - SIM_RIGID;
        if (of >= 0 && p->body[of].count > 0) p->component[p->count++] = (moved){i, of, s->fixed_dof[i] % 3};
    }
    const tm_stage stage = {.size = sizeof(tm_stage),
                            .name = "bodies",
                            .phase = TM_PHASE_BEGIN,
                            .run = move_bodies,
                            .destroy = destroy_paths,
                            .self = p};
    if (!tm_world_add_stage(s->model->world, &stage, p->bytes, &error)) return 0;
    destroy_paths(p);
    return sim_report(s->scene, s->scene->body.line, &error);
}

/* --- checks before meshes are loaded --- */

static tm_status check_path(const app_scene *scene, const app_body *body) {
    const app_body_waypoint *way = body->path.item;
    if (body->path.line && !body->rigid.on)
        return app_scene_bad(scene, body->path.line,
                             "body '%s' has a path and is not rigid; add 'rigid: yes', or move it by its supports",
                             body->name.s);
    if (body->path.line && scene->model.index != APP_DYNAMIC)
        return app_scene_bad(
            scene, body->path.line,
            "body '%s' has a path, and only the dynamic model moves bodies; write 'model: dynamic', or "
            "remove 'path:'",
            body->name.s);
    if (body->path.count && way->time.si == 0 && (way->move.v[0] || way->move.v[1] || way->move.v[2]))
        return app_scene_bad(scene, way->move.line,
                             "at time 0 body '%s' is at its place, so that it would jump to the first waypoint; write "
                             "'move: [0, 0, 0]' there, or place its mesh by bodies.%s.move",
                             body->name.s, body->name.s);
    for (int i = 1; i < body->path.count; i++)
        if (!(way[i].time.si > way[i - 1].time.si))
            return app_scene_bad(scene, way[i].time.line,
                                 "waypoint %d is not later than the one before; order them by time", i);
    return 0;
}

tm_status sim_check_bodies(const app_scene *scene) {
    const app_body *body = scene->body.item;
    if (!scene->mesh.line == !scene->body.count)
        return scene->mesh.line
                   ? app_scene_bad(scene, scene->body.line,
                                   "a scene has either tissue.mesh or 'bodies:'; remove tissue.mesh, and name its mesh "
                                   "as one of the bodies")
               : scene->body.line
                   ? app_scene_bad(scene, scene->body.line, "'bodies:' names no body; add one with its 'mesh:'")
                   : app_scene_bad(scene, scene->tissue.line,
                                   "tissue: key 'mesh' is missing; add it: mesh file (.msh, .vtk, .mesh), relative to "
                                   "the scene");
    if (scene->body.count && scene->scale.line)
        return app_scene_bad(scene, scene->scale.line,
                             "tissue.scale applies to tissue.mesh only; write bodies.NAME.scale for each body");
    if (scene->body.count > SIM_MAX_BODIES)
        return app_scene_bad(scene, scene->body.line, "%d bodies; give at most %d", scene->body.count, SIM_MAX_BODIES);
    for (int i = 0; i < scene->body.count; i++) {
        const char *name = body[i].name.s;
        if (!*name || strpbrk(name, ". *\"") || strlen(name) > 40 || !strcmp(name, "self"))
            return app_scene_bad(scene, body[i].name.line,
                                 "'%.60s' cannot name a body; give a word of at most 40 characters without dots and "
                                 "spaces, other than self",
                                 name);
        const tm_status rc = check_path(scene, body + i);
        if (rc) return rc;
    }
    return 0;
}
