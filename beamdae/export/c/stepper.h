/* Stepping of exported models.

   The file instance.c is the same for all models, alpha_steps.c or radau_steps.c calls the steps of
   the core, and model.c contains the kernels and numbers of one model. Instances share no
   variables. */

#ifndef BEAMDAE_STEPPER_H
#define BEAMDAE_STEPPER_H

#include <stddef.h>
#include <stdint.h>

#define MESSAGE_SIZE 256

typedef uint32_t Index;
typedef struct Instance Instance;

/* Functions return 0, or -1 after an error, which `instance_message` describes. */

Instance *instance_create(void);
void instance_free(Instance *instance);
const char *instance_message(const Instance *instance);

/* Return to the start values of the model at time zero. */
int instance_reset(Instance *instance);
/* Number for the interface, 0 after a reset; part of the state. */
int64_t *instance_mode(Instance *instance);
/* Compute accelerations and reactions from positions, velocities and values. */
int instance_initialize(Instance *instance);
int instance_advance(Instance *instance, double end);
/* Reject steps that end after `stop`, until the next reset. */
void instance_set_stop(Instance *instance, double stop);

double instance_time(const Instance *instance);
double instance_value(const Instance *instance, Index value);
int instance_set_value(Instance *instance, Index value, double number);
const double *instance_outputs(Instance *instance);
/* Derivative of all outputs along a direction of the values that were held in the last internal
   step (generalized-alpha) or communication step (Radau), for the same positions and velocities at
   its beginning. */
int instance_derivative(Instance *instance, const double *direction, double *result);

/* The state is a block of bytes without addresses. */
size_t instance_state_size(const Instance *instance);
void instance_get_state(const Instance *instance, void *state);
int instance_set_state(Instance *instance, const void *state);

#endif
