#include "team.h"

const char team_name[] = "tm-precompute";

const tm_solve_team *team_begin(int *count, char ***all) {
    (void)count;
    (void)all;
    return NULL;
}

int team_end(int code) { return code; }
