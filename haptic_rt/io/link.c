/* The door to the LCM module; this file is linked into the programs, lcm_link.c into the module. */
#include "app.h"
#include "lcm_link.h"

const hrt_link_api *hrt_link_module(void) {
    tm_error error = {.status = TM_OK};
    void *module = app_module("haptic", &error);
    const hrt_link_api *api = module ? app_module_symbol(module, "hrt_link_table", &error) : NULL;
    if (!api) app_report("--lcm-url", 0, &error);
    return api;
}
