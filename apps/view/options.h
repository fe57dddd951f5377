/* Options of tm-view. */
#ifndef VIEW_OPTIONS_H
#define VIEW_OPTIONS_H

#include "picture_renderer.h"
#include "scene_decoration.h"

typedef struct view_options {
    const char *source; /* file; null: live */
    const char *scene;  /* scene for a log or a live source; null: none */
    view_mark_choice marks;
    view_cutaway cut;
    const char *png, *frames, *video, *json, *url, *key;
    view_studio_def studio;
    double from_s, to_s, at_s, duration_s, wait_s, scale;
    bool has_at, has_to;
    int fps, quality;
    bool finished; /* --help or --version was printed */
} view_options;

/* Parses the options. Returns 0, or APP_BAD_INPUT after an error message. */
int view_options_parse(int argc, char **argv, view_options *options);
/* Returns what the scene adds to a log or a running simulation. */
view_dress view_options_dress(const view_options *options);

#endif
