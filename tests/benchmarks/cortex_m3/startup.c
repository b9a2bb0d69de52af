// SPDX-License-Identifier: Apache-2.0
// Vector table of the emulated board (ARM MPS2+ with the Cortex-M3 image AN385): stack and entry of the C library.
extern void _start(void);
extern char stack_top;
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {(void (*)(void))&stack_top, _start};
