"""Exported headers run on simulated boards: an ATmega328 in simavr."""

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

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
        int status = {stem}_step(&state, {dt}reading, &estimate{deviation});
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


def on_avr(header: Path, readings: np.ndarray, dt: float | None = None) -> OnBoard:
    """An ATmega328 at 16 MHz: what it gives for some readings, floats or integers of fixed point."""
    stem = header.stem
    words = ", ".join(f"{y!r}" for y in readings.tolist())
    source = header.with_name(f"{stem}_avr.c")
    fixed = readings.dtype.kind == "i"
    source.write_text(
        ON_AVR.format(
            stem=stem, n=len(readings), readings=words, real="int32_t" if fixed else f"{stem}_real",
            dt="" if dt is None else f"({stem}_real){dt!r}, ", deviation="" if fixed else ", 0",
        )
    )  # fmt: skip
    program = source.with_suffix(".elf")
    command = ["avr-gcc", "-mmcu=atmega328p", "-O2", "-std=gnu99", "-Wall", "-Werror", str(source)]
    subprocess.run([*command, "-o", str(program), "-lm"], check=True)
    sized = subprocess.run(["avr-size", str(program)], check=True, capture_output=True, text=True)
    text, data, bss = (int(x) for x in sized.stdout.splitlines()[1].split()[:3])
    done = subprocess.run(
        ["simavr", "-m", "atmega328p", "-f", "16000000", str(program)],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    found = re.findall(r"([0-9a-f]{8}) ([0-9a-f]{8}) ([0-9a-f]{8}) ", done.stdout + done.stderr)
    assert len(found) == len(readings), done.stdout[-500:] + done.stderr[-500:]
    word, status, cycles = np.array([[int(x, 16) for x in row] for row in found]).T
    return OnBoard(word, status, cycles, data + bss, text + data)
