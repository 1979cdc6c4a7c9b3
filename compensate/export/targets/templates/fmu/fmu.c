{% set F = "fmi" ~ version %}
{% set STATE = "FMUstate" if version == 2 else "FMUState" %}
{% macro unused() %}
{% for name in varargs %}

    (void){{ name }};
{%- endfor %}
{%- endmacro %}
{# A function of the interface that has nothing to do here, written out with the types it takes. #}
{% macro absent(name, types, result) %}

EXPORT {{ F }}Status API({{ F }}{{ name }})(
    {{ F }}Instance instance{% for type in types %},
    {{ type }}{{ "" if type.endswith("*") else " " }}a{{ loop.index }}{% endfor %})
{
    (void)instance;
{% for type in types %}
    (void)a{{ loop.index }};
{% endfor %}
    return {{ result }};
}
{% endmacro %}
/* {{ title | c_comment }} as a co-simulation unit of FMI {{ version }}.0: one reading a communication step.
 *
 * Types, constants and signatures are those that FMI {{ "2.0.4" if version == 2 else "3.0.2" }} defines (Modelica Association Project FMI, whose
 * headers are under the 2-Clause BSD License). They are written out here; no file of the standard is copied.
 */

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "{{ stem }}.h"

#define TOKEN {{ token | c_string }}

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#ifdef FMI{{ version }}_FUNCTION_PREFIX
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define API(name) JOIN(FMI{{ version }}_FUNCTION_PREFIX, name)
#else
#define API(name) name
#endif

/* ---- the types of FMI {{ version }}.0 that these functions take */
typedef void *{{ F }}Instance;
typedef void *{{ F }}FMUState;
typedef unsigned int {{ F }}ValueReference;
typedef const char *{{ F }}String;
typedef double {{ F }}Float64;
typedef int {{ F }}Int32;
{% if version == 2 %}
typedef int fmi2Boolean;
typedef char fmi2Byte;
typedef struct {
    void (*logger)(void *, fmi2String, int, fmi2String, fmi2String, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} fmi2Callbacks;
{% else %}
#include <stdbool.h>
#include <stdint.h>
typedef bool fmi3Boolean;
typedef unsigned char fmi3Byte;
{% endif %}
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } {{ F }}Status;

enum { TIME, READING, ESTIMATE, DEVIATION, STATUS, CONDITION };

typedef struct {
    {{ stem }}_state compensator;
    double reading, condition, estimate, deviation, time;
    int status, stepped;
} state;

static void reset(state *s)
{
    memset(s, 0, sizeof *s);
    {{ stem }}_reset(&s->compensator);
    s->estimate = s->compensator.last.value;
    s->deviation = s->compensator.last.deviation;
    s->status = {{ upper }}_INVALID;
{% if condition %}
    s->condition = {{ condition.low | exact }};
{% endif %}
}

/* The reading was taken at `time`: the model's dt is the time since the last one was. */
static void take(state *s, double time)
{
    double dt = s->stepped ? (time - s->time) * {{ per_second | exact }} : 0.0;
    s->status = {{ stem }}_step(
        &s->compensator, dt, s->reading, {% if condition %}s->condition, {% endif %}&s->estimate, &s->deviation);
    s->time = time;
    s->stepped = 1;
}

static double *real_of(state *s, {{ F }}ValueReference reference)
{
    switch (reference) {
    case READING:
        return &s->reading;
    case ESTIMATE:
        return &s->estimate;
    case DEVIATION:
        return &s->deviation;
{% if condition %}
    case CONDITION:
        return &s->condition;
{% endif %}
{% if version == 3 %}
    case TIME:
        return &s->time;
{% endif %}
    default:
        return NULL;
    }
}

static {{ F }}Status get_reals(state *s, const {{ F }}ValueReference r[], size_t n, double value[])
{
    for (size_t k = 0; k < n; ++k) {
        double *place = real_of(s, r[k]);
        if (!place) {
            return ERROR;
        }
        value[k] = *place;
    }
    return OK;
}

static {{ F }}Status set_reals(state *s, const {{ F }}ValueReference r[], size_t n, const double value[])
{
    for (size_t k = 0; k < n; ++k) {
        if (r[k] != READING{% if condition %} && r[k] != CONDITION{% endif %}) {
            return ERROR;
        }
        *real_of(s, r[k]) = value[k];
    }
    return OK;
}

static {{ F }}Status get_integers(state *s, const {{ F }}ValueReference r[], size_t n, int value[])
{
    for (size_t k = 0; k < n; ++k) {
        if (r[k] != STATUS) {
            return ERROR;
        }
        value[k] = s->status;
    }
    return OK;
}

static void *instantiate({{ F }}String token)
{
    state *s = token && !strcmp(token, TOKEN) ? malloc(sizeof *s) : NULL;
    if (s) {
        reset(s);
    }
    return s;
}

static {{ F }}Status copy_state(void *instance, void **kept)
{
    if (!*kept) {
        *kept = malloc(sizeof(state));
    }
    if (!*kept) {
        return ERROR;
    }
    memcpy(*kept, instance, sizeof(state));
    return OK;
}

/* ---- what an importer calls, and nothing has to be done for */
{{- absent("SetDebugLogging", [F ~ "Boolean", "size_t", "const " ~ F ~ "String *"], "OK") }}
{% for name in ("ExitInitializationMode", "Terminate", "EnterInitializationMode" if version == 2 else "EnterStepMode") %}
{{- absent(name, [], "OK") }}
{% endfor %}

/* ---- what an importer calls */
EXPORT const char *API({{ F }}GetVersion)(void)
{
    return "{{ version }}.0";
}

EXPORT void API({{ F }}FreeInstance)({{ F }}Instance instance)
{
    free(instance);
}

EXPORT {{ F }}Status API({{ F }}Reset)({{ F }}Instance instance)
{
    reset(instance);
    return OK;
}

EXPORT {{ F }}Status API({{ F }}Get{{ STATE }})({{ F }}Instance instance, {{ F }}FMUState *kept)
{
    return copy_state(instance, kept);
}

EXPORT {{ F }}Status API({{ F }}Set{{ STATE }})({{ F }}Instance instance, {{ F }}FMUState kept)
{
    memcpy(instance, kept, sizeof(state));
    return OK;
}

EXPORT {{ F }}Status API({{ F }}Free{{ STATE }})({{ F }}Instance instance, {{ F }}FMUState *kept)
{
    (void)instance;
    free(*kept);
    *kept = NULL;
    return OK;
}

EXPORT {{ F }}Status API({{ F }}Serialized{{ STATE }}Size)({{ F }}Instance instance, {{ F }}FMUState kept, size_t *size)
{
    (void)instance;
    (void)kept;
    *size = sizeof(state);
    return OK;
}

EXPORT {{ F }}Status API({{ F }}Serialize{{ STATE }})(
    {{ F }}Instance instance, {{ F }}FMUState kept, {{ F }}Byte bytes[], size_t size)
{
    (void)instance;
    if (size < sizeof(state)) {
        return ERROR;
    }
    memcpy(bytes, kept, sizeof(state));
    return OK;
}

EXPORT {{ F }}Status API({{ F }}{{ "DeSerialize" if version == 2 else "Deserialize" }}{{ STATE }})(
    {{ F }}Instance instance, const {{ F }}Byte bytes[], size_t size, {{ F }}FMUState *kept)
{
    (void)instance;
    if (size != sizeof(state) || copy_state((void *)bytes, kept) != OK) {
        return ERROR;
    }
    return OK;
}
{% if version == 2 %}
EXPORT const char *API(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORT fmi2Instance API(fmi2Instantiate)(
    fmi2String name, int kind, fmi2String token, fmi2String resources, const fmi2Callbacks *callbacks,
    fmi2Boolean visible, fmi2Boolean logging)
{
{{- unused("name", "resources", "callbacks", "visible", "logging") }}
    return kind == 1 ? instantiate(token) : NULL; /* co-simulation */
}

EXPORT fmi2Status API(fmi2SetupExperiment)(
    fmi2Instance instance, fmi2Boolean tolerated, double tolerance, double start, fmi2Boolean ends,
    double stop)
{
{{- unused("tolerated", "tolerance", "ends", "stop") }}
    ((state *)instance)->time = start;
    return OK;
}

EXPORT fmi2Status API(fmi2GetReal)(
    fmi2Instance instance, const fmi2ValueReference r[], size_t n, double value[])
{
    return get_reals(instance, r, n, value);
}

EXPORT fmi2Status API(fmi2SetReal)(
    fmi2Instance instance, const fmi2ValueReference r[], size_t n, const double value[])
{
    return set_reals(instance, r, n, value);
}

EXPORT fmi2Status API(fmi2GetInteger)(
    fmi2Instance instance, const fmi2ValueReference r[], size_t n, int value[])
{
    return get_integers(instance, r, n, value);
}

EXPORT fmi2Status API(fmi2DoStep)(
    fmi2Instance instance, double time, double step, fmi2Boolean no_set_state_before)
{
    (void)step;
    (void)no_set_state_before;
    take(instance, time);
    return OK;
}

/* ---- what FMI 2.0 asks for, and a compensator does not have */
{% set refs = "const fmi2ValueReference *" %}
{% for type, c in (("Boolean", "int *"), ("String", "fmi2String *")) %}
{{- absent("Get" ~ type, [refs, "size_t", c], "a2 ? ERROR : OK") }}
{{- absent("Set" ~ type, [refs, "size_t", "const " ~ c], "a2 ? ERROR : OK") }}
{% endfor %}
{{- absent("SetInteger", [refs, "size_t", "const int *"], "a2 ? ERROR : OK") }}
{{- absent("SetRealInputDerivatives", [refs, "size_t", "const int *", "const double *"], "a2 ? ERROR : OK") }}
{{- absent("GetRealOutputDerivatives", [refs, "size_t", "const int *", "double *"], "a2 ? ERROR : OK") }}
{{- absent("GetDirectionalDerivative", [refs, "size_t", refs, "size_t", "const double *", "double *"], "ERROR") }}
{{- absent("CancelStep", [], "ERROR") }}
{% for type, c in (("Status", "int *"), ("RealStatus", "double *"), ("IntegerStatus", "int *"), ("BooleanStatus", "int *"), ("StringStatus", "fmi2String *")) %}
{{- absent("Get" ~ type, ["int", c], "DISCARD") }}
{% endfor %}
{% else %}
EXPORT fmi3Instance API(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n, void *environment,
    void (*log)(void *, fmi3Status, fmi3String, fmi3String),
    void (*update)(void *, double, bool, bool, bool, bool, bool *, double *))
{
{{- unused("name", "resources", "visible", "logging", "events", "early", "required", "n", "environment", "log", "update") }}
    return instantiate(token);
}

EXPORT fmi3Status API(fmi3EnterInitializationMode)(
    fmi3Instance instance, fmi3Boolean tolerated, double tolerance, double start, fmi3Boolean ends,
    double stop)
{
{{- unused("tolerated", "tolerance", "ends", "stop") }}
    ((state *)instance)->time = start;
    return OK;
}

EXPORT fmi3Status API(fmi3GetFloat64)(
    fmi3Instance instance, const fmi3ValueReference r[], size_t n, double value[], size_t values)
{
    return values < n ? ERROR : get_reals(instance, r, n, value);
}

EXPORT fmi3Status API(fmi3SetFloat64)(
    fmi3Instance instance, const fmi3ValueReference r[], size_t n, const double value[], size_t values)
{
    return values < n ? ERROR : set_reals(instance, r, n, value);
}

EXPORT fmi3Status API(fmi3GetInt32)(
    fmi3Instance instance, const fmi3ValueReference r[], size_t n, int32_t value[], size_t values)
{
    return values < n ? ERROR : get_integers(instance, r, n, value);
}

EXPORT fmi3Status API(fmi3DoStep)(
    fmi3Instance instance, double time, double step, fmi3Boolean no_set_state_before, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, double *last)
{
    (void)no_set_state_before;
    take(instance, time);
    *event = *terminate = *early = false;
    *last = time + step;
    return OK;
}

EXPORT fmi3Status API(fmi3GetNumberOfVariableDependencies)(
    fmi3Instance instance, fmi3ValueReference r, size_t *n)
{
    (void)instance;
    (void)r;
    *n = 0;
    return OK;
}

EXPORT fmi3Instance API(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    void *environment, void (*log)(void *, fmi3Status, fmi3String, fmi3String))
{
{{- unused("name", "token", "resources", "visible", "logging", "environment", "log") }}
    return NULL; /* co-simulation only */
}

EXPORT fmi3Instance API(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    void *environment, void (*log)(void *, fmi3Status, fmi3String, fmi3String), void (*clock)(void *),
    void (*lock)(void), void (*unlock)(void))
{
{{- unused("name", "token", "resources", "visible", "logging", "environment", "log", "clock", "lock", "unlock") }}
    return NULL;
}

/* ---- what FMI 3.0 asks for, and a compensator does not have */
{% set refs = "const fmi3ValueReference *" %}
{% for type, c in (("Float32", "float"), ("Int8", "int8_t"), ("UInt8", "uint8_t"), ("Int16", "int16_t"), ("UInt16", "uint16_t"), ("UInt32", "uint32_t"), ("Int64", "int64_t"), ("UInt64", "uint64_t"), ("Boolean", "bool"), ("String", "fmi3String")) %}
{{- absent("Get" ~ type, [refs, "size_t", c ~ " *", "size_t"], "a2 ? ERROR : OK") }}
{{- absent("Set" ~ type, [refs, "size_t", "const " ~ c ~ " *", "size_t"], "a2 ? ERROR : OK") }}
{% endfor %}
{{- absent("SetInt32", [refs, "size_t", "const int32_t *", "size_t"], "a2 ? ERROR : OK") }}
{{- absent("GetBinary", [refs, "size_t", "size_t *", "const uint8_t **", "size_t"], "a2 ? ERROR : OK") }}
{{- absent("SetBinary", [refs, "size_t", "const size_t *", "const uint8_t *const *", "size_t"], "a2 ? ERROR : OK") }}
{{- absent("GetClock", [refs, "size_t", "bool *"], "a2 ? ERROR : OK") }}
{{- absent("SetClock", [refs, "size_t", "const bool *"], "a2 ? ERROR : OK") }}
{{- absent("GetIntervalDecimal", [refs, "size_t", "double *", "int *"], "a2 ? ERROR : OK") }}
{{- absent("GetIntervalFraction", [refs, "size_t", "uint64_t *", "uint64_t *", "int *"], "a2 ? ERROR : OK") }}
{{- absent("GetShiftDecimal", [refs, "size_t", "double *"], "a2 ? ERROR : OK") }}
{{- absent("GetShiftFraction", [refs, "size_t", "uint64_t *", "uint64_t *"], "a2 ? ERROR : OK") }}
{{- absent("SetIntervalDecimal", [refs, "size_t", "const double *"], "a2 ? ERROR : OK") }}
{{- absent("SetIntervalFraction", [refs, "size_t", "const uint64_t *", "const uint64_t *"], "a2 ? ERROR : OK") }}
{{- absent("SetShiftDecimal", [refs, "size_t", "const double *"], "a2 ? ERROR : OK") }}
{{- absent("SetShiftFraction", [refs, "size_t", "const uint64_t *", "const uint64_t *"], "a2 ? ERROR : OK") }}
{{- absent("GetOutputDerivatives", [refs, "size_t", "const int32_t *", "double *", "size_t"], "a2 ? ERROR : OK") }}
{{- absent("GetVariableDependencies", ["fmi3ValueReference", "size_t *", "fmi3ValueReference *", "size_t *", "int *", "size_t"], "ERROR") }}
{{- absent("GetDirectionalDerivative", [refs, "size_t", refs, "size_t", "const double *", "size_t", "double *", "size_t"], "ERROR") }}
{{- absent("GetAdjointDerivative", [refs, "size_t", refs, "size_t", "const double *", "size_t", "double *", "size_t"], "ERROR") }}
{{- absent("EnterConfigurationMode", [], "ERROR") }}
{{- absent("ExitConfigurationMode", [], "ERROR") }}
{{- absent("EnterEventMode", [], "ERROR") }}
{{- absent("EnterContinuousTimeMode", [], "ERROR") }}
{{- absent("CompletedIntegratorStep", ["bool", "bool *", "bool *"], "ERROR") }}
{{- absent("EvaluateDiscreteStates", [], "ERROR") }}
{{- absent("UpdateDiscreteStates", ["bool *", "bool *", "bool *", "bool *", "bool *", "double *"], "ERROR") }}
{{- absent("SetTime", ["double"], "ERROR") }}
{{- absent("SetContinuousStates", ["const double *", "size_t"], "ERROR") }}
{{- absent("GetContinuousStateDerivatives", ["double *", "size_t"], "ERROR") }}
{{- absent("GetEventIndicators", ["double *", "size_t"], "ERROR") }}
{{- absent("GetContinuousStates", ["double *", "size_t"], "ERROR") }}
{{- absent("GetNominalsOfContinuousStates", ["double *", "size_t"], "ERROR") }}
{{- absent("GetNumberOfContinuousStates", ["size_t *"], "ERROR") }}
{{- absent("GetNumberOfEventIndicators", ["size_t *"], "ERROR") }}
{{- absent("ActivateModelPartition", ["fmi3ValueReference", "double"], "ERROR") }}
{% endif %}
