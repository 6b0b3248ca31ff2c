/* FMI 2.0 Co-Simulation interface of an exported model. */

#include "fmi2Functions.h"
#include "variables.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance *instance;
    char *name;
    fmi2CallbackFunctions callbacks;
} Component;

static fmi2Status report(const Component *c, const char *message) {
    if (c->callbacks.logger)
        c->callbacks.logger(c->callbacks.componentEnvironment, c->name, fmi2Error, "logStatusError",
                            "%s", message);
    return fmi2Error;
}

static fmi2Status check(const Component *c, int code) {
    return code ? report(c, c->instance->message) : fmi2OK;
}

static Instance *instance_of(fmi2Component c) { return ((Component *)c)->instance; }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                               const fmi2String categories[]) {
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    Component *c = calloc(1, sizeof(Component));
    if (!c) return NULL;
    if (callbacks) c->callbacks = *callbacks;
    c->name = malloc(strlen(name ? name : "") + 1);
    if (c->name) strcpy(c->name, name ? name : "");
    if (type != fmi2CoSimulation) {
        report(c, "The FMU supports co-simulation only.");
    } else if (!guid || strcmp(guid, model_token)) {
        report(c, "The GUID is not that of the model description of this FMU.");
    } else if (!c->name || !(c->instance = instance_create())) {
        report(c, "Out of memory.");
    } else {
        return c;
    }
    fmi2FreeInstance(c);
    return NULL;
}

void fmi2FreeInstance(fmi2Component instance) {
    Component *c = instance;
    if (!c) return;
    instance_free(c->instance);
    free(c->name);
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean with_tolerance,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop,
                               fmi2Real stop) {
    return check(c, set_experiment(instance_of(c), start, with_stop, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return check(c, enter_initialization(instance_of(c)));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return check(c, exit_initialization(instance_of(c)));
}

fmi2Status fmi2Terminate(fmi2Component c) {
    return check(c, terminate(instance_of(c)));
}

fmi2Status fmi2Reset(fmi2Component c) {
    return check(c, instance_reset(instance_of(c)));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       fmi2Real value[]) {
    return check(c, get_variables(instance_of(c), vr, n, value, 0));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    return check(c, set_variables(instance_of(c), vr, n, value));
}

#define NO_VARIABLES(type, Type)                                                                   \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             type value[]) {                                                       \
        return n == 0 ? fmi2OK : report(c, "All variables are of type Real.");                     \
    }                                                                                              \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const type value[]) {                                                 \
        return n == 0 ? fmi2OK : report(c, "All variables are of type Real.");                     \
    }

NO_VARIABLES(fmi2Integer, Integer)
NO_VARIABLES(fmi2Boolean, Boolean)
NO_VARIABLES(fmi2String, String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return check(c, copy_state(instance_of(c), state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return check(c, restore_state(instance_of(c), state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    free_state(state);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    return check(c, serialize_state(instance_of(c), state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    return check(c, deserialize_state(instance_of(c), bytes, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c,
                                        const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns,
                                        const fmi2Real seed[], fmi2Real result[]) {
    return check(c, get_directional_derivative(instance_of(c), unknowns, n_unknowns, knowns,
                                               n_knowns, seed, result));
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    return n == 0 ? fmi2OK : report(c, "Inputs are constant during a step.");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    return n == 0 ? fmi2OK : report(c, "Time derivatives of outputs are not available.");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no_set_state) {
    return check(c, do_step(instance_of(c), t, step));
}

fmi2Status fmi2CancelStep(fmi2Component c) { return report(c, "Steps cannot be canceled."); }

static fmi2Status no_status(fmi2Component c) {
    report(c, "Steps are synchronous.");
    return fmi2Discard;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    return no_status(c);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return no_status(c);
    *value = instance_time(instance_of(c));
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    return no_status(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    return no_status(c);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    return no_status(c);
}
