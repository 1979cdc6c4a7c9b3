{% set fixed = real == "fixed" %}
// {{ title | c_comment }}: {{ estimate | quantity | c_comment }} from {{ reading | quantity | c_comment }}, 100 times a second, {{ "in integers" if fixed else "on the serial line" }}.

#include <Arduino.h>

#include <{{ stem }}.h>

static const unsigned long PERIOD = 10000; // microseconds
static {{ stem }}_state state;

{% if fixed %}
// Put your sensor here. This one counts 0 at the lower limit of the readings, 1023 at the upper one.
static int32_t read_sensor()
{
    const int32_t low = {{ low_limit }}, high = {{ high_limit }};
    return low + (high / 1023 - low / 1023) * (int32_t)analogRead(A0);
}
{% else %}
// Put your sensor here: it has to give {{ reading | quantity | c_comment }}.
static {{ stem }}_real read_sensor()
{
    return ({{ stem }}_real)({{ limits[0] | exact }} + ({{ limits[1] | exact }} - {{ limits[0] | exact }}) * analogRead(A0) / 1023.0);
}
{% endif %}

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
{% if fixed %}
    int32_t dt = (int32_t)(now - last); // this model does not need it
    last = now;
    int32_t estimate;
    int status = {{ stem }}_step(&state, dt, read_sensor(), &estimate, 0);
    Serial.print({{ stem }}_estimate(estimate), 6); // the only float here is the one that is printed
{% else %}
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
{% endif %}
    Serial.print(F(" status "));
    Serial.println(status); // 0 is {{ upper }}_OK; {{ stem }}.h lists the others
}
