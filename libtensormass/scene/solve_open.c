/* Opens the module `solve`. The build for browsers has another (web/modules.c). */
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "solve_api.h"

/* Returns the address space of OpenBLAS, which comes with the module. It starts its threads when opened and maps 128 MB
 * for itself and for each; on failure it retries for ever. The module uses one in each of its own threads. With little
 * address space set OPENBLAS_NUM_THREADS=1, as our programs do. */
static size_t blas_bytes(void) {
    const char *asked = getenv("OPENBLAS_NUM_THREADS");
    const long most = sysconf(_SC_NPROCESSORS_ONLN), given = asked ? strtol(asked, NULL, 10) : 0;
    const long threads = given > 0 && given < most ? given : most;
    return ((size_t)256 << 20) + (threads > 1 ? (size_t)(threads - 1) * ((size_t)208 << 20) : 0);
}

static bool has_capacity(size_t bytes) {
    void *all = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (all == MAP_FAILED) return false;
    munmap(all, bytes);
    return true;
}

#define SIM_SOLVE_NAME(name) #name,

bool sim_solve_open(const app_host *host, sim_solve_api *api, tm_error *error) {
    static const char *const name[] = {SIM_SOLVE(SIM_SOLVE_NAME)};
    void **pointer = (void **)api;
    if (!has_capacity(blas_bytes())) {
        tm_fail(error, TM_ERR_MEMORY, -1,
                "the module solve needs %zu MB of address space, more than the limit of this process; raise the "
                "limit (ulimit -v)",
                blas_bytes() >> 20);
        return false;
    }
    void *module = app_host_module(host, "solve", error);
    for (size_t i = 0; module && i < sizeof name / sizeof *name; i++)
        if (!(pointer[i] = dlsym(module, name[i]))) {
            tm_fail(error, TM_ERR_FILE, -1, "the module solve has no function %s; install the module of this version",
                    name[i]);
            return false;
        }
    return module != NULL;
}
