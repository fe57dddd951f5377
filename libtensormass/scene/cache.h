/* Where things lie that can be made again. */
#ifndef TM_CACHE_H
#define TM_CACHE_H

#include <stdbool.h>
#include <stddef.h>

/* The folder of things that can be made again: $TM_CACHE_DIR, else $XDG_CACHE_HOME/tensormass, else
 * ~/.cache/tensormass. Made if it is not there; false when it cannot be. */
bool app_cache_folder(char *path, size_t size);

#endif
