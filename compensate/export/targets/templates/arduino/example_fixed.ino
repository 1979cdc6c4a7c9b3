// {{ title | c_comment }}: {{ estimate | quantity | c_comment }} from {{ reading | quantity | c_comment }}, 100 times a second, in integers.

#include <Arduino.h>

#include <{{ stem }}.h>

static const unsigned long PERIOD = 10000; // microseconds
static {{ stem }}_state state;

// Put your sensor here. This one counts 0 at the lower limit of the readings, 1023 at the upper one.
static int32_t read_sensor()
{
    const int32_t low = {{ low_limit }}, high = {{ high_limit }};
    return low + (high / 1023 - low / 1023) * (int32_t)analogRead(A0);
}

void setup()
{
    Serial.begin(115200);
    if ({{ stem }}_self_test(&state) != 0) {
        Serial.println(F("this board computes other estimates than those that were exported"));
    }
}

void loop()
{
    static unsigned long last = micros();
    unsigned long now = micros();
    if (now - last < PERIOD) {
        return;
    }
    int32_t dt = (int32_t)(now - last); // this model does not need it
    last = now;
    int32_t estimate;
    int status = {{ stem }}_step(&state, dt, read_sensor(), &estimate, 0);
    Serial.print({{ stem }}_estimate(estimate), 6); // the only float here is the one that is printed
    Serial.print(F(" status "));
    Serial.println(status); // 0 is {{ upper }}_OK; {{ stem }}.h lists the others
}
