/* Version, status names, errors, hash, the allocator hook, memory pools. */
#include "base/base_internal.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/asan.h"
#include "base/contract.h"

#ifdef _WIN32
#include <malloc.h>
#include <windows.h>
#else
#include <time.h>
#ifdef __linux__
#include <sys/mman.h>
#endif
#endif

#ifdef TM_ASAN
#include <sanitizer/asan_interface.h>
#define TM_POISON(address, size) ASAN_POISON_MEMORY_REGION(address, size)
#define TM_UNPOISON(address, size) ASAN_UNPOISON_MEMORY_REGION(address, size)
#else
#define TM_POISON(address, size) ((void)0)
#define TM_UNPOISON(address, size) ((void)0)
#endif

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

const char *tm_version(void) { return TEXT(TM_VERSION_MAJOR) "." TEXT(TM_VERSION_MINOR) "." TEXT(TM_VERSION_PATCH); }

const char *tm_status_name(tm_status status) {
    switch (status) {
    case TM_OK: return "TM_OK";
    case TM_ERR_ARGUMENT: return "TM_ERR_ARGUMENT";
    case TM_ERR_MEMORY: return "TM_ERR_MEMORY";
    case TM_ERR_MESH: return "TM_ERR_MESH";
    case TM_ERR_MATERIAL: return "TM_ERR_MATERIAL";
    case TM_ERR_SUPPORT: return "TM_ERR_SUPPORT";
    case TM_ERR_STEP: return "TM_ERR_STEP";
    case TM_ERR_CONVERGENCE: return "TM_ERR_CONVERGENCE";
    case TM_ERR_UNSTABLE: return "TM_ERR_UNSTABLE";
    case TM_ERR_LIMIT: return "TM_ERR_LIMIT";
    case TM_ERR_FILE: return "TM_ERR_FILE";
    case TM_ERR_EXCLUDED: return "TM_ERR_EXCLUDED";
    }
    return "TM_ERR_UNKNOWN";
}

tm_status tm_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...) {
    if (error) {
        error->status = status;
        error->entity = entity;
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(error->message, sizeof error->message, format, arguments);
        va_end(arguments);
    }
    return status;
}

tm_status tm_fail_memory(tm_error *error, const char *what) {
    return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the %s; use a smaller mesh or give the process more", what);
}

uint64_t tm_hash(const void *bytes, size_t count, uint64_t seed) {
    const unsigned char *b = bytes;
    for (size_t i = 0; i < count; i++) seed = (seed ^ b[i]) * 0x100000001b3ULL;
    return seed;
}

#ifdef _WIN32
double tm_clock_s(void) {
    LARGE_INTEGER count, per_s;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&per_s);
    return (double)count.QuadPart / (double)per_s.QuadPart;
}
static void *alloc_aligned(size_t bytes) { return _aligned_malloc(bytes, 64); }
static void free_aligned(void *memory) { _aligned_free(memory); }
#else
double tm_clock_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
/* Allocates large arrays on large pages where the system has them. The force loop streams tens of megabytes; address
 * translation every 4 kB cost up to a tenth of its time. If the system refuses, ordinary pages serve. */
static void *alloc_aligned(size_t bytes) {
#ifdef MADV_HUGEPAGE
    enum { LARGE_PAGE = 2 << 20, WORTH = 2 * LARGE_PAGE };
    if (bytes < WORTH) return aligned_alloc(64, bytes);
    /* Complete pages: C11 requires a multiple of the alignment, and sanitizers refuse anything else. */
    void *memory = aligned_alloc(LARGE_PAGE, (bytes + LARGE_PAGE - 1) / LARGE_PAGE * LARGE_PAGE);
    if (memory) (void)madvise(memory, bytes, MADV_HUGEPAGE);
    return memory;
#else
    return aligned_alloc(64, bytes);
#endif
}
static void free_aligned(void *memory) { free(memory); }
#endif

/* --- allocator hook and its statistics --- */

static void *default_alloc(size_t bytes, void *user) {
    (void)user;
    return alloc_aligned(bytes);
}
static void default_free(void *memory, size_t bytes, void *user) {
    (void)bytes;
    (void)user;
    free_aligned(memory);
}

static tm_allocator hook = {default_alloc, default_free, NULL};
static _Atomic int64_t in_use, high_water;

void tm_set_allocator(const tm_allocator *allocator) {
    hook = allocator ? *allocator : (tm_allocator){default_alloc, default_free, NULL};
}
int64_t tm_memory_in_use(void) { return atomic_load(&in_use); }
int64_t tm_memory_high_water(void) { return atomic_load(&high_water); }

static size_t rounded(size_t bytes) { return (bytes + 63) / 64 * 64; }

void *tm_allocate(size_t bytes) {
    if (bytes > SIZE_MAX / 2) return NULL;
    const size_t size = rounded(bytes);
    void *memory = hook.alloc(size, hook.user);
    if (!memory) return NULL;
    if ((uintptr_t)memory % 64) { /* SIMD loads from it would fault */
        hook.free(memory, size, hook.user);
        tm_contract_broken("tm_set_allocator", "the allocator returned memory that is not aligned to 64 bytes");
        return NULL;
    }
    const int64_t now = atomic_fetch_add(&in_use, (int64_t)size) + (int64_t)size;
    int64_t most = atomic_load(&high_water);
    while (now > most && !atomic_compare_exchange_weak(&high_water, &most, now)) {
    }
    return memory;
}

void tm_release(void *memory, size_t bytes) {
    if (!memory) return;
    const size_t size = rounded(bytes);
    atomic_fetch_sub(&in_use, (int64_t)size);
    hook.free(memory, size, hook.user);
}

/* --- pools --- */

struct tm_pool_block {
    tm_pool_block *next;
    size_t bytes; /* header included */
};
enum { HEADER = 64 };

void *tm_pool_alloc(tm_pool *pool, int64_t count, size_t size) {
    if (pool->failed) return NULL;
    const size_t bytes = HEADER + rounded((size_t)count * size);
    tm_pool_block *block = count < 0 || (size_t)count > (SIZE_MAX / 4) / size ? NULL : tm_allocate(bytes);
    if (!block) {
        pool->failed = true;
        return NULL;
    }
    char *memory = (char *)block + HEADER;
    memset(memory, 0, bytes - HEADER);
    block->next = pool->first;
    block->bytes = bytes;
    pool->first = block;
    pool->bytes += (int64_t)bytes;
    /* Poisons the header and the padding after the array. */
    TM_POISON(block, HEADER);
    TM_POISON(memory + (size_t)count * size, bytes - HEADER - (size_t)count * size);
    return memory;
}

void tm_pool_release(tm_pool *pool) {
    tm_pool_block *block = pool->first;
    while (block) {
        TM_UNPOISON(block, HEADER);
        tm_pool_block *next = block->next;
        const size_t bytes = block->bytes;
        TM_UNPOISON(block, bytes);
        tm_release(block, bytes);
        block = next;
    }
    *pool = (tm_pool){NULL, 0, false};
}

/* --- eigenvalues of small symmetric matrices --- */

void tm_diagonalise6(double A[36]) {
    for (int sweep = 0; sweep < 30; sweep++) {
        double off = 0, diagonal = 0;
        for (int i = 0; i < 36; i++) *(i % 7 ? &off : &diagonal) += A[i] * A[i];
        if (off <= 1e-30 * diagonal) break;
        for (int p = 0; p < 5; p++)
            for (int q = p + 1; q < 6; q++) tm_jacobi(A, 6, p, q, &(double){0}, &(double){0});
    }
}

/* Default contract handler. It is the only place of the library that prints or ends the program, and only until the
 * caller sets another handler. */

static void default_contract_handler(const char *function, const char *sentence, void *user) {
    (void)user;
    fprintf(stderr, "%s: %s; this is an error in the calling program\n", function, sentence);
    abort();
}

static tm_contract_handler contract_handler = default_contract_handler;
static void *contract_user;

void tm_set_contract_handler(tm_contract_handler handler, void *user) {
    contract_handler = handler ? handler : default_contract_handler;
    contract_user = user;
}

void tm_contract_broken(const char *function, const char *sentence) {
    contract_handler(function, sentence, contract_user);
}
