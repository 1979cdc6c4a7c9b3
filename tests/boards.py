"""Exported headers run on simulated boards: an ATmega328 in simavr, a Cortex-M4 in QEMU."""

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.c_harness import ran

ON_AVR = """\
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <string.h>

#include "{stem}.h"

typedef {real} real;

static const real readings[{n}] PROGMEM = {{{readings}}};
static {stem}_state state;
static volatile uint16_t over;

ISR(TIMER1_OVF_vect)
{{
    ++over;
}}

static void put(char c)
{{
    while (!(UCSR0A & (1 << UDRE0))) {{
    }}
    UDR0 = (uint8_t)c;
}}

static void hexadecimal(uint32_t value)
{{
    for (int8_t k = 28; k >= 0; k = (int8_t)(k - 4)) {{
        put("0123456789abcdef"[(value >> k) & 15]);
    }}
    put(' ');
}}

int main(void)
{{
    UCSR0B = 1 << TXEN0;
    TCCR1B = 1;
    TIMSK1 = 1 << TOIE1;
    sei();
    {stem}_reset(&state);
    for (int k = 0; k < {n}; ++k) {{
        real reading, estimate;
        memcpy_P(&reading, &readings[k], sizeof reading);
        over = 0;
        TCNT1 = 0;
        int status = {stem}_step(&state, (real){dt!r}, reading, &estimate, 0);
        uint16_t ticks = TCNT1;
        uint32_t cycles = ((uint32_t)over << 16) + ticks;
        uint32_t bits;
        memcpy(&bits, &estimate, sizeof bits);
        hexadecimal(bits);
        hexadecimal((uint32_t)status);
        hexadecimal(cycles);
        put('\\n');
    }}
    cli();
    sleep_enable();
    sleep_cpu();
}}
"""


class OnBoard(NamedTuple):
    """Estimates as the board's words, statuses, cycles of each step, and RAM and flash in bytes."""

    words: np.ndarray
    status: np.ndarray
    cycles: np.ndarray
    ram: int
    flash: int

    @property
    def value(self) -> np.ndarray:
        """The words as floats."""
        return self.words.astype(np.uint32).view(np.float32)


def on_avr(header: Path, readings: np.ndarray, dt: float = 0.0) -> OnBoard:
    """An ATmega328 at 16 MHz: what it gives for some readings, floats or integers of fixed point."""
    stem = header.stem
    words = ", ".join(f"{y!r}" for y in readings.tolist())
    source = header.with_name(f"{stem}_avr.c")
    fixed = readings.dtype.kind == "i"
    source.write_text(
        ON_AVR.format(
            stem=stem, n=len(readings), readings=words, real="int32_t" if fixed else f"{stem}_real",
            dt=dt,
        )
    )  # fmt: skip
    program = source.with_suffix(".elf")
    flags = ("-mmcu=atmega328p", "-O2", "-std=gnu99", "-Wall", "-Werror")
    ran("avr-gcc", *flags, source, "-o", program, "-lm")
    board = ["simavr", "-m", "atmega328p", "-f", "16000000", str(program)]
    word, status, cycles = _words(board, 3, len(readings))
    return OnBoard(word, status, cycles, *_sizes("avr-size", program))


def _sizes(tool: str, program: Path) -> tuple[int, int]:
    """RAM and flash in bytes."""
    text, data, bss = (int(x) for x in ran(tool, program).stdout.splitlines()[1].split()[:3])
    return data + bss, text + data


def _words(board: list[str], columns: int, rows: int) -> np.ndarray:
    """What the board wrote, (columns, rows); the simulators end as they like."""
    done = subprocess.run(board, capture_output=True, text=True, timeout=300)
    found = re.findall("([0-9a-f]{8}) " * columns, done.stdout + done.stderr)
    assert len(found) == rows, (done.stdout + done.stderr)[-500:]
    return np.array([[int(x, 16) for x in row] for row in found]).T


ON_ARM = """\
#include <string.h>

#include "{stem}.h"

typedef {real} real;
static const real readings[{n}] = {{{readings}}};
static {stem}_state state;

__attribute__((noinline)) int stepped(real reading, real *estimate);
int main(void);
void begin(void);

int stepped(real reading, real *estimate)
{{
    {counted}
}}

/* What the board asks its debugger for: 4 writes a string, 0x18 ends. */
static void call(int operation, const void *given)
{{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = given;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}}

static void hexadecimal(unsigned value)
{{
    char text[10];
    for (int k = 0; k < 8; ++k) {{
        text[k] = "0123456789abcdef"[(value >> (28 - 4 * k)) & 15];
    }}
    text[8] = ' ';
    text[9] = 0;
    call(4, text);
}}

int main(void)
{{
    {stem}_reset(&state);
    for (int k = 0; k < {n}; ++k) {{
        real estimate;
        {before}
        int status = stepped(readings[k], &estimate);
        unsigned bits;
        memcpy(&bits, &estimate, sizeof bits);
        hexadecimal(bits);
        hexadecimal((unsigned)status);
    }}
    return 0;
}}

void begin(void)
{{
    *(volatile unsigned *)0xE000ED88 |= 0xFu << 20; /* the unit for float */
    main();
    call(0x18, (const void *)0x20026);
}}

__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {{
    (void (*)(void))0x20100000, begin,
}};
"""
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
LAYOUT = """\
ENTRY(begin)
SECTIONS
{
    . = 0;
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) }
    .ARM.exidx : { *(.ARM.exidx*) }
    . = 0x20000000;
    .data : { *(.data*) *(.bss*) *(COMMON) }
}
"""


def on_cortex_m4(header: Path, readings: np.ndarray, dt=0.0, learner: int | None = None) -> OnBoard:
    """A Cortex-M4 with its unit for float, in QEMU: `cycles` are the instructions of a step, or of an
    update of the node `learner` by a reference."""
    stem, fixed = header.stem, readings.dtype.kind == "i"
    source = header.with_name(f"{stem}_arm.c")
    step = f"return {stem}_step(&state, (real){dt!r}, reading, estimate, 0);"
    before = f"(void){stem}_step(&state, (real){dt!r}, readings[k], &estimate, 0);"
    update = (
        f"{stem}_adaptive_learn(&{stem}_{learner}, &state.n{learner}, reading);"
        f" *estimate = state.n{learner}.theta[2]; return 0;"
    )
    source.write_text(
        ON_ARM.format(
            stem=stem, n=len(readings), real="int32_t" if fixed else f"{stem}_real",
            readings=", ".join(f"{y!r}" for y in readings.tolist()),
            counted=step if learner is None else update, before="" if learner is None else before,
        )
    )  # fmt: skip
    layout, program, log = (source.with_suffix(end) for end in (".ld", ".elf", ".log"))
    layout.write_text(LAYOUT)
    flags = (*CORTEX_M4, "-O2", "-std=gnu99", "-ffp-contract=off", "-nostartfiles", "-T", layout)
    ran("arm-none-eabi-gcc", *flags, source, "-o", program, "-lm")
    board = [
        "qemu-system-arm", "-M", "mps2-an386", "-nographic", "-semihosting", "-kernel", str(program),
        "-singlestep", "-d", "exec,nochain", "-D", str(log),
    ]  # fmt: skip
    words, status = _words(board, 2, len(readings))
    sizes = _sizes("arm-none-eabi-size", program)
    return OnBoard(words, status, _instructions(program, log), *sizes)


def _instructions(program: Path, log: Path) -> np.ndarray:
    """Instructions of each call of `stepped`: from its first to that after its return, in the caller."""
    named = ran("arm-none-eabi-nm", "-S", program)
    rows = [line.split() for line in named.stdout.splitlines()]
    where = {row[-1]: row for row in rows if len(row) == 4}
    first = int(where["stepped"][0], 16) & ~1
    main, size = int(where["main"][0], 16) & ~1, int(where["main"][1], 16)
    trace = [int(x, 16) & ~1 for x in re.findall(r"/([0-9a-f]{8})/", log.read_text())]
    counts, inside = [], False
    for address in trace:
        if address == first:
            counts.append(0)
            inside = True
        elif inside and main <= address < main + size:
            inside = False
        if inside:
            counts[-1] += 1
    return np.array(counts)
