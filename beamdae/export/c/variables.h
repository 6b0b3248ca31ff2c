/* Access to variables and states by value reference, for all versions of FMI.

   Functions return 0, or -1 after an error, which the message of the instance describes. */

#ifndef BEAMDAE_VARIABLES_H
#define BEAMDAE_VARIABLES_H

#include "instance.h"

/* References are those of the values, then those of the outputs, then, if it is a variable, that
   of the time. */
int get_variables(Instance *s, const Index references[], size_t count, double values[],
                  int has_time);
int set_variables(Instance *s, const Index references[], size_t count, const double values[]);
int get_directional_derivative(Instance *s, const Index unknowns[], size_t n_unknowns,
                               const Index knowns[], size_t n_knowns, const double seed[],
                               double result[]);

/* `*state` is allocated if it is NULL. */
int copy_state(Instance *s, void **state);
int restore_state(Instance *s, const void *state);
void free_state(void **state);
size_t serialized_size(void);
int serialize_state(Instance *s, const void *state, void *bytes, size_t size);
int deserialize_state(Instance *s, const void *bytes, size_t size, void **state);

/* Set the range of times, [s]; the model begins at time zero. */
int set_experiment(Instance *s, double start, int has_stop, double stop);

/* Transitions between modes. */
int enter_initialization(Instance *s);
int exit_initialization(Instance *s);
int terminate(Instance *s);

/* Advance from the communication point `t`, the end of the last step, to `t + step`. */
int do_step(Instance *s, double t, double step);

#endif
