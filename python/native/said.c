/* In place of report.c and module.c of libtensormass/platform: a library prints nothing, and its heavy parts lie beside
 * it. */
#include "said.h"

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "app.h"
#include "scene.h"

enum { SAID_MAX = 8192 };
static _Thread_local char said[SAID_MAX];
static _Thread_local tm_status blamed;

void said_begin(void) {
    said[0] = 0;
    blamed = TM_OK;
}

const char *tm_scene_said(void) { return said; }

tm_status said_status(int exit_code, tm_status otherwise) {
    if (!exit_code) return TM_OK;
    return blamed ? blamed : otherwise;
}

static void add(const char *format, ...) {
    size_t used = strlen(said);
    va_list list;
    va_start(list, format);
    vsnprintf(said + used, SAID_MAX - used, format, list);
    va_end(list);
}

static void place(const char *file, int line) {
    if (said[0]) add("\n");
    if (file && line > 0)
        add("%s:%d: ", file, line);
    else if (file)
        add("%s: ", file);
}

int app_bad_input(const char *file, int line, const char *format, ...) {
    place(file, line);
    size_t used = strlen(said);
    va_list list;
    va_start(list, format);
    vsnprintf(said + used, SAID_MAX - used, format, list);
    va_end(list);
    return APP_BAD_INPUT;
}

int app_report(const char *file, int line, const tm_error *error) {
    place(file, line);
    add("%s", error->message[0] ? error->message : tm_status_name(error->status));
    blamed = error->status;
    return APP_FAILED;
}

/* --- modules: the solve library of this package, and no other --- */

static bool folder(char path[1024]) {
    Dl_info info;
    if (!dladdr((void *)said_begin, &info) || !info.dli_fname) return false;
    snprintf(path, 1024, "%s", info.dli_fname);
    char *slash = strrchr(path, '/');
    if (!slash) return false;
    *slash = 0;
    return true;
}

bool app_shared_file(const char *name, char *path, size_t size) {
    char here[1024];
    snprintf(path, size, "%s", name);
    if (access(path, R_OK) == 0) return true;
    if (!folder(here)) return false;
    snprintf(path, size, "%s/../share/%s", here, name);
    return access(path, R_OK) == 0;
}

void *app_module(const char *name, tm_error *error) {
    char here[1024], path[1200];
    const char *why = "the Python package has no such part; use the programs (tm-sim)";
    void *module = NULL;
    if (strcmp(name, "solve") == 0 && folder(here)) {
        snprintf(path, sizeof path, "%s/libtensormass_solve.so." TM_SOVERSION, here);
        module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
        if (!module) why = dlerror();
    }
    if (!module && error) {
        *error = (tm_error){.status = TM_ERR_FILE, .entity = -1};
        snprintf(error->message, sizeof error->message, "module '%s' cannot be opened: %s", name, why);
    }
    return module;
}

void *app_module_symbol(void *module, const char *symbol, tm_error *error) {
    void *address = dlsym(module, symbol);
    if (!address && error) {
        *error = (tm_error){.status = TM_ERR_FILE, .entity = -1};
        snprintf(error->message, sizeof error->message, "%s is not in it", symbol);
    }
    return address;
}
