// As much of Arduino's library as the exported examples use.
#pragma once
#include <string.h>

#define F(text) text
static const int A0 = 14;
int analogRead(int pin);
unsigned long micros();
struct Port {
    void begin(unsigned long baud);
    void print(float value, int digits);
    void print(const char *text);
    void println(int value);
    void println(const char *text);
};
extern Port Serial;
