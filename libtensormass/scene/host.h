/* Callbacks of a scene's reader and simulation: diagnostics, progress of a model, and whether to stop. Each may be
 * null. */
#ifndef TM_SCENE_HOST_H
#define TM_SCENE_HOST_H

#include "tensormass_scene.h"

typedef struct app_host {
    tm_diagnostics *diagnostics;
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    bool (*stop)(void *user);
    void *user;
    /* Opens a module of the program (solve, image), or reports where it was searched for. Null: only
     * libtensormass_solve, in this library's folder or on the loader's path. */
    void *(*module)(const char *name, tm_error *error);
} app_host;

/* Adds a diagnostic; `text` is "what; what to do". A null `file` means no file. Returns `status`. */
tm_status app_host_tell(const app_host *host, tm_severity severity, tm_status status, const char *file, int line,
                        const char *text);
/* Adds a fault for an error of the library. */
tm_status app_host_report(const app_host *host, const char *file, int line, const tm_error *error);
/* Adds a fault for bad input. Returns TM_ERR_ARGUMENT. */
tm_status app_host_bad(const app_host *host, const char *file, int line, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
void *app_host_module(const app_host *host, const char *name, tm_error *error);

#endif
