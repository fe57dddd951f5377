#include "picture_renderer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

view_studio_def view_studio_default(int width, int height) {
    return (view_studio_def){
        .render = {.width = width, .height = height, .samples = 1, .edges = true, .levels = 1, .crease_rad = 0.9f},
        .camera = view_camera_default(),
        .words = true};
}

tm_status view_studio_open(view_studio *studio, const view_studio_def *def, tm_error *error) {
    memset(studio, 0, sizeof *studio);
    studio->def = *def;
    studio->module = def->display ? "opengl" : "osmesa";
    void *module = app_module(studio->module, error);
    if (!module || !(studio->api = app_module_symbol(module, VIEW_RENDER_SYMBOL, error))) return error->status;
    tm_status status = studio->api->create(&def->render, &studio->renderer, error);
    if (status) return status;
    studio->canvas = (view_canvas){def->render.width, def->render.height,
                                   calloc((size_t)def->render.width * (size_t)def->render.height, 3)};
    if (studio->canvas.rgb) return TM_OK;
    view_studio_close(studio);
    error->status = TM_ERR_MEMORY;
    return error->status;
}

void view_studio_close(view_studio *studio) {
    if (studio->renderer) studio->api->destroy(studio->renderer);
    free(studio->canvas.rgb);
    view_surface_free(&studio->first);
    memset(studio, 0, sizeof *studio);
}

void view_studio_refit(view_studio *studio) { studio->fitted = false; }

void view_studio_turn(view_studio *studio) {
    if (studio->fitted)
        studio->camera =
            view_camera_fit(&studio->def.camera, &studio->first, studio->def.render.width, studio->def.render.height);
}

/* Keeps the points that the camera was fitted to, so that it orbits the tissue's original position, not the deformed
 * one. */
static bool keep_first(view_studio *studio, const view_surface *surface) {
    if (!view_surface_reserve(&studio->first, surface->vertex_count, 0)) return false;
    studio->first.vertex_count = surface->vertex_count;
    memcpy(studio->first.vertex_m, surface->vertex_m, (size_t)surface->vertex_count * 3 * sizeof(float));
    return true;
}

static void aim(view_studio *studio, const view_picture *picture) {
    const view_render_def *size = &studio->def.render;
    if (!studio->fitted && !keep_first(studio, &picture->surface)) return;
    if (studio->fitted && studio->def.orbit_rad_s == 0) return;
    view_camera_def def = studio->def.camera;
    def.azimuth_rad += studio->def.orbit_rad_s * (float)picture->time_s;
    view_camera next = view_camera_fit(&def, &studio->first, size->width, size->height);
    studio->camera = next;
    studio->fitted = true;
}

/* Returns the scale of all arrows; it shrinks if a force would exceed the picture. */
static double arrow_scale(view_studio *studio, const view_picture *picture) {
    if (studio->def.newton_m > 0) return studio->def.newton_m;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) {
        const double *f = picture->instrument[i].force_N;
        if (picture->instrument[i].shown)
            studio->peak_force_N = fmax(studio->peak_force_N, sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
    }
    double unit = pow(10, ceil(log10(fmax(studio->peak_force_N, 0.2)))),
           full = studio->peak_force_N <= 0.2 * unit   ? 0.2 * unit
                  : studio->peak_force_N <= 0.5 * unit ? 0.5 * unit
                                                       : unit;
    return 0.45 * (double)studio->camera.radius_m / full;
}

tm_status view_studio_draw(view_studio *studio, view_picture *picture, tm_error *error) {
    if (picture->surface.vertex_count == 0) {
        view_overlay_waiting(&studio->canvas, picture);
        return TM_OK;
    }
    aim(studio, picture);
    picture->newton_m = arrow_scale(studio, picture);
    tm_status status = studio->api->draw(studio->renderer, picture, &studio->camera, studio->canvas.rgb, error);
    if (!status && studio->def.words) view_overlay(&studio->canvas, picture, &studio->camera, studio->drawn_hz);
    return status;
}
