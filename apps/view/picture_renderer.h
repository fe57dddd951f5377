/* Renders complete pictures with renderer, camera and text. Used by tm-view and tm-play. */
#ifndef VIEW_STUDIO_H
#define VIEW_STUDIO_H

#include "camera.h"
#include "font.h"
#include "picture.h"
#include "render.h"

typedef struct view_studio_def {
    view_render_def render;
    view_camera_def camera;
    float orbit_rad_s; /* rate at which the eye orbits */
    bool words;        /* text overlay */
    bool display;      /* draw by the display's OpenGL, not in software */
    double newton_m;   /* length of an arrow of one newton; 0: chosen so that the largest arrow fits */
} view_studio_def;

typedef struct view_studio {
    view_studio_def def;
    const view_render_api *api;
    view_renderer *renderer;
    bool fitted;
    view_surface first; /* surface that the camera was fitted to */
    view_camera camera;
    view_canvas canvas;
    double peak_force_N, drawn_hz;
    const char *module; /* name of the renderer module */
} view_studio;

view_studio_def view_studio_default(int width, int height);
/* Opens the renderer module. */
tm_status view_studio_open(view_studio *studio, const view_studio_def *def, tm_error *error);
void view_studio_close(view_studio *studio);
/* Draws into studio->canvas. The camera is fitted to the first tissue and then stays. */
tm_status view_studio_draw(view_studio *studio, view_picture *picture, tm_error *error);
/* Fits the camera again at the next picture, from def.camera. */
void view_studio_refit(view_studio *studio);
/* Applies the new angles and zoom of def.camera, with the fitted point as target. */
void view_studio_turn(view_studio *studio);

/* --- text and figures on the picture --- */

/* Draws the overlay. `drawn_hz`: pictures per second; 0: not shown. */
void view_overlay(const view_canvas *canvas, const view_picture *picture, const view_camera *camera, double drawn_hz);
/* Draws only the notice on an empty dark picture, before any tissue has come. */
void view_overlay_waiting(const view_canvas *canvas, const view_picture *picture);

#endif
