/* Instances of exported models, and the functions of the method, which alpha_steps.c or
   radau_steps.c defines.

   The file instance.c is the same for all models, alpha_steps.c or radau_steps.c calls the steps of
   the core, and model.c contains the kernels and numbers of one model. Instances share no
   variables. */

#ifndef BEAMDAE_INSTANCE_H
#define BEAMDAE_INSTANCE_H

#include "model.h"
#include "tables.h"

#include <float.h>
#include <stddef.h>

#define MESSAGE_SIZE 256

/* Difference of equal times relative to the step of the model. */
#define SAME_TIME 1e-6
/* Rounding errors of the length of a step, relative to the time at its end. */
#define TIME_ROUNDING (4.0 * DBL_EPSILON)
/* Shortest step that ends at a communication point, relative to the step of the model. Rounding
   errors of positions, divided by the square of the step, are errors of accelerations. */
#define MIN_STEP_SHARE 1e-2

/* Those of the starts, and of real and complex matrices of steps. */
#define MAX_SOLVERS 3

typedef uint32_t Index;

/* The table begins the block of all words of the instance. The stop time, the end of the
   experiment [s], and the message of the last error are not part of the state. */
typedef struct {
    Table *table;
    int has_outputs;
    double stop;
    /* Solvers that eliminate full matrices, because pivots in the fixed order are not suitable. */
    LinearSolver *full_solvers[MAX_SOLVERS];
    int n_full_solvers;
    char message[MESSAGE_SIZE];
} Instance;

/* Functions that return int return 0, or -1 after an error, which `message` describes. */

Instance *instance_create(void);
void instance_free(Instance *s);
/* Return to the start values of the model at time zero. */
int instance_reset(Instance *s);
/* Compute accelerations and reactions from positions, velocities and values. */
int instance_initialize(Instance *s);
int instance_advance(Instance *s, double end);
double instance_time(const Instance *s);
int instance_set_value(Instance *s, Index value, double number);
/* Return NULL after an error. */
const double *instance_outputs(Instance *s);
/* Derivative of all outputs along a direction of the values that were held in the last internal
   step (generalized-alpha) or communication step (Radau), for the same positions and velocities at
   its beginning. */
int instance_derivative(Instance *s, const double *direction, double *result);
/* The state is a block of bytes without addresses. */
size_t instance_state_size(void);

/* Write the message of an error at the time t; return -1. */
int fail(Instance *s, const char *text, double t);
/* Write the message of a failed step; return 0 if the code is not negative. */
int report_step(Instance *s, int code);

/* Write all addresses of an instance, or zeros in place of those in a copy of its table. */
void write_addresses(Table *table);
void clear_addresses(void *table);

/* Let a solver that has requested pivots eliminate the full matrix with row exchanges. */
void renew_pivots(Instance *s, LinearSolver *linear, int is_complex);
/* Release factors of full matrices after a step: states do not contain them, and steps must not
   depend on whether a state was saved. */
void release_matrices(Instance *s);

/* Restart the method at (t, q, v); return 0, or -1 after an error. */
int restart(Instance *s);
/* Update the numbers of the kernels after a change of values. */
void refresh_numbers(Instance *s);
/* Write the derivatives of the numbers p along a direction of the values. */
void write_direction(Instance *s, const double *direction, double *dp);
/* Advance to `end`, with restarts at breakpoints. */
int advance(Instance *s, double end);

/* Set the entries of first-order states to zero. */
void clear_states(const Table *x, Reals vector);
/* The functions of the core, with row exchanges if necessary, at the present time. */
int factorize_start(Instance *s, Reals v, double stiffness);
int solve_start(Instance *s, double stiffness, Reals change);
int follow_jump(Instance *s);
/* Close joints whose gaps exceed `tolerance` times that of the start, correct velocities, and set
   `ddq` and `lam`. */
int make_consistent(Instance *s, double tolerance);

/* Method of the exported model. Functions that return int return 0, or -1 after an error. */

void method_reset(Instance *s);
/* Begin at (t, q, v), which need not be consistent; return a code. */
int method_restart(Instance *s);
/* Let the next step compute new factors. */
void method_forget_factors(Instance *s);
/* Prepare for a change of values at the communication point. */
int method_prepare_change(Instance *s);
/* Make accelerations and multipliers consistent with changed values. */
int method_follow_values(Instance *s);
/* Prepare for derivatives of the communication step that begins. */
void method_begin_step(Instance *s);
/* Advance to `end` in one smooth interval. */
int method_advance(Instance *s, double end);
/* Write (q, v, a, lam) at the communication point to `inputs`. */
void method_evaluate(Instance *s);
/* Write derivatives of the outputs; the caller restores the state. */
int method_derivative(Instance *s, const double *direction, Reals result);

#endif
