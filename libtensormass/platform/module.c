/* Modules with heavy dependencies (LCM, OSMesa, CHOLMOD): shared objects, opened only when a scene or command needs
 * them. */
#include <dlfcn.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "app.h"

static void fail(tm_error *error, const char *name, const char *why) {
    if (!error) return;
    static const struct {
        const char *name, *package;
    } packages[] = {{"lcm", "liblcm1"},       {"osmesa", "libosmesa6"},    {"opengl", "libgl1"},
                    {"solve", "libcholmod3"}, {"window", "libsdl2-2.0-0"}, {"image", "libinsighttoolkit5.2"}};
    const char *package = "its Debian package";
    for (size_t i = 0; i < sizeof packages / sizeof *packages; i++)
        if (strcmp(packages[i].name, name) == 0) package = packages[i].package;
    error->status = TM_ERR_FILE;
    error->entity = -1;
    snprintf(error->message, sizeof error->message,
             "module '%s' cannot be opened: %s; apt-get install %s, or run make%s", name, why, package,
             strcmp(name, "image") == 0 ? " image" : "");
}

/* Finds the program's folder. */
static bool program_folder(char bin[1024]) {
    ssize_t length = readlink("/proc/self/exe", bin, 1023);
    if (length <= 0) return false;
    bin[length] = 0;
    char *slash = strrchr(bin, '/');
    *slash = 0;
    return true;
}

bool app_shared_file(const char *name, char *path, size_t size) {
    /* PREFIX/bin, build/bin and build/CONFIG/bin. */
    static const char *const places[] = {"../share/tensormass", "../..", "../../.."};
    char bin[1024];
    snprintf(path, size, "%s", name);
    if (access(path, R_OK) == 0) return true;
    if (program_folder(bin))
        for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
            snprintf(path, size, "%s/%s/%s", bin, places[i], name);
            if (access(path, R_OK) == 0) return true;
        }
    snprintf(path, size, "%s", name);
    return false;
}

void *app_module(const char *name, tm_error *error) {
    char path[1200], bin[1024];
    /* Next to the program (build/bin -> build/lib/tensormass, PREFIX/bin -> PREFIX/lib/tensormass). */
    if (!program_folder(bin)) {
        fail(error, name, "/proc is not mounted; mount it");
        return NULL;
    }
    snprintf(path, sizeof path, "%s/../lib/tensormass/%s.so", bin, name);
    if (access(path, R_OK) != 0)
        snprintf(path, sizeof path, "%s/../../lib/tensormass/%s.so", bin, name); /* test programs */
    void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!module) fail(error, name, dlerror());
    return module;
}

void *app_module_symbol(void *module, const char *symbol, tm_error *error) {
    void *address = dlsym(module, symbol);
    if (!address) fail(error, symbol, dlerror());
    return address;
}
