/* The folder of things that can be made again. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cache.h"

static bool cache_folder(char *path, size_t size) {
    const char *own = getenv("TM_CACHE_DIR"), *xdg = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    int length;
    if (own && *own)
        length = snprintf(path, size, "%s", own);
    else if (xdg && *xdg)
        length = snprintf(path, size, "%s/tensormass", xdg);
    else if (home && *home)
        length = snprintf(path, size, "%s/.cache/tensormass", home);
    else
        return false;
    return length > 0 && (size_t)length < size;
}

static bool make_folders(char *path) {
    for (char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        bool there = mkdir(path, 0777) == 0 || errno == EEXIST;
        *slash = '/';
        if (!there) return false;
    }
    return mkdir(path, 0777) == 0 || errno == EEXIST;
}

bool app_cache_folder(char *path, size_t size) { return cache_folder(path, size) && make_folders(path); }
