#include "still.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "mesh_file.h"
#include "sim/sim.h"

/* The vertices that the surface uses, renumbered in their order. */
static bool surface_of(const tm_mesh *mesh, view_surface *s) {
    int32_t *number = malloc((size_t)mesh->vertex_count * sizeof *number), count = 0;
    if (!number) return false;
    for (int32_t v = 0; v < mesh->vertex_count; v++) number[v] = -1;
    for (int32_t i = 0; i < 3 * mesh->surface_count; i++) number[mesh->surface[i]] = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        if (number[v] == 0) number[v] = count++;
    bool good = view_surface_reserve(s, count, mesh->surface_count);
    if (good) {
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            if (number[v] < 0) continue;
            s->vertex_id[number[v]] = v;
            for (int k = 0; k < 3; k++) s->vertex_m[3 * number[v] + k] = (float)mesh->rest_m[3 * v + k];
        }
        for (int32_t i = 0; i < 3 * mesh->surface_count; i++) s->triangle[i] = number[mesh->surface[i]];
        memset(s->kind, 0, (size_t)mesh->surface_count);
        s->vertex_count = count, s->triangle_count = mesh->surface_count;
        ++s->version, ++s->topology;
    }
    free(number);
    return good;
}

static int load_mesh(const char *path, double scale, view_picture *picture) {
    tm_error error = {0};
    app_mesh file;
    if (app_mesh_load(path, scale, &file, &error)) return app_report(path, 0, &error);
    tm_mesh *mesh = NULL;
    tm_status status = app_mesh_build(&file, &mesh, &error);
    app_mesh_free(&file);
    if (status) return app_report(path, 0, &error);
    bool good = surface_of(mesh, &picture->surface);
    picture->tets = mesh->tet_count;
    tm_mesh_destroy(mesh);
    return good ? 0 : app_bad_input(path, 0, "no memory for its surface; close other programs") - 1;
}

static int take_marks(const sim *s, const char *path, const view_mark_choice *choice, view_marks *marks) {
    if (choice->fibres && !s->fibre) return app_bad_input(path, 0, "names no fibres (anisotropy); leave --fibres out");
    if (view_marks_take(marks, s, choice->supports, choice->fibres)) return 0;
    return app_bad_input(path, 0, "no memory for its supports and fibres; close other programs") - 1;
}

int view_scene_marks(const char *path, const view_mark_choice *choice, view_marks *marks) {
    app_scene *scene;
    sim *s;
    char dynamic[] = "model=dynamic",
         *set[] = {dynamic}; /* mesh, supports and fibres are any model's; no responses to compute */
    int wrong = sim_scene_load(path, set, 1, &scene);
    if (!wrong) wrong = sim_create(scene, &s);
    if (wrong) return wrong;
    wrong = take_marks(s, path, choice, marks);
    sim_destroy(s);
    return wrong;
}

/* The scene as it stands before its first frame. */
static int load_scene(const char *path, const view_mark_choice *choice, view_picture *picture, view_marks *marks) {
    app_scene *scene;
    sim *s;
    int wrong = sim_scene_load(path, NULL, 0, &scene);
    if (!wrong) wrong = sim_create(scene, &s);
    if (wrong) return wrong;
    if (!surface_of(s->mesh, &picture->surface))
        wrong = app_bad_input(path, 0, "no memory for its surface; close other programs") - 1;
    if (!wrong) wrong = take_marks(s, path, choice, marks);
    for (int i = 0; i < s->instrument_count && i < VIEW_INSTRUMENTS; i++) {
        view_instrument *t = &picture->instrument[i];
        tm_tool_pose pose = sim_pose(s, i, s->start_joint[i], false);
        memcpy(t->tip_m, pose.tip_m, sizeof t->tip_m);
        memcpy(t->trocar_m, s->instrument_def[i].trocar_m, sizeof t->trocar_m);
        t->radius_m = s->instrument_def[i].radius_m, t->roll_rad = pose.roll_rad, t->grip = pose.grip;
        t->mode = (hrt_mode)s->instrument_def[i].mode;
        t->shown = true;
    }
    picture->tets = s->mesh->tet_count;
    sim_destroy(s);
    return wrong;
}

bool view_is_still(const char *path) {
    const char *dot = strrchr(path, '.');
    static const char *const endings[] = {".yaml", ".yml", ".msh", ".vtk", ".mesh"};
    for (size_t i = 0; dot && i < sizeof endings / sizeof endings[0]; i++)
        if (!strcmp(dot, endings[i])) return true;
    return false;
}

bool view_is_scene(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot && (!strcmp(dot, ".yaml") || !strcmp(dot, ".yml"));
}

int view_still_load(const char *path, double scale, const view_mark_choice *choice, view_picture *picture,
                    view_marks *marks) {
    const char *slash = strrchr(path, '/');
    snprintf(picture->title, sizeof picture->title, "%s", slash ? slash + 1 : path);
    return view_is_scene(path) ? load_scene(path, choice, picture, marks) : load_mesh(path, scale, picture);
}
