/* The mesh cache: one file a mesh and scale, named by its hash. Anything wrong with it is a miss, never an error. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app.h"
#include "cache.h"
#include "mesh_parts.h"

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

bool app_mesh_cache_load(uint64_t hash, app_mesh *mesh) {
    char folder[900], path[960];
    if (!cache_folder(folder, sizeof folder)) return false;
    snprintf(path, sizeof path, "%s/%016llx.tmmesh", folder, (unsigned long long)hash);
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a FIFO in its place must not hold us up */
    FILE *file = fd < 0 ? NULL : fdopen(fd, "rb");
    if (!file) {
        if (fd >= 0) close(fd);
        return false;
    }
    struct stat info;
    bool found = false;
    if (fstat(fileno(file), &info) == 0 && S_ISREG(info.st_mode) && info.st_size > 0) {
        size_t size = (size_t)info.st_size;
        void *bytes = malloc(size);
        found = bytes && fread(bytes, 1, size, file) == size && app_mesh_decode(bytes, size, hash, mesh, NULL) == TM_OK;
        free(bytes);
    }
    fclose(file);
    return found;
}

/* Under a name that nobody else has, and never through a link. */
static bool write_whole(const char *path, const void *bytes, size_t size) {
    char temporary[1000];
    snprintf(temporary, sizeof temporary, "%s.XXXXXX", path);
    int fd = mkstemp(temporary);
    if (fd < 0) return false;
    fchmod(fd, 0644);
    FILE *file = fdopen(fd, "wb");
    bool whole = file && fwrite(bytes, 1, size, file) == size;
    if (file ? fclose(file) != 0 : close(fd) != 0) whole = false;
    if (whole && rename(temporary, path) == 0) return true;
    unlink(temporary);
    return false;
}

void app_mesh_cache_store(const app_mesh *mesh) {
    char folder[900], path[960];
    size_t size;
    if (!cache_folder(folder, sizeof folder) || !make_folders(folder)) return;
    snprintf(path, sizeof path, "%s/%016llx.tmmesh", folder, (unsigned long long)mesh->hash);
    void *bytes = app_mesh_encode(mesh, &size);
    if (bytes) write_whole(path, bytes, size); /* where it cannot be written all works without */
    free(bytes);
}
