/* TM_REQUIRE: checks the caller's part of the contract, in every build. Shared with libtensormass_solve. */
#ifndef TM_CONTRACT_H
#define TM_CONTRACT_H

#include "tensormass/base.h"

/* Unless `condition`: calls the handler and returns the value given (nothing in a function of type void:
 * `TM_REQUIRE(world, "world is null", )`). Not for use inside a step. */
#define TM_REQUIRE(condition, sentence, ...)                                                                           \
    do {                                                                                                               \
        if (__builtin_expect(!(condition), 0)) {                                                                       \
            tm_contract_broken(__func__, sentence);                                                                    \
            return __VA_ARGS__;                                                                                        \
        }                                                                                                              \
    } while (0)

/* Checks a definition struct: not null, filled by its _default function, and of this version's size. */
#define TM_REQUIRE_DEF(def, filled, ...)                                                                               \
    do {                                                                                                               \
        TM_REQUIRE(def, #def " is null", __VA_ARGS__);                                                                 \
        TM_REQUIRE((def)->cookie == (uint32_t)(filled), #def " was not filled by its _default function", __VA_ARGS__); \
        TM_REQUIRE((def)->size == sizeof *(def), #def " is of another version of the library's headers", __VA_ARGS__); \
    } while (0)

/* Returns whether x_m is within a million metres; false for NaN. */
static inline bool tm_is_place(double x_m) { return x_m >= -1e6 && x_m <= 1e6; }
static inline bool tm_are_places(const double x_m[3]) {
    return tm_is_place(x_m[0]) && tm_is_place(x_m[1]) && tm_is_place(x_m[2]);
}
/* Checks a tm_tool_pose: not null, finite and in range. */
#define TM_IS_POSE(pose)                                                                                               \
    ((pose) && tm_are_places((pose)->tip_m) && tm_is_place((pose)->roll_rad) && tm_is_place((pose)->grip))

#endif
