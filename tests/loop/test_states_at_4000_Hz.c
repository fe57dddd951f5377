/* Every transition and every fault at 4000 ticks a second: times are seconds and not ticks. */
#define RIG_PERIOD_US 250
#include "test_states.c"
