/* Interface between board_replay.c and its machine: files, a timer, an instruction count. port_m.c: the emulated
 * Cortex-M; port_host.c: the host. */
#ifndef FW_PORT_H
#define FW_PORT_H

#include "semihost.h"

void port_start(void);
void port_wait_tick(void); /* waits until the timer's next interrupt has been served */
void port_tick(void);      /* board_replay.c: the work of that interrupt */
uint32_t port_count(void);
uint32_t port_since(uint32_t count); /* instructions since the start; 0 if they cannot be counted */
_Noreturn void port_finish(void);
_Noreturn void port_panic(const char *why);

#endif
