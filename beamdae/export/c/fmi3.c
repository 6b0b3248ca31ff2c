/* FMI 3.0 Co-Simulation interface of an exported model. */

#include "fmi3Functions.h"
#include "model.h"
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

static fmi3Status check(const Component *c, const char *message) {
    return message ? report(c, message) : fmi3OK;
}

static fmi3Status check_code(const Component *c, int code) {
    return check(c, code == 0 ? NULL : instance_message(c->instance));
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n,
                               const fmi3String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const Reference intermediate[], size_t n_intermediate, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)event_mode;
    (void)early_return, (void)intermediate, (void)n_intermediate, (void)update;
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
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log) log(environment, fmi3Error, "logStatusError", "The FMU supports co-simulation only.");
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    (void)clock, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

void fmi3FreeInstance(fmi3Instance instance) {
    Component *c = instance;
    if (!c) return;
    instance_free(c->instance);
    free(c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean with_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean with_stop, fmi3Float64 stop) {
    Component *c = instance;
    (void)with_tolerance, (void)tolerance;
    const char *message = set_experiment(c->instance, start, with_stop, stop);
    return check(c, message ? message : enter_initialization(c->instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    Component *c = instance;
    return check(c, exit_initialization(c->instance));
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    Component *c = instance;
    return check_code(c, instance_reset(c->instance));
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const Reference vr[], size_t n,
                          fmi3Float64 value[], size_t n_values) {
    Component *c = instance;
    if (n_values != n) return report(c, "All variables are scalar.");
    return check(c, get_variables(c->instance, vr, n, value, 1));
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const Reference vr[], size_t n,
                          const fmi3Float64 value[], size_t n_values) {
    Component *c = instance;
    if (n_values != n) return report(c, "All variables are scalar.");
    return check(c, set_variables(c->instance, vr, n, value));
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    Component *c = instance;
    return check(c, copy_state(c->instance, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    Component *c = instance;
    return check(c, restore_state(c->instance, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    (void)c;
    free_state(state);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    Component *c = instance;
    (void)state;
    *size = serialized_size(c->instance);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    Component *c = instance;
    return check(c, serialize_state(c->instance, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    Component *c = instance;
    return check(c, deserialize_state(c->instance, bytes, size, state));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const Reference unknowns[],
                                        size_t n_unknowns, const Reference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 result[], size_t n_result) {
    Component *c = instance;
    if (n_seed != n_knowns || n_result != n_unknowns)
        return report(c, "All variables are scalar.");
    return check(c, get_directional_derivative(c->instance, unknowns, n_unknowns, knowns, n_knowns,
                                               seed, result));
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 step,
                      fmi3Boolean no_set_state, fmi3Boolean *event_handling,
                      fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_time) {
    Component *c = instance;
    (void)no_set_state;
    *event_handling = *terminate = *early_return = fmi3False;
    const char *message = do_step(c->instance, t, step);
    *last_time = instance_time(c->instance);
    return check(c, message);
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

fmi3Status fmi3Terminate(fmi3Instance instance) {
    Component *c = instance;
    return check(c, terminate(c->instance));
}

#define VARIABLES(Type)                                                                            \
    fmi3Status fmi3Get##Type(fmi3Instance c, const Reference vr[], size_t n, fmi3##Type value[],   \
                             size_t n_values) {                                                    \
        (void)vr, (void)value, (void)n_values;                                                     \
        return empty(c, n);                                                                        \
    }                                                                                              \
    fmi3Status fmi3Set##Type(fmi3Instance c, const Reference vr[], size_t n,                       \
                             const fmi3##Type value[], size_t n_values) {                          \
        (void)vr, (void)value, (void)n_values;                                                     \
        return empty(c, n);                                                                        \
    }

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

#define UNSUPPORTED(name, parameters, unused)                                                      \
    fmi3Status name parameters {                                                                   \
        unused;                                                                                    \
        return unsupported(c);                                                                     \
    }
#define UNUSED2(a, b) (void)a, (void)b
#define UNUSED3(a, b, d) (void)a, (void)b, (void)d

fmi3Status fmi3GetBinary(fmi3Instance c, const Reference vr[], size_t n, size_t sizes[],
                         fmi3Binary value[], size_t n_values) {
    (void)vr, (void)sizes, (void)value, (void)n_values;
    return empty(c, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const Reference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary value[], size_t n_values) {
    (void)vr, (void)sizes, (void)value, (void)n_values;
    return empty(c, n);
}

fmi3Status fmi3GetClock(fmi3Instance c, const Reference vr[], size_t n, fmi3Clock value[]) {
    (void)vr, (void)value;
    return empty(c, n);
}

fmi3Status fmi3SetClock(fmi3Instance c, const Reference vr[], size_t n, const fmi3Clock value[]) {
    (void)vr, (void)value;
    return empty(c, n);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *with_time, fmi3Float64 *time) {
    (void)time;
    *update = *terminate = *nominals = *values = *with_time = fmi3False;
    return unsupported(c);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const Reference unknowns[], size_t n_unknowns,
                                    const Reference knowns[], size_t n_knowns,
                                    const fmi3Float64 seed[], size_t n_seed, fmi3Float64 result[],
                                    size_t n_result) {
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns;
    (void)seed, (void)n_seed, (void)result, (void)n_result;
    return unsupported(c);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, Reference dependent, size_t elements[],
                                       Reference independents[], size_t of_independents[],
                                       fmi3DependencyKind kinds[], size_t n) {
    (void)dependent, (void)elements, (void)independents, (void)of_independents, (void)kinds;
    (void)n;
    return unsupported(c);
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const Reference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void)vr, (void)intervals, (void)qualifiers;
    return empty(c, n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const Reference vr[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    return empty(c, n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const Reference vr[], size_t n,
                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    return empty(c, n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const Reference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    return empty(c, n);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const Reference vr[], size_t n,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)vr, (void)counters, (void)resolutions;
    return empty(c, n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const Reference vr[], size_t n,
                               fmi3Float64 shifts[]) {
    (void)vr, (void)shifts;
    return empty(c, n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const Reference vr[], size_t n,
                                  const fmi3Float64 intervals[]) {
    (void)vr, (void)intervals;
    return empty(c, n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const Reference vr[], size_t n,
                               const fmi3Float64 shifts[]) {
    (void)vr, (void)shifts;
    return empty(c, n);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const Reference vr[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t n_values) {
    (void)vr, (void)n, (void)orders, (void)values, (void)n_values;
    return unsupported(c);
}

UNSUPPORTED(fmi3GetNumberOfVariableDependencies, (fmi3Instance c, Reference vr, size_t *n),
            UNUSED2(vr, n))
UNSUPPORTED(fmi3CompletedIntegratorStep,
            (fmi3Instance c, fmi3Boolean no_set_state, fmi3Boolean *event, fmi3Boolean *terminate),
            UNUSED3(no_set_state, event, terminate))
UNSUPPORTED(fmi3SetTime, (fmi3Instance c, fmi3Float64 time), (void)time)
UNSUPPORTED(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 x[], size_t n),
            UNUSED2(x, n))
UNSUPPORTED(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 x[], size_t n),
            UNUSED2(x, n))
UNSUPPORTED(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 x[], size_t n), UNUSED2(x, n))
UNSUPPORTED(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 x[], size_t n), UNUSED2(x, n))
UNSUPPORTED(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 x[], size_t n),
            UNUSED2(x, n))
UNSUPPORTED(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *n), (void)n)
UNSUPPORTED(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *n), (void)n)
UNSUPPORTED(fmi3ActivateModelPartition, (fmi3Instance c, Reference clock, fmi3Float64 time),
            UNUSED2(clock, time))
