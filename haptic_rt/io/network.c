/* Loads the module that links LCM. */
#include "network.h"

#include "app.h"

app_network_opener *hrt_network(tm_error *error) {
    void *module = app_module(APP_NETWORK_MODULE, error);
    app_network_opener *open = NULL;
    if (module) *(void **)&open = app_module_symbol(module, APP_NETWORK_SYMBOL, error);
    return open;
}
