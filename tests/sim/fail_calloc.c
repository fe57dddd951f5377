/* LD_PRELOAD: the FAIL_CALLOC-th call of calloc or strdup fails, counted from 1. Under Python, where that number is
 * meaningless, fail_calloc(n) counts from its own call. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

void *__libc_calloc(size_t count, size_t size);

static long calls, fail_at;

void fail_calloc(long n);
void fail_calloc(long n) {
    calls = 0;
    fail_at = n;
}

__attribute__((constructor)) static void begin(void) {
    const char *at = getenv("FAIL_CALLOC");
    fail_calloc(at ? atol(at) : 0);
}

void *calloc(size_t count, size_t size) {
    if (fail_at && ++calls == fail_at) return NULL;
    return __libc_calloc(count, size);
}

char *strdup(const char *text) {
    if (fail_at && ++calls == fail_at) return NULL;
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}
