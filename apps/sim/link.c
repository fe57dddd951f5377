#include "app.h"
#include "lcm_link.h"

const sim_lcm_api *sim_lcm_module(tm_error *error) {
    void *module = app_module("lcm", error);
    return module ? app_module_symbol(module, "sim_lcm_functions", error) : NULL;
}
