/* FMI 3.0 for co-simulation on `core.h`. Types and signatures are those of the standard. */

#include <stdbool.h>
#include <stdint.h>

#include "core.h"

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef uint8_t fmi3Byte;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);

enum { TIME = VARIABLES };

typedef struct {
    Core core;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Unit;

static fmi3Status told(Unit *unit, const char *wrong) {
    if (wrong == NULL) return fmi3OK;
    if (unit != NULL && unit->log != NULL) unit->log(unit->environment, fmi3Error, "logStatusError", wrong);
    return fmi3Error;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t count, const fmi3String categories[]) {
    (void)i, (void)on, (void)count, (void)categories;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, void *update) {
    Unit *unit;
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)intermediate;
    (void)intermediates, (void)update;
    if (name == NULL || token == NULL || strcmp(token, UNIT_TOKEN) != 0) return NULL;
    unit = calloc(1, sizeof(Unit));
    if (unit == NULL) return NULL;
    core_reset(&unit->core);
    unit->log = log;
    unit->environment = environment;
    return unit;
}

/* Other kinds of simulation there are none of; what else is passed is not looked at. */
EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name) {
    (void)name;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name) {
    (void)name;
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance i) { free(i); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean tolerant, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop) {
    Unit *unit = i;
    (void)tolerant, (void)tolerance, (void)ends, (void)stop;
    unit->core.time = start;
    core_fill(&unit->core);
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance i) {
    core_initialise(&((Unit *)i)->core);
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance i) {
    (void)i;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance i) {
    (void)i;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance i) {
    core_reset(&((Unit *)i)->core);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference vr[], size_t count, fmi3Float64 value[],
                                 size_t values) {
    Unit *unit = i;
    size_t k;
    if (values != count) return told(unit, "every variable has one value");
    for (k = 0; k < count; k++) {
        if (vr[k] != TIME && !core_known(vr[k], 0)) return told(unit, "no Float64 variable has this reference");
        value[k] = vr[k] == TIME ? unit->core.time : unit->core.value[vr[k]];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance i, const fmi3ValueReference vr[], size_t count, fmi3Boolean value[],
                                 size_t values) {
    Unit *unit = i;
    size_t k;
    if (values != count) return told(unit, "every variable has one value");
    for (k = 0; k < count; k++) {
        if (!core_known(vr[k], 1)) return told(unit, "no Boolean variable has this reference");
        value[k] = unit->core.value[vr[k]] != 0.0;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference vr[], size_t count,
                                 const fmi3Float64 value[], size_t values) {
    Unit *unit = i;
    fmi3Status status = values == count ? fmi3OK : told(unit, "every variable has one value");
    size_t k;
    for (k = 0; k < count && status == fmi3OK; k++) status = told(unit, core_set(&unit->core, vr[k], value[k], 0));
    return status;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance i, const fmi3ValueReference vr[], size_t count,
                                 const fmi3Boolean value[], size_t values) {
    Unit *unit = i;
    fmi3Status status = values == count ? fmi3OK : told(unit, "every variable has one value");
    size_t k;
    for (k = 0; k < count && status == fmi3OK; k++) status = told(unit, core_set(&unit->core, vr[k], value[k], 1));
    return status;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *state) {
    if (*state == NULL) *state = malloc(sizeof(Core));
    if (*state == NULL) return told(i, "there is no memory for a state");
    memcpy(*state, &((Unit *)i)->core, sizeof(Core));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState state) {
    memcpy(&((Unit *)i)->core, state, sizeof(Core));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *state) {
    (void)i;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState state, size_t *size) {
    (void)i, (void)state;
    *size = sizeof(Core);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size < sizeof(Core)) return told(i, "the buffer is too small for a state");
    memcpy(bytes, state, sizeof(Core));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    if (size != sizeof(Core)) return told(i, "these bytes are no state of this unit");
    if (*state == NULL) *state = malloc(sizeof(Core));
    if (*state == NULL) return told(i, "there is no memory for a state");
    memcpy(*state, bytes, sizeof(Core));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 now, fmi3Float64 step, fmi3Boolean no_return,
                             fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    Unit *unit = i;
    fmi3Status status;
    (void)no_return;
    *event = *terminate = *early = false;
    if (fabs(now - unit->core.time) > 1e-6) return told(unit, "the step does not begin where the last one ended");
    status = told(unit, core_step(&unit->core, step));
    *last = unit->core.time;
    return status;
}

/* A function of variables of a type that there are none of: right for no variables at all. */
#define NONE_OF(TYPE)                                                                                          \
    EXPORT fmi3Status fmi3Get##TYPE(fmi3Instance i, const fmi3ValueReference vr[], size_t count) {             \
        (void)vr;                                                                                              \
        return count == 0 ? fmi3OK : told(i, "there is no variable of this type");                             \
    }                                                                                                          \
    EXPORT fmi3Status fmi3Set##TYPE(fmi3Instance i, const fmi3ValueReference vr[], size_t count) {             \
        (void)vr;                                                                                              \
        return count == 0 ? fmi3OK : told(i, "there is no variable of this type");                             \
    }

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(Int32)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(String)
NONE_OF(Binary)
NONE_OF(Clock)

/* A function that this kind of unit has not, whatever it is given. */
#define NOT_PROVIDED(NAME) \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance i) { return told(i, "fmi3" #NAME " is not provided"); }

NOT_PROVIDED(EnterEventMode)
NOT_PROVIDED(GetNumberOfVariableDependencies)
NOT_PROVIDED(GetVariableDependencies)
NOT_PROVIDED(GetDirectionalDerivative)
NOT_PROVIDED(GetAdjointDerivative)
NOT_PROVIDED(EnterConfigurationMode)
NOT_PROVIDED(ExitConfigurationMode)
NOT_PROVIDED(GetIntervalDecimal)
NOT_PROVIDED(GetIntervalFraction)
NOT_PROVIDED(GetShiftDecimal)
NOT_PROVIDED(GetShiftFraction)
NOT_PROVIDED(SetIntervalDecimal)
NOT_PROVIDED(SetIntervalFraction)
NOT_PROVIDED(SetShiftDecimal)
NOT_PROVIDED(SetShiftFraction)
NOT_PROVIDED(EvaluateDiscreteStates)
NOT_PROVIDED(UpdateDiscreteStates)
NOT_PROVIDED(EnterContinuousTimeMode)
NOT_PROVIDED(CompletedIntegratorStep)
NOT_PROVIDED(SetTime)
NOT_PROVIDED(SetContinuousStates)
NOT_PROVIDED(GetContinuousStateDerivatives)
NOT_PROVIDED(GetEventIndicators)
NOT_PROVIDED(GetContinuousStates)
NOT_PROVIDED(GetNominalsOfContinuousStates)
NOT_PROVIDED(GetNumberOfEventIndicators)
NOT_PROVIDED(GetNumberOfContinuousStates)
NOT_PROVIDED(GetOutputDerivatives)
NOT_PROVIDED(ActivateModelPartition)
