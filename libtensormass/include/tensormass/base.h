/* Status codes, error messages, the allocator hook and export marks. All other headers include this one. */
#ifndef TENSORMASS_BASE_H
#define TENSORMASS_BASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TM_API __attribute__((visibility("default")))

#define TM_VERSION_MAJOR 0
#define TM_VERSION_MINOR 2
#define TM_VERSION_PATCH 0

/* "0.2.0" */
TM_API const char *tm_version(void);

/* Result of a set-up function. A broken contract (a null pointer, a definition struct that was not initialised) is no
 * status: it goes to the contract handler below. */
typedef enum tm_status {
    TM_OK = 0,
    TM_ERR_ARGUMENT = -1,    /* a value outside its stated range */
    TM_ERR_MEMORY = -2,      /* the allocator returned null */
    TM_ERR_MESH = -3,        /* topology or geometry that no element can be built on */
    TM_ERR_MATERIAL = -4,    /* constants that are not positive definite, or not finite */
    TM_ERR_SUPPORT = -5,     /* boundary conditions that leave a rigid-body mode, or contradict each other */
    TM_ERR_STEP = -6,        /* a time step above the guaranteed critical step */
    TM_ERR_CONVERGENCE = -7, /* tolerance not reached within the iteration limit */
    TM_ERR_UNSTABLE = -8,    /* a displacement became infinite or NaN; everything is as before the call */
    TM_ERR_LIMIT = -9,       /* a capacity set at set-up is exhausted */
    TM_ERR_FILE = -10,       /* unreadable, foreign, damaged or truncated file */
    TM_ERR_EXCLUDED = -11    /* two effects that exclude each other in a scene */
} tm_status;

/* Returns the short name, e.g. "TM_ERR_MESH". Never null. */
TM_API const char *tm_status_name(tm_status status);

#define TM_ERROR_MESSAGE_MAX 480

/* Error report, filled on failure by every set-up function. A null pointer in its place is allowed. `message` says what
 * is wrong and, after a semicolon, what to do. */
typedef struct tm_error {
    tm_status status;
    int64_t entity; /* index of the faulty vertex, tetrahedron, region ...; -1: none */
    char message[TM_ERROR_MESSAGE_MAX];
} tm_error;
/* Fills `error` (may be null) and returns `status`. For code outside the library that reports errors the same way. */
TM_API tm_status tm_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* --- contracts ---
 * A broken contract is what no correct program does: a null pointer, a definition struct that its _default function did
 * not fill, or an index out of range in a function without a status. Every public function outside the step checks its
 * contract, in every build. It passes its name and a sentence to the handler. It then changes nothing and returns
 * TM_ERR_ARGUMENT, null, false or zero. The default handler prints and aborts. There is one handler per process, called
 * on the thread of the broken call: set it before other threads call the library. */
typedef void (*tm_contract_handler)(const char *function, const char *sentence, void *user);
/* Sets the handler; null restores the default. */
TM_API void tm_set_contract_handler(tm_contract_handler handler, void *user);
/* Calls the handler. For code outside the library that checks contracts the same way. */
TM_API void tm_contract_broken(const char *function, const char *sentence);

/* Allocator hook of the process. `alloc` returns memory aligned to 64 bytes, or null; `free` receives the same size.
 * Memory that is not aligned breaks the contract: it is freed at once, and the caller gets TM_ERR_MEMORY. The hook must
 * be set before the first object is created, and stay while an object exists: objects do not store it. Any thread that
 * creates an object calls it. */
typedef struct tm_allocator {
    void *(*alloc)(size_t bytes, void *user);
    void (*free)(void *memory, size_t bytes, void *user);
    void *user;
} tm_allocator;

/* Sets the hook; null restores the default (aligned_alloc, free). */
TM_API void tm_set_allocator(const tm_allocator *allocator);

/* Allocates memory through the hook, so that code outside the library is counted too. Not zeroed; null on failure. */
TM_API void *tm_allocate(size_t bytes);
TM_API void tm_release(void *memory, size_t bytes); /* null is allowed; `bytes` as allocated */

/* Return the bytes in use by live objects, and their maximum so far. Exact: the difference is the cost of an effect. */
TM_API int64_t tm_memory_in_use(void);
TM_API int64_t tm_memory_high_water(void);

/* Returns the 64-bit FNV-1a hash of the bytes, continued from `seed` (TM_HASH_SEED to start). Golden hash of tests and
 * summaries. */
#define TM_HASH_SEED 0xcbf29ce484222325ULL
TM_API uint64_t tm_hash(const void *bytes, size_t count, uint64_t seed);

#ifdef __cplusplus
}
#endif
#endif
