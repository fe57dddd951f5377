/* A picture from a file that does not move: a scene or a mesh. */
#ifndef VIEW_STILL_H
#define VIEW_STILL_H

#include "picture.h"

/* Fills the picture's surface (and a scene's instruments where they start). 0, or an exit code after complaining. */
int view_still_load(const char *path, double scale, view_picture *picture);

#endif
