/* What a scene's reader and its simulation ask of whoever called: where diagnostics go, how far a model is, whether to
 * go on. Every callback may be null. */
#ifndef TM_SCENE_HOST_H
#define TM_SCENE_HOST_H

#include "tensormass_scene.h"

typedef struct app_host {
    tm_diagnostics *diagnostics;
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    bool (*stop)(void *user);
    void *user;
    /* Opens a part of the program (solve, image) and says where it is not. Null: libtensormass_solve alone, beside this
     * library or where the loader looks. */
    void *(*module)(const char *name, tm_error *error);
} app_host;

/* Adds a diagnostic; `text` is "what; what to do". `file` null: none. Returns `status`. */
tm_status app_host_tell(const app_host *host, tm_severity severity, tm_status status, const char *file, int line,
                        const char *text);
/* A fault by an error of the library. */
tm_status app_host_report(const app_host *host, const char *file, int line, const tm_error *error);
/* A fault of what was read: TM_ERR_ARGUMENT. */
tm_status app_host_bad(const app_host *host, const char *file, int line, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
void *app_host_module(const app_host *host, const char *name, tm_error *error);

#endif
