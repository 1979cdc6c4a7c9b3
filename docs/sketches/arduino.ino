// A sponge under a distance sensor: its force, a thousand times a second, on the serial line.
// sponge.h: hysid export out/sponge --c sponge.h --float

#include <Arduino.h>

#include "sponge.h"

static sponge_state state;

void setup()
{
    Serial.begin(115200);
    if (sponge_self_test(&state) != 0) {
        Serial.println("the compensator computes something else here than where it was made");
    }
}

void loop()
{
    static unsigned long next = 0;
    if (micros() < next) {
        return;
    }
    next = micros() + 1000;
    float force, deviation;
    int status = sponge_step(&state, 0.05f * static_cast<float>(analogRead(A0)), &force, &deviation);
    Serial.print(force);
    Serial.print(" +- ");
    Serial.print(deviation);
    Serial.println(status == SPONGE_OK ? "" : " ?");
}
