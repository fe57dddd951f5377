#include "dress.h"

#include "app.h"

int view_dress_check(const view_dress *d, const char *program) {
    if (d->choice.fibres && !d->scene)
        return app_bad_input(program, 0, "--fibres wants the scene that names them; add --scene FILE");
    if (d->through > 0 && !d->scene)
        return app_bad_input(program, 0,
                             "messages tell only the tissue's surface; --through wants its scene too: --scene FILE");
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
    const bool same = d->tinted == s->topology && d->followed == s->version; /* windows draw it more often than told */
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
