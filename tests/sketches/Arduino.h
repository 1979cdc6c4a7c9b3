// As much of Arduino's library as the sketch in docs/ uses.
#pragma once
#include <string.h>

static const int A0 = 14;
int analogRead(int pin);
unsigned long micros();
struct Port {
    void begin(unsigned long baud);
    void print(float value);
    void print(const char *text);
    void println(const char *text);
};
extern Port Serial;
