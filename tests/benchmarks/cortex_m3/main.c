// SPDX-License-Identifier: Apache-2.0
// Run the filters over the samples of samples.h; print the direction of gravity after each sample, and on the controller
// the number of instructions of an update, the mean over the samples from FROM on.
#include <stdio.h>

#include "gravity_filters.h"
#include "samples.h"  // SAMPLES, FROM, DT, rates[SAMPLES][3], forces[SAMPLES][3]

#ifdef CORTEX_M3
#include <stdint.h>
// SysTick of the controller counts down by one each 40 ns, which are 40 instructions where an instruction takes 1 ns.
#define SYST_CSR (*(volatile uint32_t *)0xE000E010)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018)
#define PER_TICK 40.0
static uint32_t now(void) { return SYST_CVR; }
static void start_clock(void) { SYST_RVR = 0xFFFFFF, SYST_CVR = 0, SYST_CSR = 5; }
#else
#define PER_TICK 0.0
static unsigned now(void) { return 0; }
static void start_clock(void) {}
#endif

static vec down[SAMPLES];

static inline vec vector(const real *a) { return (vec){a[0], a[1], a[2]}; }

#define RUN(name, type, update, result, unit)                                                              \
    {                                                                                                      \
        static type s;                                                                                     \
        unsigned long begin = 0;                                                                           \
        for (int k = 0; k < SAMPLES; k++) {                                                                \
            if (k == FROM) begin = now();                                                                  \
            update(&s, k ? R(DT) : R(0), vector(rates[k]), vector(forces[k]));                             \
            down[k] = s.result;                                                                            \
        }                                                                                                  \
        unsigned long ticks = (begin - now()) & 0xFFFFFF;                                                  \
        printf("%s %.0f\n", name, (double)ticks *PER_TICK / (SAMPLES - FROM));                             \
        for (int k = 0; k < SAMPLES; k++)                                                                  \
            printf("%.17g %.17g %.17g\n", (double)(down[k].x / unit), (double)(down[k].y / unit), (double)(down[k].z / unit)); \
    }

int main(void) {
    start_clock();
#ifdef CORTEX_M3
    // The clock itself: 400 loops of 1002 instructions.
    uint32_t begin = now();
    int loops = 400;
    __asm__ volatile("1:\n.rept 1000\nnop\n.endr\nsubs %0, #1\nbne.w 1b" : "+r"(loops) : : "cc");
    printf("clock %.0f\n", ((begin - now()) & 0xFFFFFF) * PER_TICK / 400);
#endif
    RUN("fuzzy", fuzzy_state, fuzzy_update, down, R(1))
    RUN("kalman_reduced", kalman_state, kalman_update_reduced, gravity, GRAVITY)
    RUN("kalman_full", kalman_state, kalman_update_full, gravity, GRAVITY)
    return 0;
}
