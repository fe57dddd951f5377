/* Selects the form of a test: TM_LONG=1 (`make check-long`) is the long one; unset, empty or 0 is the short one. */
#ifndef TM_TEST_LONG_H
#define TM_TEST_LONG_H

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static inline bool test_is_long(void) {
    const char *text = getenv("TM_LONG");
    return text && strcmp(text, "1") == 0;
}

/* A sanitizer is ten times as slow: some of many similar cases suffice, as the plain build runs all. */
static inline bool test_is_sanitized(void) { return getenv("TM_SANITIZER") != NULL; }

/* ThreadSanitizer watches what threads share: runs of one thread, whose bits the plain build compares, are left out. */
static inline bool test_watches_threads(void) {
    const char *name = getenv("TM_SANITIZER");
    return name && strcmp(name, "tsan") == 0;
}

#endif
