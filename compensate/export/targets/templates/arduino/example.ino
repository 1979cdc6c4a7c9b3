// {{ title | c_comment }}: {{ estimate | quantity | c_comment }} from {{ reading | quantity | c_comment }}, 100 times a second, on the serial line.

#include <Arduino.h>

#include <{{ stem }}.h>

static const unsigned long PERIOD = 10000; // microseconds
static {{ stem }}_state state;

// Put your sensor here: it has to give {{ reading | quantity | c_comment }}.
static {{ stem }}_real read_sensor()
{
    return ({{ stem }}_real)({{ limits[0] | exact }} + ({{ limits[1] | exact }} - {{ limits[0] | exact }}) * analogRead(A0) / 1023.0);
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
    // The model's time is in {{ time_unit | c_comment }}: {{ per_second | exact }} of it in a second.
    {{ stem }}_real dt = ({{ stem }}_real)((now - last) * {{ per_second * 1e-6 }});
    last = now;
    {{ stem }}_real estimate, deviation;
{% if condition %}
    {{ stem }}_real condition = {{ condition.low | exact }}; // {{ condition.name | c_comment }}: measure it
{% endif %}
    int status = {{ stem }}_step(&state, dt, read_sensor(), {% if condition %}condition, {% endif %}&estimate, &deviation);
    Serial.print(estimate, 6);
    Serial.print(F(" +- "));
    Serial.print(deviation, 6);
    Serial.print(F(" status "));
    Serial.println(status); // 0 is {{ upper }}_OK; {{ stem }}.h lists the others
}
