/* {{ title | c_comment }}: {{ estimate.name | c_comment }} from {{ reading.name | c_comment }}, in fixed point.
 *
 *     {{ stem }}_state state;
 *     {{ stem }}_reset(&state);
 *     int status = {{ stem }}_step(&state, dt, {{ stem }}_reading(5.0f), &estimate, 0);
 *
 * Integers only, but for the two conversions: no floating point in a step, nothing of libm. A reading is an integer of {{ upper }}_READING_STEP, counted from
 * {{ upper }}_READING_ZERO; an estimate one of {{ upper }}_ESTIMATE_STEP, counted from {{ upper }}_ESTIMATE_ZERO, which is
 * Q16.16 in cells of the grid. {{ stem }}_reading and {{ stem }}_estimate convert; a program that knows what its converter
 * counts needs neither. dt is not used: this model does not depend on the rate. Readings beyond the limits are taken for the nearer one.
 *
 * {{ facts_line | c_comment }}
 *
 * State: {{ depth * 8 + 16 }} bytes. Tables: {{ table_bytes }} bytes, constant, in flash on an AVR.
 */

#ifndef {{ upper }}_H
#define {{ upper }}_H

#include <stdint.h>
#include <string.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#define {{ upper }}_TABLE PROGMEM
#define {{ upper }}_AT(table, k) ((int32_t)pgm_read_dword(&(table)[k]))
#else
#define {{ upper }}_TABLE
#define {{ upper }}_AT(table, k) (table)[k]
#endif

{{ macros }}
#define {{ upper }}_READING_ZERO {{ reading_zero }}
#define {{ upper }}_READING_STEP {{ reading_step }}
#define {{ upper }}_ESTIMATE_ZERO {{ estimate_zero }}
#define {{ upper }}_ESTIMATE_STEP {{ estimate_step }}
#define {{ upper }}_UNKNOWN INT32_MIN

enum {{ stem }}_status {
{% for name, value, said in statuses %}
    {{ upper }}_{{ name }} = {{ value }}, /* {{ said }} */
{% endfor %}
};

enum { {{ upper }}_CELLS = {{ cells }}, {{ upper }}_DEPTH = {{ depth }} };

/* Twice the Everett function between the nodes, the half cells on its diagonal, the reversible part. */
static const int32_t {{ stem }}_everett[{{ (cells + 1) ** 2 }}] {{ upper }}_TABLE = {
    {{ everett }}
};
static const int32_t {{ stem }}_diagonal[{{ cells }}] {{ upper }}_TABLE = {
    {{ diagonal }}
};
static const int32_t {{ stem }}_reversible[{{ cells + 1 }}] {{ upper }}_TABLE = {
    {{ reversible }}
};

/* Inputs and outputs where the open loops begin, the oldest first; the caller keeps it. */
typedef struct {
    int32_t extremum[{{ upper }}_DEPTH];
    int32_t level[{{ upper }}_DEPTH];
    int32_t u, z, estimate;
    {{ count }} depth;
    uint8_t rising, known;
} {{ stem }}_state;

static inline int32_t {{ stem }}_reading(float reading)
{
    float found = (reading - (float){{ upper }}_READING_ZERO) / (float){{ upper }}_READING_STEP;
    if (!(reading - reading == 0.0f)) { /* NaN or infinite */
        return {{ upper }}_UNKNOWN;
    }
    return found >= 2147483648.0f ? INT32_MAX : found <= -2147483648.0f ? -INT32_MAX : (int32_t)found;
}

static inline float {{ stem }}_estimate(int32_t estimate)
{
    return (float){{ upper }}_ESTIMATE_ZERO + (float)estimate * (float){{ upper }}_ESTIMATE_STEP;
}

static inline void {{ stem }}_reset({{ stem }}_state *s)
{
    static const int32_t extremum[{{ first | length }}] {{ upper }}_TABLE = { {{ first | map(attribute=0) | join(", ") }} };
    static const int32_t level[{{ first | length }}] {{ upper }}_TABLE = { {{ first | map(attribute=1) | join(", ") }} };
    memset(s, 0, sizeof *s);
    for (int k = 0; k < {{ first | length }}; ++k) {
        s->extremum[k] = {{ upper }}_AT(extremum, k);
        s->level[k] = {{ upper }}_AT(level, k);
    }
    s->depth = {{ first | length }};
    s->rising = {{ rising }};
    s->u = {{ u }};
    s->z = {{ z }};
    s->estimate = {{ u }};
}

/* a g / 65536, rounded down. An AVR multiplies bytes: its compiler calls a function of four times the cycles. */
static inline int32_t {{ stem }}_part(int32_t a, uint16_t g)
{
#ifdef __AVR__
    int32_t made;
    uint8_t below, zero = 0;
    __asm__("mul %A3, %A4 \n\t mov %1, r1 \n\t"
            "mul %B3, %B4 \n\t movw %A0, r0 \n\t"
            "mulsu %D3, %B4 \n\t movw %C0, r0 \n\t"
            "mul %A3, %B4 \n\t add %1, r0 \n\t adc %A0, r1 \n\t adc %B0, %2 \n\t adc %C0, %2 \n\t adc %D0, %2 \n\t"
            "mul %B3, %A4 \n\t add %1, r0 \n\t adc %A0, r1 \n\t adc %B0, %2 \n\t adc %C0, %2 \n\t adc %D0, %2 \n\t"
            "mul %C3, %A4 \n\t add %A0, r0 \n\t adc %B0, r1 \n\t adc %C0, %2 \n\t adc %D0, %2 \n\t"
            "mul %C3, %B4 \n\t add %B0, r0 \n\t adc %C0, r1 \n\t adc %D0, %2 \n\t"
            "mulsu %D3, %A4 \n\t sbc %D0, %2 \n\t add %B0, r0 \n\t adc %C0, r1 \n\t adc %D0, %2 \n\t"
            "clr r1"
            : "=&r"(made), "=&r"(below)
            : "r"(zero), "a"(a), "a"(g));
    return made;
#else
    return (a >> 16) * (int32_t)g + (int32_t)(((uint32_t)(uint16_t)a * g) >> 16);
#endif
}

/* The root f, in parts of 65536, of a f^2 + b f + c = 0 in [0, 1), where it rises, and the slope there.
 *
 * One binary digit d after the other, as in long division: with the rest 2^k (a f^2 + b f + c) and the slope
 * 2 a f + b, the rest at f + 2^-k is the rest + the slope + a 2^-k. Neither a root nor a quotient is needed.
 */
static inline uint16_t {{ stem }}_within(int32_t a, int32_t b, int32_t c, int32_t *slope)
{
    uint16_t f = 0;
    *slope = b;
    if (c >= 0) {
        return f;
    }
    if (a + b + c <= 0) {
        *slope = b + 2 * a;
        return 65535u;
    }
    for (uint8_t k = 16; k; --k) {
        a >>= 1;
        c += c;
        f = (uint16_t)(f << 1);
        int32_t rest = c + b + a;
        if (rest <= 0) {
            c = rest;
            b += 2 * a;
            f |= 1;
        }
    }
    *slope = b;
    /* Rounded: cut off, estimates would sink with each loop within a loop. */
    return f < 65535u && c + c + b + (a >> 1) <= 0 ? (uint16_t)(f + 1) : f;
}

/* The input behind z, nearest to s->u, on the branch from the youngest reversal; its status is written. */
static inline int32_t {{ stem }}_solve(const {{ stem }}_state *s, int32_t z, int *status)
{
    uint8_t up = s->rising;
    int32_t r = s->extremum[s->depth - 1];
    uint8_t j = (uint8_t)(r >> 16);
    uint16_t g = (uint16_t)r;
    const int32_t *row = {{ stem }}_everett + (int)j * ({{ upper }}_CELLS + 1);
    const int32_t *next = row + {{ upper }}_CELLS + 1;
    int32_t half = {{ stem }}_part({{ upper }}_AT({{ stem }}_diagonal, j), g);
    int32_t R = {{ upper }}_AT({{ stem }}_reversible, j);
    R += {{ stem }}_part({{ upper }}_AT({{ stem }}_reversible, j + 1) - R, g);
    half = {{ stem }}_part(half, g) - half;
    /* Where the branch is at a node: its two E, and R with the sign of the way, reach `goal`. */
    int32_t goal = up ? z - s->level[s->depth - 1] + R - half : s->level[s->depth - 1] - z - R - half;
    int32_t end = up ? ((int32_t){{ upper }}_CELLS << 16) - 1 : 0;
    if (s->depth >= 2) {
        end = s->extremum[s->depth - 2];
    }
    uint8_t first = (uint8_t)(s->u >> 16), last = (uint8_t)(end >> 16), i;
    int32_t E, q;
#define {{ upper }}_NODE(k) \
    (E = {{ upper }}_AT(row, k), E += {{ stem }}_part({{ upper }}_AT(next, k) - E, g), \
     q = {{ upper }}_AT({{ stem }}_reversible, k), up ? E + q : E - q)
    if (up) {
        while (first < last) { /* at most: log2(cells) + 1 */
            uint8_t middle = (uint8_t)((uint8_t)(first + last + 1) >> 1);
            if ({{ upper }}_NODE(middle) < goal - {{ margin }}) {
                first = middle;
            } else {
                last = (uint8_t)(middle - 1);
            }
        }
    } else {
        while (last < first) { /* at most: log2(cells) + 1 */
            uint8_t middle = (uint8_t)(((uint8_t)(first + last) >> 1) + 1);
            if ({{ upper }}_NODE(middle) < goal - {{ margin }}) {
                first = (uint8_t)(middle - 1);
            } else {
                last = middle;
            }
        }
    }
    i = first;
    int32_t A = {{ upper }}_AT({{ stem }}_diagonal, i), B, C;
    if (i == j) { /* a parabola from the reversal, beyond which q falls: how far from there */
        B = {{ upper }}_AT({{ stem }}_reversible, i + 1) - {{ upper }}_AT({{ stem }}_reversible, i);
        C = up ? s->level[s->depth - 1] - z : z - s->level[s->depth - 1];
    } else {
        C = {{ upper }}_NODE(i) - goal;
        B = {{ upper }}_NODE(i + 1) - goal - C - A;
        if (!up) { /* q falls along the cell: turned, so that it rises */
            A = -A;
            B = -B;
            C = -C;
        }
    }
#undef {{ upper }}_NODE
    int32_t slope;
    uint16_t f = {{ stem }}_within(A, B, C, &slope);
    *status = slope > {{ flat }} ? {{ upper }}_OK : {{ upper }}_FLAT;
    int32_t u = i == j ? (up ? r + f : r - f) : ((int32_t)i << 16) + f;
    if (up) {
        u = u < s->u ? s->u : u;
        return u < end ? u : end;
    }
    u = u > s->u ? s->u : u;
    return u > end ? u : end;
}

/* One reading in, one estimate out; what it is worth is returned. A reading that is {{ upper }}_UNKNOWN is INVALID: the
 * last estimate is held. The deviation is not known in integers: where its pointer is not null, it is
 * {{ upper }}_UNKNOWN. */
static inline int {{ stem }}_step(
    {{ stem }}_state *s, int32_t dt, int32_t reading, int32_t *estimate, int32_t *deviation)
{
    (void)dt;
    if (deviation) {
        *deviation = {{ upper }}_UNKNOWN;
    }
    if (reading == {{ upper }}_UNKNOWN) {
        *estimate = s->estimate;
        return {{ upper }}_INVALID;
    }
    int status;
    int32_t z = reading;
    uint8_t clipped = 0, beyond = 0;
    if (z < {{ floor }}) {
        z = {{ floor }};
        beyond = 1;
    }
    if (z > {{ ceiling }}) {
        z = {{ ceiling }};
        beyond = 1;
    }
    clipped = reading < {{ low_limit }} || reading > {{ high_limit }};
    uint8_t rising = z > s->z;
    if (z != s->z && rising != s->rising) {
        if (s->depth >= {{ upper }}_DEPTH) {
            s->depth = ({{ count }})(s->depth - 2);
        }
        s->extremum[s->depth] = s->u;
        s->level[s->depth] = s->z;
        s->depth = ({{ count }})(s->depth + 1);
        s->rising = rising;
    }
    if (s->rising) {
        while (s->depth >= 3 && z > s->level[s->depth - 2]) { /* at most: depth / 2 */
            s->depth = ({{ count }})(s->depth - 2);
        }
    } else {
        while (s->depth >= 3 && z < s->level[s->depth - 2]) { /* at most: depth / 2 */
            s->depth = ({{ count }})(s->depth - 2);
        }
    }
    int32_t u = {{ stem }}_solve(s, z, &status);
    if (z != s->z) {
        s->u = u;
    }
    s->z = z;
    u = s->u;
    if (beyond) {
        status = {{ upper }}_{{ "EXTRAPOLATED" if goes_on else "SATURATED" }};
        if (reading >= {{ known[0] }} && reading <= {{ known[1] }}) { /* known all the same */
            status = {{ upper }}_OK;
        }
    }
{% if guard %}
{% if guard.ends %}
    /* At an end of the trained inputs all relays that these reach are one way. */
    s->known = (uint8_t)(s->known | (u <= {{ guard.bottom }} ? 1 : 0) | (u >= {{ guard.top }} ? 2 : 0));
{% endif %}
    if (status == {{ upper }}_OK || status == {{ upper }}_FLAT) {
{% if guard.ends %}
        if ((s->known & {{ guard.ends }}) != {{ guard.ends }}) {
            status = {{ upper }}_RUN_IN;
        }
{% endif %}
        if (clipped || u < {{ guard.low }} - {{ guard.rounding }} || u > {{ guard.high }} + {{ guard.rounding }}) {
            status = {{ upper }}_EXTRAPOLATED;
        }
    }
    u = u < {{ guard.low }} ? {{ guard.low }} : u;
    u = u > {{ guard.high }} ? {{ guard.high }} : u;
{% else %}
    if (clipped && status == {{ upper }}_OK) {
        status = {{ upper }}_EXTRAPOLATED;
    }
{% endif %}
    s->estimate = u;
    *estimate = u;
    return status;
}

/* How many of {{ golden }} readings give estimates that are {{ tolerance }} or more off; the state is reset. */
static inline int {{ stem }}_self_test({{ stem }}_state *s)
{
    static const int32_t reading[{{ golden }}] {{ upper }}_TABLE = {
        {{ golden_readings }}
    };
    static const int32_t value[{{ golden }}] {{ upper }}_TABLE = {
        {{ golden_values }}
    };
    int wrong = 0;
    {{ stem }}_reset(s);
    for (int k = 0; k < {{ golden }}; ++k) {
        int32_t estimate;
        (void){{ stem }}_step(s, 0, {{ upper }}_AT(reading, k), &estimate, 0);
        int32_t off = estimate - {{ upper }}_AT(value, k);
        wrong += off >= {{ tolerance }} || off <= -{{ tolerance }};
    }
    {{ stem }}_reset(s);
    return wrong;
}

#endif /* {{ upper }}_H */
