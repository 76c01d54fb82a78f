/* A program without a system on an emulated STM32F4 (QEMU, one instruction a nanosecond, SysTick at HCLK): start-up,
 * counting, and "name ticks" printed through semihosting. Include it in one file.
 */
#ifndef BARE_METAL_H
#define BARE_METAL_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define TICKS 0xFFFFFFu
#define CALIBRATION "calibration of 200000 instructions"

extern uint32_t stack_top, data_start, data_end, data_load, bss_start, bss_end;
int main(void);

static void reset(void)
{
    CPACR |= 0xFu << 20; /* the floating-point unit on */
    memcpy(&data_start, &data_load, (size_t)((uint8_t *)&data_end - (uint8_t *)&data_start));
    memset(&bss_start, 0, (size_t)((uint8_t *)&bss_end - (uint8_t *)&bss_start));
    (void)main();
}

static void hang(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void)) & stack_top, reset, hang, hang, hang, hang, hang
};

static void semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void print_number(const char *name, uint32_t number)
{
    char text[12] = " 0000000000";
    int i;
    for (i = 10; i > 0; i--) {
        text[i] = (char)('0' + number % 10u);
        number /= 10u;
    }
    semihost(4u, name);
    semihost(4u, text);
    semihost(4u, "\n");
}

#define MEASURE(name, statement) \
    do { \
        uint32_t before = SYSTICK_VALUE; \
        statement; \
        print_number(name, (before - SYSTICK_VALUE) & TICKS); \
    } while (0)

/* Two instructions a turn. */
static void count_down(uint32_t turns)
{
    __asm__ volatile("1: subs %0, #1\n bne 1b" : "+r"(turns) : : "cc");
}

static void calibrate(void)
{
    SYSTICK_RELOAD = TICKS;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 5u;
    MEASURE(CALIBRATION, count_down(100000u));
}

static void finish(void)
{
    semihost(0x18u, (const void *)0x20026u);
}

#endif
