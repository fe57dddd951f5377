/* Checks a scene that can be read and built for missing or unusual settings. */
#ifndef SCENE_CHECK_H
#define SCENE_CHECK_H

#include <stdbool.h>

/* Prints one line per finding on stderr and a summary on stdout. Returns 0, or 2 if the scene is wrong, or unusual and
 * `strict` is set. */
int check_scene(const char *path, bool strict);

#endif
