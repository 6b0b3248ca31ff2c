/* Access to variables and states by value reference, for all versions of FMI. */

#include "variables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Largest difference of a communication point from the end of the last step, relative to the
   internal step: rounding errors of the clock of the importing tool. */
#define SAME_POINT 1e-3

/* Modes of an instance. */
enum { INSTANTIATED = 0, INITIALIZING, STEPPING, TERMINATED };

static int refuse(Instance *s, const char *text) { return fail(s, text, 0.0); }

static int check_mode(Instance *s) {
    if (s->table->mode != TERMINATED) return 0;
    return refuse(s, "The FMU is terminated; reset it to begin again.");
}

/* Allocate `*state` if it is NULL. */
static int provide(Instance *s, void **state) {
    if (!state) return refuse(s, "There is no place for the state.");
    if (!*state) *state = malloc(instance_state_size());
    return *state ? 0 : refuse(s, "Out of memory.");
}

int get_variables(Instance *s, const Index references[], size_t count, double values[],
                  int has_time) {
    for (size_t k = 0; k < count; k++) {
        const Index output = references[k] - model.n_values;
        if (references[k] < model.n_values) {
            values[k] = s->table->values.at[references[k]];
        } else if (output < model.n_outputs) {
            const double *outputs = instance_outputs(s);
            if (!outputs) return -1;
            values[k] = outputs[output];
        } else if (has_time && output == model.n_outputs) {
            values[k] = instance_time(s);
        } else {
            return refuse(s, "There is no variable with this value reference.");
        }
    }
    return 0;
}

int set_variables(Instance *s, const Index references[], size_t count, const double values[]) {
    if (check_mode(s)) return -1;
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= model.n_values)
            return refuse(s, "Only inputs and parameters can be set.");
        if (instance_set_value(s, references[k], values[k])) return -1;
    }
    return 0;
}

int get_directional_derivative(Instance *s, const Index unknowns[], size_t n_unknowns,
                               const Index knowns[], size_t n_knowns, const double seed[],
                               double result[]) {
    double *direction = calloc(model.n_values + model.n_outputs + 1, sizeof(double));
    if (!direction) return refuse(s, "Out of memory.");
    double *derivative = direction + model.n_values;
    int code = 0;
    for (size_t k = 0; k < n_knowns && !code; k++) {
        if (knowns[k] < model.n_values)
            direction[knowns[k]] += seed[k];
        else
            code = refuse(s, "Derivatives exist with respect to inputs and parameters.");
    }
    if (!code) code = instance_derivative(s, direction, derivative);
    for (size_t k = 0; k < n_unknowns && !code; k++) {
        if (unknowns[k] >= model.n_values && unknowns[k] - model.n_values < model.n_outputs)
            result[k] = derivative[unknowns[k] - model.n_values];
        else
            code = refuse(s, "Derivatives exist of outputs only.");
    }
    free(direction);
    return code;
}

int copy_state(Instance *s, void **state) {
    if (provide(s, state)) return -1;
    memcpy(*state, s->table, instance_state_size());
    clear_addresses(*state);
    return 0;
}

int restore_state(Instance *s, const void *state) {
    if (!state) return refuse(s, "There is no saved state to restore.");
    memcpy(s->table, state, instance_state_size());
    write_addresses(s->table);
    refresh_numbers(s);
    return 0;
}

void free_state(void **state) {
    if (!state) return;
    free(*state);
    *state = NULL;
}

/* Bytes begin with the token of the model: states of other models have another meaning. */
size_t serialized_size(void) { return strlen(model_token) + instance_state_size(); }

int serialize_state(Instance *s, const void *state, void *bytes, size_t size) {
    const size_t head = strlen(model_token);
    if (!state) return refuse(s, "There is no saved state to restore.");
    if (!bytes || size < serialized_size()) return refuse(s, "The array is too short.");
    memcpy(bytes, model_token, head);
    memcpy((char *)bytes + head, state, instance_state_size());
    return 0;
}

int deserialize_state(Instance *s, const void *bytes, size_t size, void **state) {
    const size_t head = strlen(model_token);
    if (!bytes || size != serialized_size() || memcmp(bytes, model_token, head))
        return refuse(s, "The bytes are not a state of this FMU.");
    if (provide(s, state)) return -1;
    memcpy(*state, (const char *)bytes + head, size - head);
    return 0;
}

int set_experiment(Instance *s, double start, int has_stop, double stop) {
    if (s->table->mode != INSTANTIATED)
        return refuse(s, "The times of the experiment are set before initialization; reset the "
                         "FMU first.");
    if (start != 0.0) return refuse(s, "The start time must be 0, where the model begins.");
    if (has_stop && !(stop > 0.0)) return refuse(s, "The stop time must be positive.");
    s->stop = has_stop ? stop : INFINITY;
    return 0;
}

int enter_initialization(Instance *s) {
    if (s->table->mode != INSTANTIATED)
        return refuse(s, "Initialization has begun before; reset the FMU to begin again.");
    s->table->mode = INITIALIZING;
    return 0;
}

int exit_initialization(Instance *s) {
    if (s->table->mode != INITIALIZING)
        return refuse(s, "The FMU is not in initialization mode.");
    if (instance_initialize(s)) return -1;
    s->table->mode = STEPPING;
    return 0;
}

int terminate(Instance *s) {
    s->table->mode = TERMINATED;
    return 0;
}

int do_step(Instance *s, double t, double step) {
    if (check_mode(s)) return -1;
    if (s->table->mode != STEPPING)
        return refuse(s, "The FMU is not initialized; exit initialization mode first.");
    if (!(fabs(t - instance_time(s)) <= SAME_POINT * model.step))
        return refuse(s, "The communication point is not the end of the last step.");
    if (!(step > 0.0) || !isfinite(step))
        return refuse(s, "The communication step must be positive and finite.");
    return instance_advance(s, t + step);
}
