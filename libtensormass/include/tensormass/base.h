/* Status codes, error messages, the allocator hook and export marks. Everything else includes this. */
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

/* What a set-up function came back with. A broken caller's contract (a null pointer, an unfilled
 * definition struct) is no status: it goes to the contract handler below. */
typedef enum tm_status {
    TM_OK = 0,
    TM_ERR_ARGUMENT = -1,    /* a value outside its stated range */
    TM_ERR_MEMORY = -2,      /* the allocator returned null */
    TM_ERR_MESH = -3,        /* topology or geometry that no element can be built on */
    TM_ERR_MATERIAL = -4,    /* constants that are not positive definite, or not finite */
    TM_ERR_SUPPORT = -5,     /* boundary conditions that leave a rigid motion, or contradict */
    TM_ERR_STEP = -6,        /* a time step above the guaranteed critical step */
    TM_ERR_CONVERGENCE = -7, /* the stated tolerance was not reached in the stated iterations */
    TM_ERR_UNSTABLE = -8,    /* a displacement stopped being finite: all is as before the call */
    TM_ERR_LIMIT = -9,       /* a capacity stated at set-up is exhausted */
    TM_ERR_FILE = -10,       /* unreadable, foreign, damaged or truncated file */
    TM_ERR_EXCLUDED = -11    /* two effects that cannot be in one scene */
} tm_status;

/* A short name, "TM_ERR_MESH". Never null. */
TM_API const char *tm_status_name(tm_status status);

#define TM_ERROR_MESSAGE_MAX 480

/* Filled on failure by every set-up function; may be null where the caller does not care.
 * `message` says what is wrong and, after a semicolon, what to do. */
typedef struct tm_error {
    tm_status status;
    int64_t entity; /* index of the vertex, tetrahedron, region ... that is to blame, -1 if none */
    char message[TM_ERROR_MESSAGE_MAX];
} tm_error;
/* Fills `error` (may be null) and returns `status`; for code beside the library that fails as it does. */
TM_API tm_status tm_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* --- contracts ---
 * What no correct program does: a null pointer, a definition struct that its _default function did not fill, an index
 * out of range in a function that has no status. Looked at in every build, by every public function outside the step.
 * The handler is told which function and what; the function then changes nothing and returns TM_ERR_ARGUMENT, null,
 * false or zero. The default handler prints and aborts. The handler is the process's, called on the thread of the
 * broken call: set it before other threads call the library. */
typedef void (*tm_contract_handler)(const char *function, const char *sentence, void *user);
/* Null restores the default. */
TM_API void tm_set_contract_handler(tm_contract_handler handler, void *user);
/* Calls the handler; for code beside the library that wants the same. */
TM_API void tm_contract_broken(const char *function, const char *sentence);

/* The one allocator hook. `alloc` returns memory aligned to 64 bytes or null; `free` gets the same size back. Memory
 * that is not aligned is given back at once: a broken contract, and for whoever asked, TM_ERR_MEMORY.
 * Set it before the first object is made; objects remember nothing of it, so never change it while one lives. Called
 * from every thread that makes something. */
typedef struct tm_allocator {
    void *(*alloc)(size_t bytes, void *user);
    void (*free)(void *memory, size_t bytes, void *user);
    void *user;
} tm_allocator;

/* Null restores the default (aligned_alloc, free). */
TM_API void tm_set_allocator(const tm_allocator *allocator);

/* Memory through the hook, for code beside the library that wants to be in its accounts. Not zeroed; null when there is
 * none. */
TM_API void *tm_allocate(size_t bytes);
TM_API void tm_release(void *memory, size_t bytes); /* null is allowed; `bytes` as they were asked for */

/* Bytes held by live objects now, and the most there ever were. Exact: the cost of an effect is a difference of these.
 */
TM_API int64_t tm_memory_in_use(void);
TM_API int64_t tm_memory_high_water(void);

/* 64-bit FNV-1a over bytes, continued from `seed` (TM_HASH_SEED to start). The golden hash of tests and summaries. */
#define TM_HASH_SEED 0xcbf29ce484222325ULL
TM_API uint64_t tm_hash(const void *bytes, size_t count, uint64_t seed);

#ifdef __cplusplus
}
#endif
#endif
