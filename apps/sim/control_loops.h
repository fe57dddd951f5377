/* Lockstep's other end: for each instrument a controller and its virtual device, on one bus and one virtual clock. The
 * controller hears and speaks as haptic-rt does (io/peer.h), over a queue that has the scene's latency, jitter and
 * loss. */
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
    int64_t status_us; /* when it last told of itself */
} sim_control_loop;

typedef struct sim_control_loops {
    sim_control_loop *loop; /* [count] */
    int count;
    hrt_loopback bus;
    uint64_t random;
} sim_control_loops;

/* 0, or an exit code, having complained; close it in either case. It stays where it is while it is open. */
int sim_control_loops_open(sim_control_loops *loops, const sim *s, const sim_haptics *haptics, int64_t tick_us,
                           app_queue *queue);
void sim_control_loops_close(sim_control_loops *loops);
/* Hears what has come, moves the device, computes the force, and says where the tool is. */
void sim_control_loop_tick(sim_control_loop *loop, int64_t now_us);

#endif
