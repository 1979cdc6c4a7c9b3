/* {{ title | c_comment }} as an engine plugin of MuJoCo: a sensor and an actuator.
 *
 * The state of the compensator lies in the plugin state of mjData, so that it is copied, reset, saved and restored
 * with it. It is taken one step further when the simulation is; a second mj_forward() changes nothing.
 */

#include <math.h>
#include <string.h>

#include <mujoco/mujoco.h>

#include "{{ stem }}.h"

/* `at` is the state before this step, `next` that after it. */
typedef struct {
    {{ stem }}_state at, next;
    mjtNum last, time;
    int begun, computed;
} memory;

enum { NUMBERS = (sizeof(memory) + sizeof(mjtNum) - 1) / sizeof(mjtNum) };

static const char *const ATTRIBUTES[] = {"reading", "gives"{% if condition %}, "condition"{% endif %}};

#if mjVERSION_HEADER >= 4000000
#define ACTUATORS(m) (m)->nactuator
#define CONTROL(m, i) (m)->actuator_ctrladr[i]
#define FORCE(m, i) (m)->actuator_outadr[i]
#else
#define ACTUATORS(m) (m)->nu
#define CONTROL(m, i) (i)
#define FORCE(m, i) (i)
#endif

static mjtNum *place(const mjModel *m, const mjData *d, int instance)
{
    return d->plugin_state + m->plugin_stateadr[instance];
}

static int user(const int *plugins, int n, int instance)
{
    for (int k = 0; k < n; ++k) {
        if (plugins[k] == instance) {
            return k;
        }
    }
    return -1;
}

static int users(const int *plugins, int n, int instance)
{
    int found = 0;
    for (int k = 0; k < n; ++k) {
        found += plugins[k] == instance;
    }
    return found;
}

/* Whether an instance gives the model's reading, and not the estimate behind one. */
static int forwards(const mjModel *m, int instance)
{
    const char *said = mj_getPluginConfig(m, instance, "gives");
    return said && !strcmp(said, "reading");
}

/* The address in sensordata that an attribute names; -1 where there is no such sensor. */
static int sensor_named(const mjModel *m, int instance, const char *attribute)
{
    const char *name = mj_getPluginConfig(m, instance, attribute);
    int id = name && *name ? mj_name2id(m, mjOBJ_SENSOR, name) : -1;
    return id < 0 ? -1 : m->sensor_adr[id];
}

static int number_of_states(const mjModel *m, int instance)
{
    (void)m;
    (void)instance;
    return NUMBERS;
}

static int sensor_dimension(const mjModel *m, int instance, int sensor)
{
    (void)sensor;
    return forwards(m, instance) ? 1 : 3;
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance)
{
    memory s;
    (void)m;
    (void)data;
    (void)instance;
    memset(&s, 0, sizeof s);
    {{ stem }}_reset(&s.at);
    memcpy(state, &s, sizeof s);
}

static int init(const mjModel *m, mjData *d, int instance)
{
    int sensors = users(m->sensor_plugin, (int)m->nsensor, instance);
    if (sensors + users(m->actuator_plugin, (int)ACTUATORS(m), instance) != 1) {
        mju_warning("{{ stem }}: an instance is for one sensor or one actuator");
        return -1;
    }
    if (sensors && sensor_named(m, instance, "reading") < 0) {
        mju_warning("{{ stem }}: 'reading' has to name the sensor that is read");
        return -1;
    }
{% if condition %}
    if (sensor_named(m, instance, "condition") < 0) {
        mju_warning("{{ stem }}: 'condition' has to name the sensor of the condition");
        return -1;
    }
{% endif %}
{% if not predicts %}
    if (forwards(m, instance)) {
        mju_warning("{{ stem }}: this model gives estimates only");
        return -1;
    }
{% endif %}
    d->plugin_data[instance] = 0;
    return 0;
}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    memory s;
    int sensor = user(m->sensor_plugin, (int)m->nsensor, instance);
    int actuator = user(m->actuator_plugin, (int)ACTUATORS(m), instance);
    if ((capability == mjPLUGIN_SENSOR) != (sensor >= 0)) {
        return;
    }
    memcpy(&s, place(m, d, instance), sizeof s);
    s.next = s.at;
    double given = sensor >= 0 ? d->sensordata[sensor_named(m, instance, "reading")]
                               : d->ctrl[CONTROL(m, actuator)];
    double dt = s.begun ? (d->time - s.last) * {{ per_second | exact }} : 0.0;
{% if condition %}
    double condition = d->sensordata[sensor_named(m, instance, "condition")];
{% endif %}
    double value, deviation = NAN;
    int status = {{ upper }}_OK;
{% if predicts %}
    if (forwards(m, instance)) {
        value = {{ stem }}_predict(&s.next, dt, given{% if condition %}, condition{% endif %});
    } else
{% endif %}
    {
        status = {{ stem }}_step(
            &s.next, dt, given, {% if condition %}condition, {% endif %}&value, &deviation);
    }
    s.time = d->time;
    s.computed = 1;
    memcpy(place(m, d, instance), &s, sizeof s);
    if (actuator >= 0) {
        d->actuator_force[FORCE(m, actuator)] = value;
        return;
    }
    mjtNum *out = d->sensordata + m->sensor_adr[sensor];
    out[0] = value;
    if (m->sensor_dim[sensor] == 3) {
        out[1] = deviation;
        out[2] = status;
    }
}

static void advance(const mjModel *m, mjData *d, int instance)
{
    memory s;
    memcpy(&s, place(m, d, instance), sizeof s);
    if (s.computed) {
        s.at = s.next;
        s.last = s.time;
        s.begun = 1;
        s.computed = 0;
        memcpy(place(m, d, instance), &s, sizeof s);
    }
}

mjPLUGIN_LIB_INIT({{ stem }})
{
    mjpPlugin plugin;
    mjp_defaultPlugin(&plugin);
    plugin.name = "hysid.{{ stem }}";
    plugin.nattribute = sizeof ATTRIBUTES / sizeof *ATTRIBUTES;
    plugin.attributes = ATTRIBUTES;
    plugin.capabilityflags = mjPLUGIN_SENSOR | mjPLUGIN_ACTUATOR;
    plugin.needstage = mjSTAGE_ACC;
    plugin.nstate = number_of_states;
    plugin.nsensordata = sensor_dimension;
    plugin.init = init;
    plugin.reset = reset;
    plugin.compute = compute;
    plugin.advance = advance;
    mjp_registerPlugin(&plugin);
}
