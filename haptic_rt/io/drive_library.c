#include "drive_library.h"

#include <dlfcn.h>
#include <math.h>
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
    const char *missing = hrt_library_find(handle, symbol);
    if (!missing) return handle;
    snprintf(why, (size_t)why_size, "%s has no %s; install a later version of %s", set ? set : names[0], missing, what);
    dlclose(handle);
    return NULL;
}

const char *hrt_library_find(void *handle, const hrt_symbol *symbol) {
    for (; symbol->name; symbol++) {
        *symbol->function = dlsym(handle, symbol->name);
        if (!*symbol->function) return symbol->name;
    }
    return NULL;
}

void hrt_quaternion_of(const double r[3][3], double q[4]) {
    const double trace = r[0][0] + r[1][1] + r[2][2];
    int i = 0;
    for (int k = 1; k < 3; k++)
        if (r[k][k] > r[i][i]) i = k;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > r[i][i]) {
        const double s = 2.0 * sqrt(fmax(1.0 + trace, 0.0));
        for (int a = 0; a < 3; a++) q[a] = (r[(a + 2) % 3][(a + 1) % 3] - r[(a + 1) % 3][(a + 2) % 3]) / s;
        q[3] = 0.25 * s;
        return;
    }
    const double s = 2.0 * sqrt(fmax(1.0 + r[i][i] - r[j][j] - r[k][k], 1.0e-12));
    q[i] = 0.25 * s;
    q[j] = (r[i][j] + r[j][i]) / s;
    q[k] = (r[i][k] + r[k][i]) / s;
    q[3] = (r[k][j] - r[j][k]) / s;
}
