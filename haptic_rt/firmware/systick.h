/* The core timer of every Cortex-M. */
#ifndef FW_SYSTICK_H
#define FW_SYSTICK_H

#include <stdint.h>

#define SYST_CSR (*(volatile uint32_t *)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
enum { SYST_ENABLE = 1, SYST_INTERRUPT = 2, SYST_CORE_CLOCK = 4 };

static inline void systick_start(uint32_t core_hz, uint32_t period_us) {
    SYST_RVR = core_hz / 1000000u * period_us - 1u; /* 24 bits: up to 0.67 s at 25 MHz */
    SYST_CVR = 0;
    SYST_CSR = SYST_ENABLE | SYST_INTERRUPT | SYST_CORE_CLOCK;
}

#endif
