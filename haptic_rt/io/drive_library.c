#include "drive_library.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

void *hrt_library_open(const char *variable, const char *const *names, const char *what, const hrt_symbol *symbol,
                       char *why, int why_size) {
    const char *set = getenv(variable);
    void *handle = set ? dlopen(set, RTLD_NOW | RTLD_LOCAL) : NULL;
    for (int i = 0; !set && !handle && names[i]; i++) handle = dlopen(names[i], RTLD_NOW | RTLD_LOCAL);
    if (!handle) {
        snprintf(why, (size_t)why_size, "%s is not installed; install %s, or name the library in $%s",
                 set ? set : names[0], what, variable);
        return NULL;
    }
    for (; symbol->name; symbol++) {
        *symbol->function = dlsym(handle, symbol->name);
        if (*symbol->function) continue;
        snprintf(why, (size_t)why_size, "%s has no %s; install a later version of %s", set ? set : names[0],
                 symbol->name, what);
        dlclose(handle);
        return NULL;
    }
    return handle;
}
