/* The state of a unit and a second of it; both versions of the interface stand on this.

   `unit.h`, made for each station, has UNIT_TOKEN, UNIT_NAME, BUFFER_VOLUMES, STARTS, PRESSURE_MAX, TEMPERATURE_MAX,
   VOLUME_MAX and the two functions of the plant:
   `second` (state, valves, volume of the vehicle's tank -> state, flows) and `held` (pressure, temperature, volume ->
   mass), whose arithmetic is that of station/plants/thesis.py. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum {
    OUTLETS = 3, VEHICLE = 6, BOOLEANS = 7, START_PRESSURE = 7, START_TEMPERATURE = 8, VOLUME = 9, PRESSURE = 10,
    TEMPERATURE = 14, MASS = 18, COMPRESSED = 22, DISPENSED = 23, INITIAL_PRESSURE = 24, INITIAL_TEMPERATURE = 27,
    VARIABLES = 30, TANKS = 4, BUFFERS = 3, STATES = 12
};

typedef struct {
    double value[VARIABLES];
    double state[STATES]; /* pressures, temperatures, masses */
    double volume;
    double time;
    int connected;
    int initialised;
} Core;

#define TEXT_OF(number) #number
#define TEXT(name) TEXT_OF(name)

/* False of what is not a number, too. */
static int is_pressure(double value) { return value > 0.0 && value <= PRESSURE_MAX; }
static int is_temperature(double value) { return value > -273.15 && value <= TEMPERATURE_MAX; }
static int is_volume(double value) { return value > 0.0 && value <= VOLUME_MAX; }

static double mass_held(double pressure, double temperature, double volume) {
    const double *arg[HELD_SZ_ARG];
    double found = 0.0, *res[HELD_SZ_RES], w[HELD_SZ_W];
    long long int iw[HELD_SZ_IW];
    arg[0] = &pressure;
    arg[1] = &temperature;
    arg[2] = &volume;
    res[0] = &found;
    held(arg, res, iw, w, 0);
    return found;
}

static void core_show(Core *core) {
    int tank;
    for (tank = 0; tank < TANKS; tank++) {
        int there = tank < BUFFERS || core->connected;
        core->value[PRESSURE + tank] = there ? core->state[tank] : 0.0;
        core->value[TEMPERATURE + tank] = there ? core->state[TANKS + tank] : 0.0;
        core->value[MASS + tank] = there ? core->state[2 * TANKS + tank] : 0.0;
    }
}

static void core_begin(Core *core, int tank, double pressure, double temperature, double volume) {
    core->state[tank] = pressure;
    core->state[TANKS + tank] = temperature;
    core->state[2 * TANKS + tank] = mass_held(pressure, temperature, volume);
}

/* Fill the buffers with their initial values. */
static void core_fill(Core *core) {
    static const double volumes[BUFFERS] = BUFFER_VOLUMES;
    int buffer;
    for (buffer = 0; buffer < BUFFERS; buffer++) {
        core_begin(core, buffer, core->value[INITIAL_PRESSURE + buffer], core->value[INITIAL_TEMPERATURE + buffer],
                   volumes[buffer]);
    }
    core_show(core);
}

static void core_initialise(Core *core) {
    core_fill(core);
    core->initialised = 1;
}

static void core_reset(Core *core) {
    static const double starts[VARIABLES] = STARTS;
    memset(core, 0, sizeof(Core));
    memcpy(core->value, starts, sizeof(starts));
}

/* Connect or let go what the input `vehicle` says; what is wrong with the vehicle that begins, or NULL. */
static const char *core_connect(Core *core) {
    if (core->value[VEHICLE] == 0.0) {
        core->connected = 0;
        return NULL;
    }
    if (core->connected) return NULL;
    if (!is_volume(core->value[VOLUME])) {
        return "vehicle_volume must be above 0 m3, and at most " TEXT(VOLUME_MAX) ", where a vehicle begins";
    }
    if (!is_pressure(core->value[START_PRESSURE])) {
        return "vehicle_start_pressure must be above 0 bar, and at most " TEXT(PRESSURE_MAX) ", where a vehicle begins";
    }
    if (!is_temperature(core->value[START_TEMPERATURE])) {
        return "vehicle_start_temperature must be above -273.15 degC, and at most " TEXT(TEMPERATURE_MAX);
    }
    core->volume = core->value[VOLUME];
    core_begin(core, BUFFERS, core->value[START_PRESSURE], core->value[START_TEMPERATURE], core->volume);
    core->connected = 1;
    return NULL;
}

static void core_second(Core *core) {
    double valves[2 * BUFFERS], next[STATES], flows[2], *res[SECOND_SZ_RES], w[SECOND_SZ_W];
    const double *arg[SECOND_SZ_ARG];
    long long int iw[SECOND_SZ_IW];
    int place;
    for (place = 0; place < 2 * BUFFERS; place++) {
        int may = place < OUTLETS || core->connected; /* nobody is there to be given gas */
        valves[place] = may && core->value[place] != 0.0 ? 1.0 : 0.0;
    }
    arg[0] = core->state;
    arg[1] = valves;
    arg[2] = &core->volume;
    res[0] = next;
    res[1] = flows;
    second(arg, res, iw, w, 0);
    for (place = 0; place < STATES; place++) {
        if (place % TANKS < BUFFERS || core->connected) core->state[place] = next[place];
    }
    core->value[COMPRESSED] = flows[0];
    core->value[DISPENSED] = flows[1];
    core->time += 1.0;
}

/* Advance by a step of whole seconds; what is wrong, or NULL. */
static const char *core_step(Core *core, double step) {
    double seconds = floor(step + 0.5);
    const char *wrong;
    if (!core->initialised) return "the unit is not initialised";
    if (!(seconds >= 1.0) || fabs(step - seconds) > 1e-9 * seconds) {
        return "a step must be whole seconds, 1 or more: the sampling period of the plant";
    }
    if (seconds > 1e9) return "a step must be at most 1000000000 s"; /* beyond 2^53 no end would come */
    wrong = core_connect(core);
    if (wrong != NULL) return wrong;
    for (; seconds > 0.0; seconds -= 1.0) core_second(core);
    core_show(core);
    return NULL;
}

/* Set a variable; what is wrong, or NULL. */
static const char *core_set(Core *core, unsigned int reference, double value, int boolean) {
    if (reference >= VARIABLES || (reference < BOOLEANS) != boolean) return "no variable of this type has this reference";
    if (reference >= PRESSURE && reference < INITIAL_PRESSURE) return "an output cannot be set";
    if (reference >= INITIAL_PRESSURE) {
        if (core->initialised) return "an initial value cannot be set any more";
        if (reference < INITIAL_TEMPERATURE && !is_pressure(value)) {
            return "an initial pressure must be above 0 bar, and at most " TEXT(PRESSURE_MAX);
        }
        if (reference >= INITIAL_TEMPERATURE && !is_temperature(value)) {
            return "an initial temperature must be above -273.15 degC, and at most " TEXT(TEMPERATURE_MAX);
        }
    }
    if (reference == VEHICLE && value == 0.0) core->connected = 0; /* another may begin before the next step */
    core->value[reference] = value;
    return NULL;
}

static int core_known(unsigned int reference, int boolean) {
    return reference < VARIABLES && (reference < BOOLEANS) == boolean;
}
