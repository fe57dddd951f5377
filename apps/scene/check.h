/* What is missing or odd in a scene that reads and builds. */
#ifndef SCENE_CHECK_H
#define SCENE_CHECK_H

#include <stdbool.h>

/* Says it on stderr, a line each, and a summary on stdout. 0; 2 where the scene is wrong, or where it is odd and
 * `strict`. */
int check_scene(const char *path, bool strict);

#endif
