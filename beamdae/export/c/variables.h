/* Access to variables and states by value reference, for all versions of FMI.

   Functions return NULL, or a message after an error. */

#ifndef BEAMDAE_VARIABLES_H
#define BEAMDAE_VARIABLES_H

#include "stepper.h"

/* References are those of the values, then those of the outputs, then, if it is a variable, that
   of the time. */
const char *get_variables(Instance *instance, const Index references[], size_t count,
                          double values[], int has_time);
const char *set_variables(Instance *instance, const Index references[], size_t count,
                          const double values[]);
const char *get_directional_derivative(Instance *instance, const Index unknowns[],
                                       size_t n_unknowns, const Index knowns[], size_t n_knowns,
                                       const double seed[], double result[]);

/* `*state` is allocated if it is NULL. */
const char *copy_state(const Instance *instance, void **state);
const char *restore_state(Instance *instance, const void *state);
void free_state(void **state);
size_t serialized_size(const Instance *instance);
const char *serialize_state(const Instance *instance, const void *state, void *bytes, size_t size);
const char *deserialize_state(const Instance *instance, const void *bytes, size_t size,
                              void **state);

/* Set the range of times, [s]; the model begins at time zero. */
const char *set_experiment(Instance *instance, double start, int has_stop, double stop);

/* Transitions between modes. */
const char *enter_initialization(Instance *instance);
const char *exit_initialization(Instance *instance);
const char *terminate(Instance *instance);

/* Advance from the communication point `t`, the end of the last step, to `t + step`. */
const char *do_step(Instance *instance, double t, double step);

#endif
