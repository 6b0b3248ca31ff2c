/* Instances of an exported model: memory, sums of kernels, consistent starting values, inputs,
   states and breakpoints. The method of the steps is in alpha.c or radau.c. */

#include "instance.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Positions and friction; see beamdae.equations.starts.consistent_start. */
#define POSITION_TOLERANCE 1e-12
#define RIGID_TIME 1.0
#define MAX_POSITION_ITERATIONS 50
#define MAX_FRICTION_ITERATIONS 50
#define FRICTION_TOLERANCE 1e-10
/* Largest communication step, relative to the step of the model. */
#define MAX_STEPS 1e9
/* Rounding errors of the stop time, relative to the step of the model. */
#define SAME_END 1e-3

/* Indices of the shared numbers of matrices; see beamdae.symbolic.local_symbols. */
enum { TIME, BRANCH, C_Q, C_V, C_A, C_L, C_H, C_R };

/* Memory */

double *new_array(Instance *s, size_t size, int *failed) {
    double *array = calloc(size + 1, sizeof(double));
    if (!array || s->n_allocated == MAX_ARRAYS) {
        *failed = 1;
        free(array);
        return NULL;
    }
    s->allocated[s->n_allocated++] = array;
    return array;
}

void create_sum(Instance *s, Sum *sum, const Plan *plan, int *failed) {
    sum->plan = plan;
    sum->shared = new_array(s, plan->n_shared, failed);
    sum->local = new_array(s, plan->n_local, failed);
    sum->out = new_array(s, plan->n_out, failed);
}

void create_factors(Instance *s, Factors *f, const Pattern *pattern, int is_complex, int *failed) {
    const size_t width = is_complex ? 2 : 1, size = width * pattern->size;
    f->pattern = pattern;
    f->is_complex = is_complex;
    f->nonzeros = new_array(s, width * pattern->nnz, failed);
    f->upper = new_array(s, width * pattern->n_upper, failed);
    f->lower = new_array(s, width * pattern->n_lower, failed);
    double *work = new_array(s, 6 * size, failed);
    if (!work) return;
    f->inverse = work, work += size;
    f->x = work, work += size;
    f->solution = work, work += size;
    f->right = work, work += size;
    f->residual = work, work += size;
    f->terms = work;
}

int fail(Instance *s, const char *text, double t) {
    snprintf(s->message, MESSAGE_SIZE, text, t);
    return -1;
}

/* Last row k < count - 1 of a table with axis[k] <= x, or 0. */
Index find_row(const double *axis, Index count, double x) {
    Index start = 0, stop = count - 1;
    while (stop - start > 1) {
        const Index pivot = (start + stop) / 2;
        if (x < axis[pivot])
            stop = pivot;
        else
            start = pivot;
    }
    return start;
}

/* Sums of kernels */

static void copy_data(const Sum *sum, const double *p, Index first) {
    const Plan *plan = sum->plan;
    for (Index k = first; k < plan->n_data; k++)
        sum->local[plan->data_targets[k]] = p[plan->data_sources[k]];
}

void evaluate(const Sum *sum, const double *x, double *result) {
    const Plan *plan = sum->plan;
    double *local = sum->local, *out = sum->out;
    Index pick = 0, gather = 0, add = 0, weighted = 0;
    memset(result, 0, plan->size * sizeof(double));
    for (Index k = 0; k < plan->n_batches; k++) {
        const Batch *batch = &plan->batches[k];
        for (; pick < batch->pick_end; pick++)
            local[plan->pick_targets[pick]] = x[plan->pick_sources[pick]];
        for (Index i = gather; i < batch->gather_end; i++) local[plan->gather_targets[i]] = 0.0;
        for (; gather < batch->gather_end; gather++)
            local[plan->gather_targets[gather]] +=
                plan->gather_weights[gather] * x[plan->gather_sources[gather]];
        for (Index copy = 0; copy < batch->copies; copy++)
            batch->kernel(sum->shared, local + batch->start + copy * batch->n_inputs,
                          out + copy * batch->n_outputs);
        for (; add < batch->add_end; add++)
            result[plan->add_targets[add]] += out[plan->add_sources[add]];
        for (; weighted < batch->weighted_end; weighted++)
            result[plan->weighted_targets[weighted]] +=
                plan->weights[weighted] * out[plan->weighted_sources[weighted]];
    }
    memcpy(out, sum->shared, plan->n_shared * sizeof(double));
    out[plan->n_shared] = 1.0;
    for (; add < plan->n_add; add++)
        result[plan->add_targets[add]] += out[plan->add_sources[add]];
    for (; weighted < plan->n_weighted; weighted++)
        result[plan->weighted_targets[weighted]] +=
            plan->weights[weighted] * out[plan->weighted_sources[weighted]];
}

void set_time(const Sum *sum, double t, double branch) {
    sum->shared[TIME] = t;
    sum->shared[BRANCH] = branch;
}

void set_factors(const Sum *sum, double c_q, double c_v, double c_a, double c_h, double c_r) {
    double *c = sum->shared;
    c[C_Q] = c_q, c[C_V] = c_v, c[C_A] = c_a, c[C_L] = 1.0, c[C_H] = c_h, c[C_R] = c_r;
}

/* Consistent starting values, at the start and at breakpoints */

int evaluate_motion(Instance *s, double t, const double *q, const double *v, const double *a,
                    const double *lam, double coefficient) {
    const Index n = s->model->n, m = s->model->m;
    double *y = s->motion;
    for (Index i = 0; i < n; i++) {
        y[i] = q[i];
        y[n + i] = v ? v[i] : 0.0;
        y[2 * n + i] = a ? a[i] : 0.0;
    }
    for (Index i = 0; i < m; i++) y[3 * n + i] = lam ? lam[i] : 0.0;
    set_time(&s->motion_sum, t, s->now.branch);
    evaluate(&s->motion_sum, y, s->levels);
    if (coefficient < 0.0) return DONE;
    set_time(&s->saddle, t, s->now.branch);
    set_factors(&s->saddle, coefficient, 0.0, 1.0, 1.0, 1.0);
    evaluate(&s->saddle, y, s->saddle_factors.nonzeros);
    return factorize(&s->saddle_factors) ? DONE : SINGULAR;
}

void solve_constraints(Instance *s, const double *right, double sign) {
    const Index n = s->model->n, m = s->model->m;
    memset(s->solution, 0, n * sizeof(double));
    for (Index i = 0; i < m; i++) s->solution[n + i] = sign * right[i];
    solve(&s->saddle_factors, s->solution);
}

/* Close the gaps that the steps have left; see ConsistencySolver. */
static int close_joints(Instance *s, double ratio) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    const double tolerance = POSITION_TOLERANCE * fmax(1.0, model->length);
    double previous = INFINITY;
    for (int k = 0; k < MAX_POSITION_ITERATIONS && m > 0; k++) {
        double gap = 0.0;
        evaluate_motion(s, s->now.t, s->q, NULL, NULL, NULL, -1.0);
        for (Index i = 0; i < m; i++) gap = fmax(gap, fabs(s->levels[n + i]));
        if (gap <= tolerance * ratio || (gap <= tolerance && gap > 0.5 * previous)) break;
        previous = gap;
        if (evaluate_motion(s, s->now.t, s->q, NULL, NULL, NULL, RIGID_TIME * RIGID_TIME) != DONE)
            return SINGULAR;
        solve_constraints(s, s->levels + n, -1.0);
        for (Index i = 0; i < model->n_states; i++) s->solution[model->states[i]] = 0.0;
        for (Index i = 0; i < n; i++) s->q[i] += s->solution[i];
    }
    return DONE;
}

/* See ConsistencySolver.acceleration. */
int solve_accelerations(Instance *s, double coefficient, const double *change) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    double *lam = s->rate;
    memset(lam, 0, (m + 1) * sizeof(double));
    for (int k = 0; k < MAX_FRICTION_ITERATIONS; k++) {
        if (evaluate_motion(s, s->now.t, s->q, s->v, NULL, lam, coefficient) != DONE)
            return SINGULAR;
        for (Index i = 0; i < n; i++) s->solution[i] = -s->levels[i] - (change ? change[i] : 0.0);
        for (Index i = 0; i < m; i++) s->solution[n + i] = -s->levels[n + 2 * m + i];
        if (!model->forces_depend_on_reactions) {
            solve(&s->saddle_factors, s->solution);
            return DONE;
        }
        /* dF/dlam is the difference between the upper right block and G^T. */
        const Pattern *at = &model->saddle_pattern;
        for (Index j = 0; j < n + m; j++)
            for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++) {
                const Index row = at->matrix_rows[e];
                const double value = s->saddle_factors.nonzeros[e];
                if (j >= n && row < n) s->solution[row] += value * lam[j - n];
                if (j < n && row >= n) s->solution[j] -= value * lam[row - n];
            }
        solve(&s->saddle_factors, s->solution);
        double correction = 0.0, size = 0.0;
        for (Index i = 0; i < m; i++) {
            correction = fmax(correction, fabs(s->solution[n + i] - lam[i]));
            size = fmax(size, fabs(s->solution[n + i]));
            lam[i] = s->solution[n + i];
        }
        if (correction <= FRICTION_TOLERANCE * size) return DONE;
    }
    return NOT_CONVERGED;
}

int make_consistent(Instance *s, double tolerance) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    int code = close_joints(s, tolerance);
    if (code != DONE) return code;
    /* Velocities projected in the metric of the mass matrix. */
    if (evaluate_motion(s, s->now.t, s->q, s->v, NULL, NULL, 0.0) != DONE) return SINGULAR;
    if (m > 0) {
        solve_constraints(s, s->levels + n + m, -1.0);
        for (Index i = 0; i < n; i++) s->v[i] += s->solution[i];
    }
    if (model->n_states) { /* The rows of first-order states x are x' - f. */
        evaluate_motion(s, s->now.t, s->q, s->v, NULL, NULL, -1.0);
        for (Index i = 0; i < model->n_states; i++)
            s->v[model->states[i]] -= s->levels[model->states[i]];
    }
    code = solve_accelerations(s, 0.0, NULL);
    if (code != DONE) return code;
    memcpy(s->ddq, s->solution, n * sizeof(double));
    memcpy(s->lam, s->solution + n, m * sizeof(double));
    return DONE;
}

int restart(Instance *s) {
    const int code = method_restart(s);
    s->has_outputs = s->now.has_jumped = 0;
    if (code == SINGULAR)
        return fail(s, "No accelerations at t = %.9g s: the matrix is singular; check inputs, "
                       "parameters and the positions of the mechanism.", s->now.t);
    if (code == NOT_CONVERGED)
        return fail(s, "With friction, no accelerations and reactions satisfy the equations at "
                       "t = %.9g s; reduce the coefficient of friction.", s->now.t);
    if (code != DONE)
        return fail(s, "Accelerations are not finite at t = %.9g s; check inputs and parameters.",
                    s->now.t);
    return 0;
}

/* Interface */

void refresh_numbers(Instance *s, int all) {
    const Model *model = s->model;
    const Sum *sums[] = {&s->residual,   &s->matrix,
                         &s->motion_sum, &s->smooth_motion,
                         &s->saddle,     &s->output_sum,
                         &s->residual_direction, &s->output_direction};
    if (model->n_numbers > 0) {
        model->numbers(s->values, NULL, s->numbers);
        for (Index k = 0; k < model->n_numbers; k++)
            s->p[model->number_targets[k]] = s->numbers[k];
    }
    for (size_t k = 0; k < sizeof(sums) / sizeof(*sums); k++)
        copy_data(sums[k], s->p, all ? 0 : sums[k]->plan->n_fixed_data);
    s->has_outputs = 0;
}

static void set_branch(Instance *s) {
    const Model *model = s->model;
    const Index k = s->now.interval;
    const double start = k > 0 ? model->breakpoints[k - 1] : 0.0;
    s->now.branch = k < model->n_breakpoints ? 0.5 * (start + model->breakpoints[k]) : start + 1.0;
}

Instance *instance_create(const Model *model) {
    Instance *s = calloc(1, sizeof(Instance));
    const size_t n = model->n, m = model->m, size = 3 * n + m;
    int failed = 0;
    if (!s) return NULL;
    s->model = model;
    s->n_state = 3 * n + m + model->n_values + method_state_size(model);
    double *x = s->block = new_array(s, s->n_state, &failed);
    if (failed) {
        instance_free(s);
        return NULL;
    }
    s->q = x, x += n, s->v = x, x += n, s->ddq = x, x += n, s->lam = x, x += m;
    s->values = x, x += model->n_values, s->method_state = x;
    s->p = new_array(s, model->n_p, &failed);
    s->motion = new_array(s, 2 * size + model->n_p, &failed);
    s->levels = new_array(s, n + 3 * m, &failed);
    s->rate = new_array(s, m, &failed);
    s->solution = new_array(s, n + m, &failed);
    s->outputs = new_array(s, model->n_outputs, &failed);
    s->numbers = new_array(s, model->n_numbers, &failed);
    create_sum(s, &s->residual, &model->residual, &failed);
    create_sum(s, &s->matrix, &model->matrix, &failed);
    create_sum(s, &s->motion_sum, &model->motion, &failed);
    create_sum(s, &s->smooth_motion, &model->smooth_motion, &failed);
    create_sum(s, &s->saddle, &model->saddle, &failed);
    create_sum(s, &s->output_sum, &model->outputs, &failed);
    create_sum(s, &s->residual_direction, &model->residual_direction, &failed);
    create_sum(s, &s->output_direction, &model->outputs_direction, &failed);
    create_factors(s, &s->saddle_factors, &model->saddle_pattern, 0, &failed);
    s->fixed_iterations = model->fixed_iterations;
    if (!failed) method_create(s, &failed);
    if (failed) {
        instance_free(s);
        return NULL;
    }
    instance_reset(s);
    return s;
}

void free_factors(Factors *f) {
    free(f->dense);
    free(f->pivots);
}

void instance_free(Instance *s) {
    if (!s) return;
    free_factors(&s->saddle_factors);
    method_free(s);
    for (int k = 0; k < s->n_allocated; k++) free(s->allocated[k]);
    free(s);
}

const char *instance_message(const Instance *s) { return s->message; }

int instance_reset(Instance *s) {
    const Model *model = s->model;
    memset(s->block, 0, s->n_state * sizeof(double));
    memset(&s->now, 0, sizeof(s->now));
    s->message[0] = 0;
    s->stop = INFINITY;
    memcpy(s->q, model->q, model->n * sizeof(double));
    memcpy(s->v, model->v, model->n * sizeof(double));
    if (model->n_values) memcpy(s->values, model->values, model->n_values * sizeof(double));
    if (model->n_p) memcpy(s->p, model->p, model->n_p * sizeof(double));
    method_reset(s);
    set_branch(s);
    refresh_numbers(s, 1);
    return 0;
}

int instance_initialize(Instance *s) {
    const Model *model = s->model;
    memcpy(s->q, model->q, model->n * sizeof(double));
    memcpy(s->v, model->v, model->n * sizeof(double));
    s->now.is_initialized = 1;
    return restart(s);
}

int report_step(Instance *s, int code) {
    if (code == NOT_CONVERGED)
        return fail(s, "Newton's iteration did not converge at t = %.9g s; check inputs and "
                       "parameters, or export the model with a smaller step or rtol.", s->now.t);
    if (code == NOT_FINITE)
        return fail(s, "The residual is not finite at t = %.9g s; check inputs and "
                       "parameters.", s->now.t);
    if (code == SINGULAR)
        return fail(s, "The matrix is singular or not finite at t = %.9g s; check inputs and "
                       "parameters, or export the model with a smaller step or rtol.", s->now.t);
    if (code == TOO_SMALL)
        return fail(s, "The error test failed at the smallest step at t = %.9g s; check inputs "
                       "and parameters, or export the model with a larger rtol.", s->now.t);
    return 0;
}

/* Make accelerations and multipliers consistent with the present values. */
static int follow_values(Instance *s) {
    if (!s->now.is_initialized) return instance_initialize(s);
    if (!s->now.has_jumped) return 0;
    s->now.has_jumped = s->has_outputs = 0;
    return method_follow_values(s);
}

int advance(Instance *s, double end) {
    const Model *model = s->model;
    const double tolerance = SAME_TIME * model->step;
    s->has_outputs = 0;
    /* A breakpoint at the end is left to the next call, whose inputs may differ. */
    while (s->now.interval < model->n_breakpoints &&
           model->breakpoints[s->now.interval] < end - tolerance) {
        if (method_advance(s, model->breakpoints[s->now.interval])) return -1;
        method_evaluate(s, s->motion);
        memcpy(s->q, s->motion, model->n * sizeof(double));
        memcpy(s->v, s->motion + model->n, model->n * sizeof(double));
        s->now.t += s->now.offset;
        s->now.offset = 0.0;
        s->now.interval++;
        set_branch(s);
        if (restart(s)) return -1;
    }
    return method_advance(s, end);
}

int instance_advance(Instance *s, double end) {
    if (follow_values(s)) return -1;
    if (!(end - instance_time(s) <= MAX_STEPS * s->model->step))
        return fail(s, "The communication step at t = %.9g s is longer than 1e9 steps of the "
                       "model; use shorter communication steps.", instance_time(s));
    if (end > s->stop + SAME_END * s->model->step)
        return fail(s, "The communication step ends at t = %.9g s, after the stop time of the "
                       "experiment; begin with a later stop time, or without one.", end);
    method_begin_step(s);
    return advance(s, end);
}

void instance_set_stop(Instance *s, double stop) { s->stop = stop; }

double instance_time(const Instance *s) { return s->now.t + s->now.offset; }

int *instance_mode(Instance *s) { return &s->now.mode; }

double instance_value(const Instance *s, Index value) { return s->values[value]; }

int instance_set_value(Instance *s, Index value, double number) {
    if (!isfinite(number)) {
        snprintf(s->message, MESSAGE_SIZE, "%s: the value must be finite.",
                 s->model->value_names[value]);
        return -1;
    }
    const double low = s->model->min_values[value], high = s->model->max_values[value];
    if (number < low || number > high) {
        snprintf(s->message, MESSAGE_SIZE,
                 "%s: the value %.9g is outside the range for which the equations were verified, "
                 "%.9g to %.9g.", s->model->value_names[value], number, low, high);
        return -1;
    }
    if (s->values[value] != number) {
        if (s->now.has_stepped && method_prepare_change(s)) return -1;
        s->values[value] = number;
        /* Accelerations and reactions depend on the values; before the first step, positions and
           velocities do, too. */
        if (s->now.has_stepped)
            s->now.has_jumped = 1;
        else
            s->now.is_initialized = 0;
        refresh_numbers(s, 0);
    }
    return 0;
}

const double *instance_outputs(Instance *s) {
    if (!s->has_outputs) {
        if (follow_values(s)) return NULL;
        method_evaluate(s, s->motion);
        set_time(&s->output_sum, instance_time(s), s->now.branch);
        evaluate(&s->output_sum, s->motion, s->outputs);
        s->has_outputs = 1;
    }
    return s->outputs;
}

void write_direction(Instance *s, const double *direction, double *dp) {
    const Model *model = s->model;
    memset(dp, 0, model->n_p * sizeof(double));
    if (model->n_numbers > 0) model->numbers_direction(s->values, direction, s->numbers);
    for (Index k = 0; k < model->n_numbers; k++) dp[model->number_targets[k]] = s->numbers[k];
}

int instance_derivative(Instance *s, const double *direction, double *result) {
    if (!s->now.has_stepped)
        return fail(s, "Directional derivatives exist after the first step, not at t = %.9g s.",
                    s->now.t);
    return follow_values(s) ? -1 : method_derivative(s, direction, result);
}

size_t instance_state_size(const Instance *s) {
    return sizeof(Scalars) + s->n_state * sizeof(double);
}

void instance_get_state(const Instance *s, void *state) {
    memcpy(state, &s->now, sizeof(Scalars));
    memcpy((char *)state + sizeof(Scalars), s->block, s->n_state * sizeof(double));
}

int instance_set_state(Instance *s, const void *state) {
    memcpy(&s->now, state, sizeof(Scalars));
    memcpy(s->block, (const char *)state + sizeof(Scalars), s->n_state * sizeof(double));
    refresh_numbers(s, 0);
    return method_restore(s);
}

void instance_fix_iterations(Instance *s, int count) { s->fixed_iterations = count; }

unsigned long instance_pivot_searches(const Instance *s) {
    return s->saddle_factors.pivot_searches + method_pivot_searches(s);
}
