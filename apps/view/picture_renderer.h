/* A picture drawn whole: renderer, camera, words. Used by tm-view and tm-play. */
#ifndef VIEW_STUDIO_H
#define VIEW_STUDIO_H

#include "camera.h"
#include "font.h"
#include "picture.h"
#include "render.h"

typedef struct view_studio_def {
    view_render_def render;
    view_camera_def camera;
    float orbit_rad_s; /* the eye walks round */
    bool words;        /* overlay */
    bool display;      /* by the display's OpenGL, not in software */
    double newton_m;   /* length of an arrow of one newton; 0: chosen so that the largest fits */
} view_studio_def;

typedef struct view_studio {
    view_studio_def def;
    const view_render_api *api;
    view_renderer *renderer;
    bool fitted;
    view_surface first; /* what the camera was fitted to */
    view_camera camera;
    view_canvas canvas;
    double peak_force_N, drawn_hz;
    const char *module; /* that draws */
} view_studio;

view_studio_def view_studio_default(int width, int height);
/* Opens the module that draws. */
tm_status view_studio_open(view_studio *studio, const view_studio_def *def, tm_error *error);
void view_studio_close(view_studio *studio);
/* Draws into studio->canvas. The camera is fitted to the first tissue and stays. */
tm_status view_studio_draw(view_studio *studio, view_picture *picture, tm_error *error);
/* Fits the camera anew at the next picture, from def.camera. */
void view_studio_refit(view_studio *studio);
/* Takes def.camera's new angles and zoom, looking at what was fitted first. */
void view_studio_turn(view_studio *studio);

/* --- words and figures on the picture --- */

/* `drawn_hz`: pictures a second, 0 leaves it out. */
void view_overlay(const view_canvas *canvas, const view_picture *picture, const view_camera *camera, double drawn_hz);
/* The notice alone, on an empty dark picture: what is shown before there is any tissue. */
void view_overlay_waiting(const view_canvas *canvas, const view_picture *picture);

#endif
