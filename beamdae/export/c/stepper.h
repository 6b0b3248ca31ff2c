/* Stepping of exported models.

   The file stepper.c is the same for all models, alpha.c or radau.c contains the method, and model.c
   the kernels and tables of one model as constants. Instances share no variables. */

#ifndef BEAMDAE_STEPPER_H
#define BEAMDAE_STEPPER_H

#include "linear.h"

#include <stddef.h>

#define MESSAGE_SIZE 256

/* Outputs of one copy from the numbers that all copies share and from its own numbers. */
typedef void (*Kernel)(const double *shared, const double *local, double *out);

/* Last row k < count - 1 of a table with axis[k] <= x, or 0; called by kernels. */
Index find_row(const double *axis, Index count, double x);

/* Copies of a kernel; their inputs begin at `start` in the local numbers. The ends are those of
   the entries of the batch in the tables of the plan. */
typedef struct {
    Kernel kernel;
    Index copies, n_inputs, n_outputs, start;
    Index pick_end, gather_end, add_end, weighted_end;
} Batch;

/* Sum of kernels: local numbers are gathered from x, and outputs are added to the result. */
typedef struct {
    Index size, n_shared, n_local, n_out, n_batches;
    Index n_data, n_fixed_data, n_add, n_weighted;
    const Batch *batches;
    const Index *data_targets, *data_sources;
    const Index *pick_targets, *pick_sources;
    const Index *gather_targets, *gather_sources;
    const double *gather_weights;
    const Index *add_targets, *add_sources;
    const Index *weighted_targets, *weighted_sources;
    const double *weights;
} Plan;

/* Coefficients of Radau IIA; see beamdae.integrators.radau.coefficients. */
typedef struct {
    double real_eigenvalue, eigenvalue_re, eigenvalue_im;
    const double *nodes, *to_stages, *from_stages, *rates, *polynomial, *embedded, *start, *uniform;
} Tableau;

/* Exported model. Values are its inputs, followed by its parameters; n_p numbers enter the
   kernels, of which those in `number_targets` depend on the values. */
typedef struct {
    Index n, m, n_p, n_inputs, n_values, n_outputs, n_numbers;
    Index n_breakpoints, n_velocity_rows, n_states, forces_depend_on_reactions, tests_reactions;
    int fixed_iterations;
    double step, duration, length, alpha_m, alpha_f, gamma, beta, shift, defect;
    double newton_tolerance, min_correction_limit;
    Plan smooth_motion; /* Of `motion`, without forces with kinks over the motion. */
    /* Of radau.c: coordinates whose q' = v contains corrections by joints, the others, and error
       weights of positions and velocities. */
    Index n_corrected, n_defined;
    const Index *corrected, *defined;
    double longest_step, start_rate, stagnation_limit, rounding_ratio;
    const double *test_weights, *iteration_weights, *rounding_weights;
    /* Error test of multipliers, of which n_tested (m or none) are tested: least tolerances,
       tolerance relative to the largest values so far, and shortest tested step. */
    Index n_tested;
    const double *multiplier_tolerances;
    double multiplier_tolerance, shortest_tested_step;
    Tableau tableau;
    /* Gaps of contacts, negative inside surfaces. */
    Index n_gaps;
    Plan gaps;
    /* Of both. */
    const double *p, *q, *v, *weights, *values, *min_values, *max_values, *breakpoints;
    const Index *velocity_rows, *states, *number_targets;
    Kernel numbers, numbers_direction;
    const char *const *value_names;
    Plan residual, matrix, motion, saddle, outputs;
    Plan residual_direction, outputs_direction;
    Pattern step_pattern, saddle_pattern;
} Model;

typedef struct Instance Instance;

/* Functions return 0, or -1 after an error, which `instance_message` describes. */

Instance *instance_create(const Model *model);
void instance_free(Instance *instance);
const char *instance_message(const Instance *instance);

/* Return to the start values of the model at time zero. */
int instance_reset(Instance *instance);
/* Number for the interface, 0 after a reset; part of the state. */
int *instance_mode(Instance *instance);
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
   step (alpha.c) or communication step (radau.c), for the same positions and velocities at its
   beginning. */
int instance_derivative(Instance *instance, const double *direction, double *result);

/* The state is a block of bytes without pointers. */
size_t instance_state_size(const Instance *instance);
void instance_get_state(const Instance *instance, void *state);
int instance_set_state(Instance *instance, const void *state);

/* Number of Newton iterations of every step; 0 for as many as the tolerance requires. */
void instance_fix_iterations(Instance *instance, int count);
/* Number of matrices that required row exchanges, which are slower than the fixed order. */
unsigned long instance_pivot_searches(const Instance *instance);

#endif
