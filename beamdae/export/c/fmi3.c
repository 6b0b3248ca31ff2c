/* FMI 3.0 Co-Simulation interface of an exported model. */

#include "fmi3Functions.h"
#include "variables.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance *instance;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Component;

typedef fmi3ValueReference Reference;

static fmi3Status report(const Component *c, const char *message) {
    if (c && c->log) c->log(c->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static fmi3Status check(const Component *c, int code) {
    return code ? report(c, c->instance->message) : fmi3OK;
}

static Instance *instance_of(fmi3Instance c) { return ((Component *)c)->instance; }

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n,
                               const fmi3String categories[]) {
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const Reference intermediate[], size_t n_intermediate, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    Component *c = calloc(1, sizeof(Component));
    if (!c) return NULL;
    c->environment = environment;
    c->log = log;
    if (!token || strcmp(token, model_token)) {
        report(c, "The instantiation token is not that of the model description of this FMU.");
    } else if (!(c->instance = instance_create())) {
        report(c, "Out of memory.");
    } else {
        return c;
    }
    fmi3FreeInstance(c);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    if (log) log(environment, fmi3Error, "logStatusError", "The FMU supports co-simulation only.");
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

void fmi3FreeInstance(fmi3Instance instance) {
    Component *c = instance;
    if (!c) return;
    instance_free(c->instance);
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean with_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean with_stop, fmi3Float64 stop) {
    if (set_experiment(instance_of(c), start, with_stop, stop)) return check(c, -1);
    return check(c, enter_initialization(instance_of(c)));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return check(c, exit_initialization(instance_of(c)));
}

fmi3Status fmi3Reset(fmi3Instance c) {
    return check(c, instance_reset(instance_of(c)));
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const Reference vr[], size_t n,
                          fmi3Float64 value[], size_t n_values) {
    if (n_values != n) return report(c, "All variables are scalar.");
    return check(c, get_variables(instance_of(c), vr, n, value, 1));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const Reference vr[], size_t n,
                          const fmi3Float64 value[], size_t n_values) {
    if (n_values != n) return report(c, "All variables are scalar.");
    return check(c, set_variables(instance_of(c), vr, n, value));
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    return check(c, copy_state(instance_of(c), state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    return check(c, restore_state(instance_of(c), state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    free_state(state);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    *size = serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    return check(c, serialize_state(instance_of(c), state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    return check(c, deserialize_state(instance_of(c), bytes, size, state));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const Reference unknowns[],
                                        size_t n_unknowns, const Reference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 result[], size_t n_result) {
    if (n_seed != n_knowns || n_result != n_unknowns)
        return report(c, "All variables are scalar.");
    return check(c, get_directional_derivative(instance_of(c), unknowns, n_unknowns, knowns,
                                               n_knowns, seed, result));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 step,
                      fmi3Boolean no_set_state, fmi3Boolean *event_handling,
                      fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_time) {
    *event_handling = *terminate = *early_return = fmi3False;
    const int code = do_step(instance_of(c), t, step);
    *last_time = instance_time(instance_of(c));
    return check(c, code);
}

/* Functions without effect, and functions of features that the FMU does not have. */

static fmi3Status empty(fmi3Instance c, size_t n) {
    return n == 0 ? fmi3OK : report(c, "All variables are of type Float64.");
}

static fmi3Status unsupported(fmi3Instance c) {
    return report(c, "The FMU does not support this function.");
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return unsupported(c); }
fmi3Status fmi3EnterStepMode(fmi3Instance c) { return unsupported(c); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return unsupported(c); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return unsupported(c); }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return unsupported(c); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return unsupported(c); }

fmi3Status fmi3Terminate(fmi3Instance c) {
    return check(c, terminate(instance_of(c)));
}

#define UNSUPPORTED(name, ...)                                                                     \
    fmi3Status name(fmi3Instance c, __VA_ARGS__) { return unsupported(c); }
/* Of n variables, with further parameters. */
#define EMPTY(name, ...)                                                                           \
    fmi3Status name(fmi3Instance c, const Reference vr[], size_t n, __VA_ARGS__) {                 \
        return empty(c, n);                                                                        \
    }
#define VARIABLES(Type)                                                                            \
    EMPTY(fmi3Get##Type, fmi3##Type value[], size_t n_values)                                      \
    EMPTY(fmi3Set##Type, const fmi3##Type value[], size_t n_values)

VARIABLES(Float32)
VARIABLES(Int8)
VARIABLES(UInt8)
VARIABLES(Int16)
VARIABLES(UInt16)
VARIABLES(Int32)
VARIABLES(UInt32)
VARIABLES(Int64)
VARIABLES(UInt64)
VARIABLES(Boolean)
VARIABLES(String)

EMPTY(fmi3GetBinary, size_t sizes[], fmi3Binary value[], size_t n_values)
EMPTY(fmi3SetBinary, const size_t sizes[], const fmi3Binary value[], size_t n_values)
EMPTY(fmi3GetClock, fmi3Clock value[])
EMPTY(fmi3SetClock, const fmi3Clock value[])

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *with_time, fmi3Float64 *time) {
    *update = *terminate = *nominals = *values = *with_time = fmi3False;
    return unsupported(c);
}

UNSUPPORTED(fmi3GetAdjointDerivative, const Reference unknowns[], size_t n_unknowns,
            const Reference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
            fmi3Float64 result[], size_t n_result)
UNSUPPORTED(fmi3GetVariableDependencies, Reference dependent, size_t elements[],
            Reference independents[], size_t of_independents[], fmi3DependencyKind kinds[],
            size_t n)
EMPTY(fmi3GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
EMPTY(fmi3GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
      fmi3IntervalQualifier qualifiers[])
EMPTY(fmi3GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
EMPTY(fmi3SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
EMPTY(fmi3SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
EMPTY(fmi3GetShiftDecimal, fmi3Float64 shifts[])
EMPTY(fmi3SetIntervalDecimal, const fmi3Float64 intervals[])
EMPTY(fmi3SetShiftDecimal, const fmi3Float64 shifts[])
UNSUPPORTED(fmi3GetOutputDerivatives, const Reference vr[], size_t n, const fmi3Int32 orders[],
            fmi3Float64 values[], size_t n_values)
UNSUPPORTED(fmi3GetNumberOfVariableDependencies, Reference vr, size_t *n)
UNSUPPORTED(fmi3CompletedIntegratorStep, fmi3Boolean no_set_state, fmi3Boolean *event,
            fmi3Boolean *terminate)
UNSUPPORTED(fmi3SetTime, fmi3Float64 time)
UNSUPPORTED(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n)
UNSUPPORTED(fmi3GetContinuousStateDerivatives, fmi3Float64 x[], size_t n)
UNSUPPORTED(fmi3GetEventIndicators, fmi3Float64 x[], size_t n)
UNSUPPORTED(fmi3GetContinuousStates, fmi3Float64 x[], size_t n)
UNSUPPORTED(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n)
UNSUPPORTED(fmi3GetNumberOfEventIndicators, size_t *n)
UNSUPPORTED(fmi3GetNumberOfContinuousStates, size_t *n)
UNSUPPORTED(fmi3ActivateModelPartition, Reference clock, fmi3Float64 time)
