/* The microcontroller's main: once a timer tick, the loop. */
#include "loop.h"

static fw_loop loop;

int main(void) {
    fw_board_start();
    fw_loop_init(&loop, fw_board_now_us() + 1);
    for (;;) {
        const uint32_t ticks = fw_board_wait_tick();
        fw_loop_tick(&loop, fw_board_now_us(), ticks - 1);
        fw_board_watchdog();
    }
}
