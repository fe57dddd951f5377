/* The same frame as codegen.c, by the C++ wrapper. */
#include "tensormass.hpp"

extern "C" tm_status frame(tensormass::world_ref world, tensormass::contact_ref contact, const tm_tool_pose &to,
                           double &lowest_m) {
    contact.begin_frame(20, 10);
    contact.set_target(0, to, 20);
    if (const tm_status status = world.step(20); status != TM_OK) return status;
    const tensormass::span<const double> u_m = world.u_m();
    double lowest = 0;
    for (std::size_t i = 2; i < u_m.size(); i += 3)
        if (u_m[i] < lowest) lowest = u_m[i];
    lowest_m = lowest;
    return TM_OK;
}
