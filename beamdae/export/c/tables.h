/* Tables of the numbers and arrays of an exported model; `model_source.py` fills them as
   `core/tables.py` fills those of runs. */

#ifndef BEAMDAE_TABLES_H
#define BEAMDAE_TABLES_H

#include "core.h"

/* Parts that do not depend on the method. `t` is the end of the last internal step, and the
   communication point is at t + offset. */
typedef struct {
    double t, offset, branch;
    int64_t interval, mode, is_initialized, has_stepped, has_jumped;
    int64_t n, m;
    double length;
    Reals values, breakpoints, min_values, max_values;
    Indices number_targets;
    /* Motion at a start; with generalized-alpha, the current motion. */
    Reals q, v, ddq, lam;
    MotionBuffers starter;
    /* Work arrays. `inputs` are (q, v, a, lam), their derivatives, and those of the numbers p;
       `direction` are the values and their derivatives. */
    Reals inputs, direction, rate, outputs, numbers;
    Sum output, residual_direction, output_direction;
} Table;

/* Generalized-alpha. `start` is the motion for which the accelerations at the beginning of the last
   step were determined, and `jump` that after the last jump of inputs. */
typedef struct {
    Table base;
    AlphaWorkspace run;
    Sum smooth_motion; /* Of `starter.motion`, without forces with kinks over the motion. */
    double shift;
    int64_t follows_jump;
    Reals start, jump, jerk, velocity_error;
} AlphaTable;

/* Radau. The first words of the tables, which determine the motion, are those at the start of the
   last step in `before`; `begin` contains them and `before` at the last communication point but
   one. `is_quiet` is 1 if no value has changed since the last communication point. Steps update the
   derivatives if `has_tangent` is 1. */
typedef struct {
    Table base;
    RadauWorkspace run;
    double h, start_rate;
    int64_t is_quiet, has_tangent;
    Sum gap_sum;
    Reals gaps, before, begin;
    /* Derivatives of y and, for the last step, of w and of the stages, and inputs (y, y'), their
       derivatives and those of the numbers p. `zeros` are the rates y' of no motion. */
    Reals tangent, zeros;
    Reals2 tangent_w, tangent_stages, tangent_rates;
    Reals stage;
} RadauTable;

#endif
