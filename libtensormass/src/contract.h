/* TM_REQUIRE: the caller's part of the contract, looked at in every build. Shared with libtensormass_solve. */
#ifndef TM_CONTRACT_H
#define TM_CONTRACT_H

#include "tensormass/base.h"

/* Unless `condition`: tells the handler and returns the value given (nothing in a function of type void:
 * `TM_REQUIRE(world, "world is null", )`). Not for the inside of a step. */
#define TM_REQUIRE(condition, sentence, ...)                                                                           \
    do {                                                                                                               \
        if (__builtin_expect(!(condition), 0)) {                                                                       \
            tm_contract_broken(__func__, sentence);                                                                    \
            return __VA_ARGS__;                                                                                        \
        }                                                                                                              \
    } while (0)

/* A definition struct: given, filled by its _default function, and of the same size here and there. */
#define TM_REQUIRE_DEF(def, filled, ...)                                                                               \
    do {                                                                                                               \
        TM_REQUIRE(def, #def " is null", __VA_ARGS__);                                                                 \
        TM_REQUIRE((def)->cookie == (uint32_t)(filled), #def " was not filled by its _default function", __VA_ARGS__); \
        TM_REQUIRE((def)->size == sizeof *(def), #def " is of another version of the library's headers", __VA_ARGS__); \
    } while (0)

#endif
