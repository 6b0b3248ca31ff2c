/* Access to variables and states by value reference, for all versions of FMI. */

#include "variables.h"
#include "model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Largest difference of a communication point from the end of the last step, relative to the
   internal step: rounding errors of the clock of the importing tool. */
#define SAME_POINT 1e-3

/* Modes of an instance; see instance_mode. */
enum { INSTANTIATED = 0, INITIALIZING, STEPPING, TERMINATED };

static const char *const OUT_OF_MEMORY = "Out of memory.";
static const char *const IS_TERMINATED = "The FMU is terminated; reset it to begin again.";
static const char *const NO_STATE = "There is no saved state to restore.";

const char *get_variables(Instance *instance, const Index references[], size_t count,
                          double values[], int has_time) {
    for (size_t k = 0; k < count; k++) {
        const Index output = references[k] - model.n_values;
        if (references[k] < model.n_values) {
            values[k] = instance_value(instance, references[k]);
        } else if (output < model.n_outputs) {
            const double *outputs = instance_outputs(instance);
            if (!outputs) return instance_message(instance);
            values[k] = outputs[output];
        } else if (has_time && output == model.n_outputs) {
            values[k] = instance_time(instance);
        } else {
            return "There is no variable with this value reference.";
        }
    }
    return NULL;
}

const char *set_variables(Instance *instance, const Index references[], size_t count,
                          const double values[]) {
    if (*instance_mode(instance) == TERMINATED) return IS_TERMINATED;
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= model.n_values) return "Only inputs and parameters can be set.";
        if (instance_set_value(instance, references[k], values[k]))
            return instance_message(instance);
    }
    return NULL;
}

const char *get_directional_derivative(Instance *instance, const Index unknowns[],
                                       size_t n_unknowns, const Index knowns[], size_t n_knowns,
                                       const double seed[], double result[]) {
    double *direction = calloc(model.n_values + model.n_outputs + 1, sizeof(double));
    if (!direction) return OUT_OF_MEMORY;
    double *derivative = direction + model.n_values;
    const char *message = NULL;
    for (size_t k = 0; k < n_knowns && !message; k++) {
        if (knowns[k] < model.n_values)
            direction[knowns[k]] += seed[k];
        else
            message = "Derivatives exist with respect to inputs and parameters.";
    }
    if (!message && instance_derivative(instance, direction, derivative))
        message = instance_message(instance);
    for (size_t k = 0; k < n_unknowns && !message; k++) {
        if (unknowns[k] >= model.n_values && unknowns[k] - model.n_values < model.n_outputs)
            result[k] = derivative[unknowns[k] - model.n_values];
        else
            message = "Derivatives exist of outputs only.";
    }
    free(direction);
    return message;
}

const char *copy_state(const Instance *instance, void **state) {
    if (!state) return "There is no place for the state.";
    if (!*state) *state = malloc(instance_state_size(instance));
    if (!*state) return OUT_OF_MEMORY;
    instance_get_state(instance, *state);
    return NULL;
}

const char *restore_state(Instance *instance, const void *state) {
    if (!state) return NO_STATE;
    return instance_set_state(instance, state) ? instance_message(instance) : NULL;
}

void free_state(void **state) {
    if (!state) return;
    free(*state);
    *state = NULL;
}

/* Bytes begin with the token of the model: states of other models have another meaning. */
size_t serialized_size(const Instance *instance) {
    return strlen(model_token) + instance_state_size(instance);
}

const char *serialize_state(const Instance *instance, const void *state, void *bytes, size_t size) {
    const size_t head = strlen(model_token);
    if (!state) return NO_STATE;
    if (!bytes || size < serialized_size(instance)) return "The array is too short.";
    memcpy(bytes, model_token, head);
    memcpy((char *)bytes + head, state, instance_state_size(instance));
    return NULL;
}

const char *deserialize_state(const Instance *instance, const void *bytes, size_t size,
                              void **state) {
    const size_t head = strlen(model_token);
    if (!bytes || size != serialized_size(instance) || memcmp(bytes, model_token, head))
        return "The bytes are not a state of this FMU.";
    if (!state) return "There is no place for the state.";
    if (!*state) *state = malloc(size);
    if (!*state) return OUT_OF_MEMORY;
    memcpy(*state, (const char *)bytes + head, size - head);
    return NULL;
}

const char *set_experiment(Instance *instance, double start, int has_stop, double stop) {
    if (*instance_mode(instance) != INSTANTIATED)
        return "The times of the experiment are set before initialization; reset the FMU first.";
    if (start != 0.0) return "The start time must be 0, where the model begins.";
    if (has_stop && !(stop > 0.0)) return "The stop time must be positive.";
    instance_set_stop(instance, has_stop ? stop : INFINITY);
    return NULL;
}

const char *enter_initialization(Instance *instance) {
    int64_t *mode = instance_mode(instance);
    if (*mode != INSTANTIATED)
        return "Initialization has begun before; reset the FMU to begin again.";
    *mode = INITIALIZING;
    return NULL;
}

const char *exit_initialization(Instance *instance) {
    int64_t *mode = instance_mode(instance);
    if (*mode != INITIALIZING) return "The FMU is not in initialization mode.";
    if (instance_initialize(instance)) return instance_message(instance);
    *mode = STEPPING;
    return NULL;
}

const char *terminate(Instance *instance) {
    *instance_mode(instance) = TERMINATED;
    return NULL;
}

const char *do_step(Instance *instance, double t, double step) {
    const int64_t mode = *instance_mode(instance);
    if (mode == TERMINATED) return IS_TERMINATED;
    if (mode != STEPPING) return "The FMU is not initialized; exit initialization mode first.";
    if (!(fabs(t - instance_time(instance)) <= SAME_POINT * model.step))
        return "The communication point is not the end of the last step.";
    if (!(step > 0.0) || !isfinite(step))
        return "The communication step must be positive and finite.";
    return instance_advance(instance, t + step) ? instance_message(instance) : NULL;
}
