/* Controllers of lockstep: one per instrument, with its virtual device, on one bus and one virtual clock. Each sends
 * and receives as haptic-rt does (io/peer.h), over a queue with the scene's latency, jitter and loss. */
#ifndef TM_SIM_CONTROL_LOOPS_H
#define TM_SIM_CONTROL_LOOPS_H

#include "app.h"
#include "device/device.h"
#include "io/peer.h"
#include "scene/effects.h"
#include "scene/sim.h"

typedef struct sim_control_loop {
    hrt_node node;
    hrt_device device;
    hrt_bus node_bus, device_bus;
    hrt_peer peer;
    tensormass_tool_state_t tool;
    int64_t status_us; /* time of its last status message */
} sim_control_loop;

typedef struct sim_control_loops {
    sim_control_loop *loop; /* [count] */
    int count;
    hrt_loopback bus;
    uint64_t random;
} sim_control_loops;

/* Opens the loops. Returns 0, or an exit code after an error message; close them in either case. The struct must not
 * move while it is open. */
int sim_control_loops_open(sim_control_loops *loops, const sim *s, const sim_haptics *haptics, int64_t tick_us,
                           app_queue *queue);
void sim_control_loops_close(sim_control_loops *loops);
/* Receives the messages that have come, moves the device, computes the force and sends the tool's pose. */
void sim_control_loop_tick(sim_control_loop *loop, int64_t now_us);

#endif
