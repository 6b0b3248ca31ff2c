/* Parts of an instance that stepper.c shares with the method of the exported model, and the
   functions of this method, which alpha.c or radau.c defines. */

#ifndef BEAMDAE_INSTANCE_H
#define BEAMDAE_INSTANCE_H

#include "stepper.h"

#include <float.h>
#include <stddef.h>

/* Difference of equal times relative to the step of the model. */
#define SAME_TIME 1e-6
/* Rounding errors of the length of a step, relative to the time at its end. */
#define TIME_ROUNDING (4.0 * DBL_EPSILON)

/* Largest number of arrays of an instance. */
#define MAX_ARRAYS 96

enum { DONE = 0, NOT_CONVERGED = 1, NOT_FINITE = 2, SINGULAR = 3, TOO_SMALL = 4 };

typedef struct {
    const Plan *plan;
    double *shared, *local, *out;
} Sum;

/* Numbers of the state that are not in arrays. `t` is the end of the last internal step, and the
   communication point is at t + offset. */
typedef struct {
    double t, offset, branch;
    Index interval;
    int is_initialized, has_stepped, has_jumped, mode;
} Scalars;

/* Work arrays of the method. */
typedef struct Method Method;

struct Instance {
    const Model *model;
    Scalars now;
    /* State: arrays in one block, from q to the numbers of the method. */
    double *block;
    size_t n_state;
    double *q, *v, *ddq, *lam, *values, *method_state;
    /* Work arrays. */
    double *p, *motion, *levels, *rate, *solution, *outputs, *numbers;
    int fixed_iterations, has_outputs;
    /* End of the experiment [s]; not part of the state. */
    double stop;
    Factors saddle_factors;
    Sum residual, matrix, motion_sum, smooth_motion, saddle, output_sum;
    Sum residual_direction, output_direction;
    Method *method;
    double *allocated[MAX_ARRAYS];
    int n_allocated;
    char message[MESSAGE_SIZE];
};

double *new_array(Instance *s, size_t size, int *failed);
void create_sum(Instance *s, Sum *sum, const Plan *plan, int *failed);
void create_factors(Instance *s, Factors *f, const Pattern *pattern, int is_complex, int *failed);
/* Write the message of an error at the time t; return -1. */
int fail(Instance *s, const char *text, double t);
void free_factors(Factors *f);
/* Write the message of a failed step; return 0 if the code is DONE. */
int report_step(Instance *s, int code);

/* Sums of kernels */
void evaluate(const Sum *sum, const double *x, double *result);
void set_time(const Sum *sum, double t, double branch);
/* Factors of stiffness, damping, mass, constraints and reactions in matrices. */
void set_factors(const Sum *sum, double c_q, double c_v, double c_a, double c_h, double c_r);

/* Restart the method at (t, q, v); return 0, or -1 after an error. */
int restart(Instance *s);
/* Update the numbers of the kernels after a change of values. */
void refresh_numbers(Instance *s, int all);
/* Write the derivatives of the numbers p along a direction of the values. */
void write_direction(Instance *s, const double *direction, double *dp);
/* Advance to `end`, with restarts at breakpoints. */
int advance(Instance *s, double end);

/* Evaluate (F, g, g', g'') in `levels`, and factorize the saddle-point matrix if `coefficient` is
   not negative, with mass M + coefficient K. */
int evaluate_motion(Instance *s, double t, const double *q, const double *v, const double *a,
                    const double *lam, double coefficient);
/* Solve [[M, G^T], [G, 0]] (x, mu) = (0, sign right) with the last factors, in `solution`. */
void solve_constraints(Instance *s, const double *right, double sign);
/* Close joints whose gaps exceed `tolerance` times that of the start, correct velocities, and set
   `ddq` and `lam`. */
int make_consistent(Instance *s, double tolerance);
/* Accelerations and multipliers in `solution`, with mass M + coefficient K and the forces `change`
   (NULL for none) in addition. */
int solve_accelerations(Instance *s, double coefficient, const double *change);

/* Method of the exported model. Functions that return int return 0, or -1 after an error. */

/* Number of numbers of its state. */
size_t method_state_size(const Model *model);
/* Allocate work arrays; `method_state` is allocated already. */
void method_create(Instance *s, int *failed);
void method_free(Instance *s);
void method_reset(Instance *s);
/* Begin at (t, q, v), which need not be consistent; return a code. */
int method_restart(Instance *s);
/* Prepare for a change of values at the communication point. */
int method_prepare_change(Instance *s);
/* Make accelerations and multipliers consistent with changed values. */
int method_follow_values(Instance *s);
/* Prepare for derivatives of the communication step that begins. */
void method_begin_step(Instance *s);
/* Advance to `end` in one smooth interval. */
int method_advance(Instance *s, double end);
/* Write (q, v, a, lam) at the communication point. */
void method_evaluate(const Instance *s, double *y);
/* Compute what follows from a restored state. */
int method_restore(Instance *s);
int method_derivative(Instance *s, const double *direction, double *result);
unsigned long method_pivot_searches(const Instance *s);

#endif
