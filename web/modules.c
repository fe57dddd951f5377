/* Replaces the loader of modules in a browser or under node: there are none. A scene that needs one is rejected; the
 * message names the key to remove. */
#include <stdio.h>

#include "app.h"
#include "scene/host.h"
#include "scene/solve_api.h"

static bool refuse(tm_error *error, const char *name) {
    if (!error) return false;
    error->status = TM_ERR_FILE;
    error->entity = -1;
    snprintf(error->message, sizeof error->message,
             "this build has no module '%s'; use 'model: dynamic' and 'haptics: {compliance: iterations}', or tm-sim",
             name);
    return false;
}

void *app_module(const char *name, tm_error *error) {
    refuse(error, name);
    return NULL;
}

void *app_module_symbol(void *module, const char *symbol, tm_error *error) {
    (void)module;
    refuse(error, symbol);
    return NULL;
}

void *app_host_module(const app_host *host, const char *name, tm_error *error) {
    (void)host;
    return app_module(name, error);
}

bool sim_solve_open(const app_host *host, sim_solve_api *api, tm_error *error) {
    (void)host;
    (void)api;
    return refuse(error, "solve");
}
