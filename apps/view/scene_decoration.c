#include "scene_decoration.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "common/program_host.h"
#include "scene/sim.h"
#include "tensormass_io.h"

/* Creates the scene's simulation with the file's numbering, which messages and so marks and regions use. It is never
 * stepped. */
static int create_as_in_file(app_scene *scene, sim **s) {
    scene->renumber.on = false;
    return app_exit_code(sim_create(scene, s));
}

/* Fills the visible mesh surface. Returns 0, or an exit code after an error message. */
static int show(const char *path, const tm_mesh_file *file, const tm_mesh *mesh, const uint8_t *rigid_tet,
                const view_cutaway *cut, view_picture *picture) {
    view_regions_name(file, mesh, rigid_tet, picture);
    if (!view_regions_surface(mesh, cut, picture))
        return app_bad_input(path, 0, "no memory for its surface; close other programs") - 1;
    picture->tets = mesh->tet_count;
    if (!picture->surface.triangle_count)
        return app_bad_input(path, 0, "--clip hides all of it; move the plane by its offset, or reverse it");
    return 0;
}

static int load_mesh(const char *path, double scale, const view_cutaway *cut, view_picture *picture) {
    tm_error error = {0};
    tm_mesh_file file;
    if (tm_mesh_file_load(path, scale, &file, &error)) return app_report(NULL, 0, &error);
    tm_mesh *mesh = NULL;
    int wrong = tm_mesh_file_build(&file, &mesh, &error) ? app_report(NULL, 0, &error) : 0;
    if (!wrong) wrong = show(path, &file, mesh, NULL, cut, picture);
    tm_mesh_file_free(&file);
    tm_mesh_destroy(mesh);
    return wrong;
}

static int read_marks(const sim *s, const char *path, const view_mark_choice *choice, view_marks *marks) {
    if (choice->fibres && !s->fibre)
        return app_bad_input(path, 0, "the scene has no fibres (anisotropy); leave --fibres out");
    if (view_marks_take(marks, s, choice->supports, choice->fibres)) return 0;
    return app_bad_input(path, 0, "no memory for its supports and fibres; close other programs") - 1;
}

/* Reads only marks and the regions' names and colours, for a source without them; also `inside` if requested. */
static int view_scene_marks(const char *path, const view_mark_choice *choice, view_picture *picture, view_marks *marks,
                            view_inside *inside) {
    app_scene *scene;
    sim *s;
    char dynamic[] = "model=dynamic"; /* any model has the same mesh, supports, fibres */
    char *set[] = {dynamic};
    int wrong = app_exit_code(sim_scene_load(path, set, 1, app_program_host(), &scene));
    if (!wrong) wrong = create_as_in_file(scene, &s);
    if (wrong) return wrong;
    wrong = read_marks(s, path, choice, marks);
    view_regions_name(&s->file, s->mesh, s->rigid_tet, picture);
    if (!wrong && inside && !view_inside_take(inside, s->mesh))
        wrong = app_bad_input(path, 0, "no memory for its regions; leave --through out") - 1;
    sim_destroy(s);
    return wrong;
}

/* Loads the scene in its state before the first frame. */
static int load_scene(const char *path, const view_mark_choice *choice, const view_cutaway *cut, view_picture *picture,
                      view_marks *marks) {
    app_scene *scene;
    sim *s;
    int wrong = app_exit_code(sim_scene_load(path, NULL, 0, app_program_host(), &scene));
    if (!wrong) wrong = create_as_in_file(scene, &s);
    if (wrong) return wrong;
    wrong = show(path, &s->file, s->mesh, s->rigid_tet, cut, picture);
    if (!wrong) wrong = read_marks(s, path, choice, marks);
    const tm_ties *ties = s->model->world ? tm_world_ties(s->model->world) : NULL;
    if (!wrong && ties && !view_regions_ties(s->mesh, ties, cut, picture))
        wrong = app_bad_input(path, 0, "no memory for its ties; close other programs") - 1;
    for (int i = 0; i < s->instrument_count && i < VIEW_INSTRUMENTS; i++) {
        view_instrument *t = &picture->instrument[i];
        tm_tool_pose pose = sim_pose(s, i, s->start_joint[i], false);
        memcpy(t->tip_m, pose.tip_m, sizeof t->tip_m);
        memcpy(t->trocar_m, s->instrument_def[i].trocar_m, sizeof t->trocar_m);
        memcpy(t->direction, pose.direction, sizeof t->direction);
        t->is_free = s->instrument_def[i].is_free;
        t->radius_m = s->instrument_def[i].radius_m, t->roll_rad = pose.roll_rad, t->grip = pose.grip;
        t->mode = (hrt_mode)s->instrument_def[i].mode;
        t->shown = true;
    }
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

int view_still_load(const char *path, double scale, const view_mark_choice *choice, const view_cutaway *cut,
                    view_picture *picture, view_marks *marks) {
    const char *slash = strrchr(path, '/');
    snprintf(picture->title, sizeof picture->title, "%s", slash ? slash + 1 : path);
    return view_is_scene(path) ? load_scene(path, choice, cut, picture, marks) : load_mesh(path, scale, cut, picture);
}

int view_dress_check(const view_dress *d, const char *program) {
    if (d->choice.fibres && !d->scene)
        return app_bad_input(program, 0, "--fibres needs the scene that names them; add --scene FILE");
    if (d->through > 0 && !d->scene)
        return app_bad_input(program, 0,
                             "--through needs the scene, as messages contain only the surface; add --scene FILE");
    return 0;
}

int view_dress_load(view_dress *d, view_picture *picture) {
    if (!d->scene) return 0;
    return view_scene_marks(d->scene, &d->choice, picture, &d->marks, d->through > 0 ? &d->inside : NULL);
}

int view_dress_show(view_dress *d, view_picture *picture, view_picture *shown) {
    const view_surface *s = &picture->surface;
    picture->marks = &d->marks;
    if (d->tinted != s->topology) view_marks_tint(&d->marks, &picture->surface);
    const bool same = d->tinted == s->topology && d->followed == s->version; /* windows draw more often */
    d->tinted = s->topology, d->followed = s->version;
    *shown = *picture;
    if (!d->inside.face_count || !s->vertex_count) return 0;
    if (!same && !view_inside_show(&d->inside, picture))
        return app_bad_input(d->scene, 0, "no memory for the regions inside; leave --through out") - 1;
    shown->surface = d->inside.shown;
    shown->through = (float)d->through;
    return 0;
}

void view_dress_restart(view_dress *d) { d->tinted = d->followed = d->inside.topology = 0; }

void view_dress_free(view_dress *d) {
    view_marks_free(&d->marks);
    view_inside_free(&d->inside);
}
