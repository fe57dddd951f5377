/* Modules with heavy dependencies, opened when a scene needs them. */
#include <dlfcn.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "host.h"

/* In this library's folder, as in wheels and plugins; else on the loader's path. */
static void *open_solve(const char **why) {
    static const char name[] = "libtensormass_solve.so." TM_SOVERSION;
    Dl_info info;
    char path[1200];
    void *module = NULL;
    if (dladdr((void *)app_host_module, &info) && info.dli_fname && strrchr(info.dli_fname, '/')) {
        snprintf(path, sizeof path, "%.*s/%s", (int)(strrchr(info.dli_fname, '/') - info.dli_fname), info.dli_fname,
                 name);
        if (access(path, R_OK) == 0) module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    }
    if (!module) module = dlopen(name, RTLD_NOW | RTLD_LOCAL);
    if (!module) *why = dlerror();
    return module;
}

void *app_host_module(const app_host *host, const char *name, tm_error *error) {
    if (host->module) return host->module(name, error);
    const char *why = "only programs can open it; use tm-sim";
    void *module = strcmp(name, "solve") == 0 ? open_solve(&why) : NULL;
    if (!module) tm_fail(error, TM_ERR_FILE, -1, "module '%s' cannot be opened: %s", name, why);
    return module;
}
