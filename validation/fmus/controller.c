/* Controller FMU (FMI 2.0 Co-Simulation): torque = KP e + KI integral of e - KD rate with the error
   e = target - angle. The integral is advanced by the rectangle rule once per communication step. */

#include "fmi2Functions.h"

#include <stdlib.h>

enum { ANGLE, RATE, TARGET, KP, KI, KD, TORQUE, INTEGRAL, COUNT };

typedef struct {
    double values[COUNT];
} Controller;

static void update(Controller *c) {
    double *x = c->values;
    x[TORQUE] = x[KP] * (x[TARGET] - x[ANGLE]) + x[KI] * x[INTEGRAL] - x[KD] * x[RATE];
}

FMI2_Export const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
FMI2_Export const char *fmi2GetVersion(void) { return fmi2Version; }

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                          fmi2String resources,
                                          const fmi2CallbackFunctions *callbacks,
                                          fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible;
    (void)logging;
    return calloc(1, sizeof(Controller));
}

FMI2_Export void fmi2FreeInstance(fmi2Component c) { free(c); }

FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean with_tolerance,
                                           fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean with_stop, fmi2Real stop) {
    (void)c, (void)with_tolerance, (void)tolerance, (void)start, (void)with_stop, (void)stop;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
FMI2_Export fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }

FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                   fmi2Real value[]) {
    update(c);
    for (size_t k = 0; k < n; k++) value[k] = ((Controller *)c)->values[vr[k]];
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                   const fmi2Real value[]) {
    for (size_t k = 0; k < n; k++) ((Controller *)c)->values[vr[k]] = value[k];
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no_set) {
    double *x = ((Controller *)c)->values;
    (void)t, (void)no_set;
    x[INTEGRAL] += step * (x[TARGET] - x[ANGLE]);
    return fmi2OK;
}

/* Functions that FMPy loads, but co-simulation of this controller does not call. */
typedef fmi2ValueReference Vr;
#define UNUSED(name, ...)                                                                          \
    FMI2_Export fmi2Status name(__VA_ARGS__) { return fmi2Error; }
UNUSED(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[])
UNUSED(fmi2Reset, fmi2Component c)
UNUSED(fmi2GetInteger, fmi2Component c, const Vr vr[], size_t n, fmi2Integer x[])
UNUSED(fmi2GetBoolean, fmi2Component c, const Vr vr[], size_t n, fmi2Boolean x[])
UNUSED(fmi2GetString, fmi2Component c, const Vr vr[], size_t n, fmi2String x[])
UNUSED(fmi2SetInteger, fmi2Component c, const Vr vr[], size_t n, const fmi2Integer x[])
UNUSED(fmi2SetBoolean, fmi2Component c, const Vr vr[], size_t n, const fmi2Boolean x[])
UNUSED(fmi2SetString, fmi2Component c, const Vr vr[], size_t n, const fmi2String x[])
UNUSED(fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *s)
UNUSED(fmi2SetFMUstate, fmi2Component c, fmi2FMUstate s)
UNUSED(fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *s)
UNUSED(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n)
UNUSED(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte x[], size_t n)
UNUSED(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte x[], size_t n, fmi2FMUstate *s)
UNUSED(fmi2GetDirectionalDerivative, fmi2Component c, const Vr z[], size_t nz, const Vr v[],
       size_t nv, const fmi2Real dv[], fmi2Real dz[])
UNUSED(fmi2SetRealInputDerivatives, fmi2Component c, const Vr vr[], size_t n,
       const fmi2Integer order[], const fmi2Real x[])
UNUSED(fmi2GetRealOutputDerivatives, fmi2Component c, const Vr vr[], size_t n,
       const fmi2Integer order[], fmi2Real x[])
UNUSED(fmi2CancelStep, fmi2Component c)
UNUSED(fmi2GetStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Status *x)
UNUSED(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Real *x)
UNUSED(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Integer *x)
UNUSED(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *x)
UNUSED(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind kind, fmi2String *x)
