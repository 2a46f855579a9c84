/* FMI 2.0 for co-simulation on `core.h`. Types and signatures are those of the standard. */

#include "core.h"

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef int fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    Core core;
    fmi2CallbackFunctions callbacks;
    char name[128];
} Unit;

static fmi2Status told(Unit *unit, const char *wrong) {
    if (wrong == NULL) return fmi2OK;
    if (unit->callbacks.logger != NULL) {
        unit->callbacks.logger(unit->callbacks.componentEnvironment, unit->name, fmi2Error, "logStatusError", "%s", wrong);
    }
    return fmi2Error;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)c, (void)on, (void)count, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Unit *unit;
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || name == NULL || token == NULL || strcmp(token, UNIT_TOKEN) != 0) return NULL;
    unit = calloc(1, sizeof(Unit));
    if (unit == NULL) return NULL;
    core_reset(&unit->core);
    if (callbacks != NULL) unit->callbacks = *callbacks;
    strncpy(unit->name, name, sizeof(unit->name) - 1);
    return unit;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean ends, fmi2Real stop) {
    (void)tolerant, (void)tolerance, (void)ends, (void)stop;
    ((Unit *)c)->core.time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    core_fill(&((Unit *)c)->core);
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    core_initialise(&((Unit *)c)->core);
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    core_reset(&((Unit *)c)->core);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[]) {
    Unit *unit = c;
    size_t i;
    for (i = 0; i < count; i++) {
        if (!core_known(vr[i], 0)) return told(unit, "no real variable has this reference");
        value[i] = unit->core.value[vr[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Boolean value[]) {
    Unit *unit = c;
    size_t i;
    for (i = 0; i < count; i++) {
        if (!core_known(vr[i], 1)) return told(unit, "no Boolean variable has this reference");
        value[i] = unit->core.value[vr[i]] != 0.0;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[]) {
    Unit *unit = c;
    fmi2Status status = fmi2OK;
    size_t i;
    for (i = 0; i < count && status == fmi2OK; i++) status = told(unit, core_set(&unit->core, vr[i], value[i], 0));
    return status;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                 const fmi2Boolean value[]) {
    Unit *unit = c;
    fmi2Status status = fmi2OK;
    size_t i;
    for (i = 0; i < count && status == fmi2OK; i++) status = told(unit, core_set(&unit->core, vr[i], value[i] != 0, 1));
    return status;
}

#define NONE_OF(TYPE, CONST)                                                                                    \
    EXPORT fmi2Status fmi2##CONST(fmi2Component c, const fmi2ValueReference vr[], size_t count, TYPE value[]) { \
        (void)vr, (void)value;                                                                                  \
        return count == 0 ? fmi2OK : told(c, "there is no variable of this type");                              \
    }

NONE_OF(fmi2Integer, GetInteger)
NONE_OF(fmi2String, GetString)
NONE_OF(const fmi2Integer, SetInteger)
NONE_OF(const fmi2String, SetString)

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(sizeof(Core));
    if (*state == NULL) return told(c, "there is no memory for a state");
    memcpy(*state, &((Unit *)c)->core, sizeof(Core));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(&((Unit *)c)->core, state, sizeof(Core));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Core);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(Core)) return told(c, "the buffer is too small for a state");
    memcpy(bytes, state, sizeof(Core));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(Core)) return told(c, "these bytes are no state of this unit");
    if (*state == NULL) *state = malloc(sizeof(Core));
    if (*state == NULL) return told(c, "there is no memory for a state");
    memcpy(*state, bytes, sizeof(Core));
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                               const fmi2ValueReference known[], size_t knowns, const fmi2Real dk[],
                                               fmi2Real du[]) {
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)dk, (void)du;
    return told(c, "directional derivatives are not provided");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                              const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return count == 0 ? fmi2OK : told(c, "inputs are held within a step");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                               const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    return count == 0 ? fmi2OK : told(c, "derivatives of outputs are not provided");
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean no_return) {
    Unit *unit = c;
    (void)no_return;
    if (fabs(now - unit->core.time) > 1e-6) return told(unit, "the step does not begin where the last one ended");
    return told(unit, core_step(&unit->core, step));
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { return told(c, "no step is under way: steps are not asynchronous"); }

#define NO_STATUS(TYPE, NAME)                                                              \
    EXPORT fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2StatusKind s, TYPE *value) { \
        (void)c, (void)s, (void)value;                                                     \
        return fmi2Discard;                                                                \
    }

NO_STATUS(fmi2Status, Status)
NO_STATUS(fmi2Real, RealStatus)
NO_STATUS(fmi2Integer, IntegerStatus)
NO_STATUS(fmi2Boolean, BooleanStatus)
NO_STATUS(fmi2String, StringStatus)
