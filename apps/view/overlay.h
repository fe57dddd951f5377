/* Words and figures on the picture. */
#ifndef VIEW_OVERLAY_H
#define VIEW_OVERLAY_H

#include "camera.h"
#include "font.h"
#include "picture.h"

/* `drawn_hz`: pictures a second, 0 leaves it out. */
void view_overlay(const view_canvas *canvas, const view_picture *picture, const view_camera *camera, double drawn_hz);
/* The notice alone, on an empty dark picture: what is shown before there is any tissue. */
void view_overlay_waiting(const view_canvas *canvas, const view_picture *picture);

#endif
