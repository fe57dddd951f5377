/* A frame in C; codegen.cpp does the same with tensormass.hpp and must compile to the same instructions
 * (test_cpp.py). */
#include "tensormass.h"

tm_status frame(tm_world *world, tm_contact *contact, const tm_tool_pose *to, double *lowest_m);

tm_status frame(tm_world *world, tm_contact *contact, const tm_tool_pose *to, double *lowest_m) {
    tm_contact_begin_frame(contact, 20, 10);
    tm_contact_set_target(contact, 0, to, 20);
    const tm_status status = tm_world_step(world, 20);
    if (status != TM_OK) return status;
    const double *u_m = tm_world_state(world)->u_m;
    const size_t size = 3 * (size_t)tm_tissue_mesh(tm_world_tissue(world))->vertex_count;
    double lowest = 0;
    for (size_t i = 2; i < size; i += 3)
        if (u_m[i] < lowest) lowest = u_m[i];
    *lowest_m = lowest;
    return TM_OK;
}
