/* Process-wide settings of BLAS, SuiteSparse and METIS: changed only during our calls, and restored. */
#include "internal.h"

#include <dlfcn.h>
#include <errno.h>
#include <malloc.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <SuiteSparse_config.h>
#include <sys/mman.h>
#include <sys/resource.h>

/* --- OpenBLAS, if it is the BLAS --- */

typedef struct blas {
    bool found, parallel;
    int (*get_threads)(void);
    void (*set_threads)(int);
} blas;

static blas find_blas(void) {
    int (*parallel)(void);
    blas b = {.parallel = true};
    *(void **)&parallel = dlsym(RTLD_DEFAULT, "openblas_get_parallel");
    *(void **)&b.get_threads = dlsym(RTLD_DEFAULT, "openblas_get_num_threads");
    *(void **)&b.set_threads = dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    b.found = parallel && b.get_threads && b.set_threads;
    if (parallel) b.parallel = parallel();
    return b;
}

bool tms_blas_is_parallel(void) { return find_blas().parallel; }

/* --- SuiteSparse: fast BLAS kernels round differently for different alignments. Without a fixed alignment two runs, or
 * two ranks, would differ in the last bit. free() works as before. --- */

static void *aligned_malloc(size_t bytes) {
    void *memory;
    return posix_memalign(&memory, 4096, bytes ? bytes : 1) ? NULL : memory;
}
static void *aligned_calloc(size_t count, size_t size) {
    if (size && count > SIZE_MAX / size) return NULL;
    void *memory = aligned_malloc(count * size);
    if (memory) memset(memory, 0, count * size);
    return memory;
}
static void *aligned_realloc(void *old, size_t bytes) {
    void *memory = aligned_malloc(bytes);
    if (!memory || !old) return memory;
    const size_t had = malloc_usable_size(old);
    memcpy(memory, old, had < bytes ? had : bytes);
    free(old);
    return memory;
}

/* --- enter and leave --- */

static pthread_mutex_t counting = PTHREAD_MUTEX_INITIALIZER;
static int inside, threads_before;
static struct SuiteSparse_config_struct config_before;
static bool config_changed;

/* OpenBLAS built without threading must not be called from two threads at once (it then returns wrong numbers, seen
 * with 0.3.21). This lock serialises its callers. */
static pthread_mutex_t alone;
static pthread_once_t alone_once = PTHREAD_ONCE_INIT;
static void make_alone(void) {
    pthread_mutexattr_t attribute;
    pthread_mutexattr_init(&attribute);
    pthread_mutexattr_settype(&attribute, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutex_init(&alone, &attribute);
    pthread_mutexattr_destroy(&attribute);
}

void tms_process_enter(void) {
    const blas b = find_blas();
    pthread_once(&alone_once, make_alone);
    if (!b.parallel) pthread_mutex_lock(&alone);
    pthread_mutex_lock(&counting);
    if (inside++ == 0) {
        threads_before = b.found ? b.get_threads() : 1;
        if (b.found && threads_before > 1) b.set_threads(1); /* results depend on their number */
        config_before = SuiteSparse_config;
        /* A program's own allocator stays: its memory must return to it. */
        config_changed = SuiteSparse_config.malloc_func == malloc && SuiteSparse_config.free_func == free;
        if (config_changed) {
            SuiteSparse_config.malloc_func = aligned_malloc;
            SuiteSparse_config.calloc_func = aligned_calloc;
            SuiteSparse_config.realloc_func = aligned_realloc;
        }
    }
    pthread_mutex_unlock(&counting);
}

void tms_process_leave(void) {
    const blas b = find_blas();
    pthread_mutex_lock(&counting);
    if (--inside == 0) {
        if (b.found && threads_before > 1) b.set_threads(threads_before);
        if (config_changed) {
            SuiteSparse_config.malloc_func = config_before.malloc_func;
            SuiteSparse_config.calloc_func = config_before.calloc_func;
            SuiteSparse_config.realloc_func = config_before.realloc_func;
        }
    }
    pthread_mutex_unlock(&counting);
    if (!b.parallel) pthread_mutex_unlock(&alone);
}

/* --- METIS uses rand(): from a fixed state, one ordering at a time --- */

static pthread_mutex_t ordering = PTHREAD_MUTEX_INITIALIZER;
static char *their_state;

void tms_ordering_begin(void) {
    static char own[128];
    pthread_mutex_lock(&ordering);
    their_state = initstate(1, own, sizeof own);
}

void tms_ordering_end(void) {
    setstate(their_state);
    pthread_mutex_unlock(&ordering);
}

/* --- address space: OpenBLAS maps 128 MB for each calling thread (mostly untouched), and retries for ever on failure
 * --- */

static const int64_t BLAS_BYTES = (int64_t)208 << 20; /* including a thread's stack, and its malloc arena */

int64_t tms_blas_bytes(int32_t threads) { return find_blas().found ? threads * BLAS_BYTES : 0; }

bool tms_address_space_has(int64_t bytes, int64_t *limit_bytes) {
    struct rlimit space = {RLIM_INFINITY, RLIM_INFINITY}, data = space;
    getrlimit(RLIMIT_AS, &space);
    getrlimit(RLIMIT_DATA, &data);
    const rlim_t least = space.rlim_cur < data.rlim_cur ? space.rlim_cur : data.rlim_cur;
    *limit_bytes = least == RLIM_INFINITY || least > INT64_MAX ? INT64_MAX : (int64_t)least;
    if (bytes <= 0) return true;
    /* Tries a mapping instead of adding up: this covers limits and strict overcommit alike. */
    void *all = mmap(NULL, (size_t)bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (all == MAP_FAILED) return false;
    munmap(all, (size_t)bytes);
    return true;
}
