/* The microcontroller's main: the tick runs in the timer's interrupt, checks of the simulation's data below it. */
#include "loop.h"

static fw_loop loop;

static void tick(void) {
    fw_loop_tick(&loop, fw_board_now_us());
    fw_board_watchdog();
}

int main(void) {
    fw_loop_init(&loop, 1);
    fw_board_start(tick);
    for (;;) {
        fw_loop_background(&loop);
        fw_board_sleep();
    }
}
