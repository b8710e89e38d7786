/* Runs the block of a production code over a file of inputs, on a Cortex-M of QEMU's mps2 boards.
 *
 * UNIT is the name of the block, INPUTS and OUTPUTS the numbers of its inputs and outputs, which its structure begins
 * with, ROWS the address of 16 MB of memory outside the chip. Files are read and written by semihosting; SysTick counts, at -icount shift=5 a tick for 40 / 32 instructions.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define JOIN(a, b) a##b
#define NAME(a, b) JOIN(a, b)
#define TEXT(a) TEXT_OF(a)
#define TEXT_OF(a) #a
#include TEXT(UNIT.h)

typedef NAME(UNIT, _Real) Real;

enum { OPEN = 1, CLOSE = 2, WRITE = 5, READ = 6, EXIT = 0x18, DONE = 0x20026 };
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define SYSTICK ((volatile uint32_t *)0xE000E010u)
#define PAINT 0xA5A5A5A5u

extern uint32_t stack_low[], stack_top[], data_from[], data_low[], data_high[], bss_low[], bss_high[];
static UNIT block;
static Real *const rows = (Real *)ROWS;

static uint32_t semihosting(uint32_t call, const void *arguments)
{
    register uint32_t r0 __asm__("r0") = call;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t open_file(const char *name, uint32_t mode)
{
    const uint32_t arguments[] = {(uint32_t)name, mode, (uint32_t)strlen(name)};
    return semihosting(OPEN, arguments);
}

static uint32_t move(uint32_t call, uint32_t file, const void *at, uint32_t size)
{
    const uint32_t arguments[] = {file, (uint32_t)at, size};
    return semihosting(call, arguments); /* bytes that are left */
}

static uint32_t ticks(void)
{
    return 0xFFFFFFu - SYSTICK[2];
}

/* Ticks of a call. */
static uint32_t timed(void (*method)(UNIT *))
{
    const uint32_t start = ticks();
    method(&block);
    return (ticks() - start) & 0xFFFFFFu;
}

static void nothing(UNIT *self)
{
    (void)self;
}

static void run(void)
{
    struct {
        uint32_t steps, least, most, none, structure, stack, signals;
        uint64_t sum;
    } found = {.least = UINT32_MAX, .structure = sizeof block};
    uint32_t file = open_file("inputs.bin", 1);
    const uint32_t room = 0x1000000u;
    uint32_t size = 0;
    for (uint32_t part = 1; part; size += part) /* as much as comes at once */
        part = room - size - move(READ, file, (char *)rows + size, room - size);
    (void)move(CLOSE, file, NULL, 0);
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0;
    SYSTICK[0] = 5; /* on, with the clock of the processor */
    found.none = timed(nothing);
    NAME(UNIT, _Startup)(&block);
    NAME(UNIT, _Recalibrate)(&block);
    found.signals = block.errorSignals;
    found.steps = size / (INPUTS * sizeof(Real));
    file = open_file("outputs.bin", 5);
    for (uint32_t k = 0; k < found.steps; k++) {
        memcpy(&block, rows + k * INPUTS, INPUTS * sizeof(Real));
        const uint32_t taken = timed(NAME(UNIT, _DoStep)) - found.none;
        found.sum += taken;
        found.least = taken < found.least ? taken : found.least;
        found.most = taken > found.most ? taken : found.most;
        found.signals |= block.errorSignals;
        (void)move(WRITE, file, (const Real *)&block + INPUTS, OUTPUTS * sizeof(Real));
    }
    const uint32_t *deepest = stack_low;
    while (*deepest == PAINT)
        deepest++;
    found.stack = (uint32_t)((char *)__builtin_frame_address(0) - (char *)deepest);
    file = open_file("found.bin", 5);
    (void)move(WRITE, file, &found, sizeof found);
    semihosting(EXIT, (const void *)DONE);
}

void reset(void)
{
    CPACR |= 0xFu << 20; /* the floating-point unit */
    memcpy(data_low, data_from, (size_t)((char *)data_high - (char *)data_low));
    memset(bss_low, 0, (size_t)((char *)bss_high - (char *)bss_low));
    for (uint32_t *at = stack_low; at < (uint32_t *)__builtin_frame_address(0) - 64; at++)
        *at = PAINT;
    run();
    for (;;) {
    }
}

static void fault(void)
{
    const uint32_t stopped[] = {0x20023};
    semihosting(EXIT, (const void *)stopped[0]);
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    stack_top, reset, fault, fault, fault, fault, fault,
};
