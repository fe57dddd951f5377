/* Rows of nonlinear laws for tests: all, or only that named by TM_LAW, with the constants that each row has as example.
 */
#ifndef TM_TEST_LAW_ROWS_H
#define TM_TEST_LAW_ROWS_H

#include <stdlib.h>
#include <string.h>

#include "../fixture.h"

static inline bool law_is_tested(tm_law_kind law) {
    const char *only = getenv("TM_LAW");
    return !only || !strcmp(only, tm_law_name(law));
}

/* Writes the example constants; returns how many the law has. */
static inline int32_t law_example(tm_law_kind law, double constant[TM_LAW_CONSTANTS]) {
    const tm_law_constant *c;
    int32_t count = 0;
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) constant[i] = 0;
    for (; (c = tm_law_constant_at(law, count)); count++) constant[count] = c->example;
    return count;
}

/* Sets a law on elastic constants. */
static inline void law_set(tm_material *m, tm_law_kind law) {
    double constant[TM_LAW_CONSTANTS];
    tm_error error;
    law_example(law, constant);
    fix_ok(tm_material_set_law(m, law, constant, 0, &error), &error);
}

#endif
