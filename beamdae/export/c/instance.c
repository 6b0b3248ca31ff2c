/* Instances of an exported model: memory, consistent starting values, inputs, states and
   breakpoints. The method of the steps is in alpha_steps.c or radau_steps.c. */

#include "instance.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Positions; see beamdae.equations.starts.consistent_start. */
#define POSITION_TOLERANCE 1e-12
#define RIGID_TIME 1.0
#define MAX_POSITION_ITERATIONS 50
/* Largest communication step, relative to the step of the model. */
#define MAX_STEPS 1e9
/* Rounding errors of the stop time, relative to the step of the model. */
#define SAME_END 1e-3

_Static_assert(sizeof(void *) == sizeof(int64_t), "Words of tables contain addresses.");

int fail(Instance *s, const char *text, double t) {
    snprintf(s->message, MESSAGE_SIZE, text, t);
    return -1;
}

int64_t find_row(const double *axis, int64_t lanes, int64_t count, double x) {
    int64_t start = 0, stop = count - 1;
    while (stop - start > 1) {
        const int64_t pivot = (start + stop) / 2;
        if (x < axis[pivot * lanes])
            stop = pivot;
        else
            start = pivot;
    }
    return start;
}

/* Memory */

void write_addresses(Table *table) {
    int64_t *words = (int64_t *)table;
    for (int64_t k = 0; k < model.n_constants; k++)
        words[model.constants[k].at] = (int64_t)model.constants[k].array;
    for (int64_t k = 0; k < model.n_links; k++)
        words[model.links[k].at] = (int64_t)(words + model.links[k].to);
    for (int64_t k = 0; k < model.n_codes; k++)
        words[model.codes[k].at] = (int64_t)model.codes[k].kernel;
}

void clear_addresses(void *table) {
    int64_t *words = table;
    for (int64_t k = 0; k < model.n_constants; k++) words[model.constants[k].at] = 0;
    for (int64_t k = 0; k < model.n_links; k++) words[model.links[k].at] = 0;
}

static void set_branch(Table *x) {
    const int64_t k = x->interval;
    const double *times = x->breakpoints.at, start = k > 0 ? times[k - 1] : 0.0;
    x->branch = k < x->breakpoints.size ? 0.5 * (start + times[k]) : start + 1.0;
    x->starter.branch = x->branch;
}

static void load_model(Instance *s) {
    memset(s->table, 0, model.n_words * sizeof(int64_t));
    for (int64_t k = 0; k < model.n_segments; k++) {
        const Segment *from = &model.segments[k];
        memcpy((int64_t *)s->table + from->at, from->words, from->count * sizeof(int64_t));
    }
    write_addresses(s->table);
    set_branch(s->table);
    method_reset(s);
    s->has_outputs = 0;
}

Instance *instance_create(void) {
    Instance *s = calloc(1, sizeof(Instance));
    if (!s) return NULL;
    s->table = malloc(model.n_words * sizeof(int64_t));
    if (!s->table) {
        free(s);
        return NULL;
    }
    instance_reset(s);
    return s;
}

void instance_free(Instance *s) {
    if (!s) return;
    free(s->table);
    free(s);
}

int instance_reset(Instance *s) {
    s->message[0] = 0;
    s->stop = INFINITY;
    load_model(s);
    return 0;
}

size_t instance_state_size(void) { return model.n_state * sizeof(int64_t); }

/* Pivots */

void renew_pivots(Instance *s, LinearSolver *linear, int is_complex) {
    const int64_t n = linear->plan.scale.size, width = is_complex ? 2 : 1;
    if (!linear->needs_pivots) return;
    double *numbers = malloc(width * n * n * sizeof(double) + n * sizeof(uint32_t));
    linear->needs_pivots = 0;
    linear->singular = !numbers;
    if (!numbers) return;
    linear->full = (Reals){numbers, n * n};
    s->full_solvers[s->n_full_solvers++] = linear;
}

void release_matrices(Instance *s) {
    if (!s->n_full_solvers) return;
    while (s->n_full_solvers) {
        LinearSolver *linear = s->full_solvers[--s->n_full_solvers];
        free(linear->full.at);
        linear->full = (Reals){0};
    }
    method_forget_factors(s);
}

/* Consistent starting values, at the start and at breakpoints */

int factorize_start(Instance *s, Reals v, double stiffness) {
    MotionBuffers *start = &s->table->starter;
    int code;
    start->t = s->table->t;
    while ((code = factorize_saddle(start, v, (Reals){0}, stiffness)) == NEW_PIVOTS)
        renew_pivots(s, &start->linear, 0);
    return code;
}

int solve_start(Instance *s, double stiffness, Reals change) {
    MotionBuffers *start = &s->table->starter;
    int code;
    start->t = s->table->t;
    while ((code = solve_accelerations(start, stiffness, change)) == NEW_PIVOTS)
        renew_pivots(s, &start->linear, 0);
    return code;
}

int follow_jump(Instance *s) {
    MotionBuffers *start = &s->table->starter;
    int code;
    start->t = s->table->t;
    while ((code = solve_jump(start)) == NEW_PIVOTS) renew_pivots(s, &start->linear, 0);
    return code;
}

void clear_states(const Table *x, Reals vector) {
    for (int64_t k = 0; k < x->starter.states.size; k++) vector.at[x->starter.states.at[k]] = 0.0;
}

/* Close the gaps that the steps have left; see ConsistencySolver. */
static int close_joints(Instance *s, double ratio) {
    Table *x = s->table;
    MotionBuffers *start = &x->starter;
    const Reals none = {0}, gaps = part(start->levels, x->n, x->n + x->m);
    const double tolerance = POSITION_TOLERANCE * fmax(1.0, x->length);
    double previous = INFINITY;
    for (int k = 0; k < MAX_POSITION_ITERATIONS && x->m > 0; k++) {
        double gap = 0.0;
        evaluate_motion(start, &start->motion, x->t, x->q, none, none, none);
        for (int64_t i = 0; i < x->m; i++) gap = fmax(gap, fabs(gaps.at[i]));
        if (gap <= tolerance * ratio || (gap <= tolerance && gap > 0.5 * previous)) break;
        previous = gap;
        if (factorize_start(s, none, RIGID_TIME * RIGID_TIME) != DONE) return SINGULAR;
        solve_constraints(start, gaps);
        clear_states(x, start->solution);
        add_to(x->q, 1.0, start->solution);
    }
    return DONE;
}

int make_consistent(Instance *s, double tolerance) {
    Table *x = s->table;
    const int64_t n = x->n, m = x->m;
    int code = close_joints(s, tolerance);
    if (code != DONE) return code;
    /* Velocities projected in the metric of the mass matrix. */
    if (factorize_start(s, x->v, 0.0) != DONE) return SINGULAR;
    if (m > 0) {
        solve_constraints(&x->starter, part(x->starter.levels, n + m, n + 2 * m));
        add_to(x->v, 1.0, x->starter.solution);
    }
    fill(x->starter.lam, 0.0);
    code = follow_jump(s);
    if (code != DONE) return code;
    copy(x->ddq, x->starter.solution);
    copy(x->lam, from(x->starter.solution, n));
    return DONE;
}

int restart(Instance *s) {
    const int code = method_restart(s);
    release_matrices(s);
    s->has_outputs = s->table->has_jumped = 0;
    if (code == SINGULAR)
        return fail(s, "No accelerations at t = %.9g s: the matrix is singular; check inputs, "
                       "parameters and the positions of the mechanism.", s->table->t);
    if (code == NOT_CONVERGED)
        return fail(s, "With friction, no accelerations and reactions satisfy the equations at "
                       "t = %.9g s; reduce the coefficient of friction.", s->table->t);
    if (code != DONE)
        return fail(s, "Accelerations are not finite at t = %.9g s; check inputs and parameters.",
                    s->table->t);
    return 0;
}

/* Interface */

void refresh_numbers(Instance *s) {
    Table *x = s->table;
    double *words = (double *)x;
    if (x->numbers.size) model.write_numbers(x->values.at, NULL, x->numbers.at, LANES);
    for (int64_t k = 0; k < model.n_numbers; k++)
        words[model.numbers[k].at] = x->numbers.at[LANES * model.numbers[k].number];
    s->has_outputs = 0;
}

int instance_initialize(Instance *s) {
    Table *x = s->table;
    const int64_t mode = x->mode;
    double *values = malloc((x->values.size + 1) * sizeof(double));
    if (!values) return fail(s, "Out of memory at t = %.9g s.", x->t);
    copy((Reals){values, x->values.size}, x->values);
    load_model(s);
    copy(x->values, (Reals){values, x->values.size});
    free(values);
    x->mode = mode;
    x->is_initialized = 1;
    refresh_numbers(s);
    return restart(s);
}

int report_step(Instance *s, int code) {
    const double t = s->table->t;
    if (code == NOT_CONVERGED)
        return fail(s, "Newton's iteration did not converge at t = %.9g s; check inputs and "
                       "parameters, or export the model with a smaller step or rtol.", t);
    if (code == NOT_FINITE)
        return fail(s, "The residual is not finite at t = %.9g s; check inputs and "
                       "parameters.", t);
    if (code == SINGULAR)
        return fail(s, "The matrix is singular or not finite at t = %.9g s; check inputs and "
                       "parameters, or export the model with a smaller step or rtol.", t);
    if (code < 0)
        return fail(s, "The error test failed at the smallest step at t = %.9g s; check inputs "
                       "and parameters, or export the model with a larger rtol.", t);
    return 0;
}

/* Make accelerations and multipliers consistent with the present values. */
static int follow_values(Instance *s) {
    Table *x = s->table;
    if (!x->is_initialized) return instance_initialize(s);
    if (!x->has_jumped) return 0;
    x->has_jumped = s->has_outputs = 0;
    return method_follow_values(s);
}

int advance(Instance *s, double end) {
    Table *x = s->table;
    const double tolerance = SAME_TIME * model.step;
    s->has_outputs = 0;
    /* A breakpoint at the end is left to the next call, whose inputs may differ. */
    while (x->interval < x->breakpoints.size &&
           x->breakpoints.at[x->interval] < end - tolerance) {
        if (method_advance(s, x->breakpoints.at[x->interval])) return -1;
        method_evaluate(s);
        copy(x->q, x->inputs);
        copy(x->v, from(x->inputs, x->n));
        x->t += x->offset;
        x->offset = 0.0;
        x->interval++;
        set_branch(x);
        if (restart(s)) return -1;
    }
    return method_advance(s, end);
}

int instance_advance(Instance *s, double end) {
    if (follow_values(s)) return -1;
    if (!(end - instance_time(s) <= MAX_STEPS * model.step))
        return fail(s, "The communication step at t = %.9g s is longer than 1e9 steps of the "
                       "model; use shorter communication steps.", instance_time(s));
    if (end > s->stop + SAME_END * model.step)
        return fail(s, "The communication step ends at t = %.9g s, after the stop time of the "
                       "experiment; begin with a later stop time, or without one.", end);
    method_begin_step(s);
    return advance(s, end);
}

double instance_time(const Instance *s) { return s->table->t + s->table->offset; }

int instance_set_value(Instance *s, Index value, double number) {
    Table *x = s->table;
    if (!isfinite(number)) {
        snprintf(s->message, MESSAGE_SIZE, "%s: the value must be finite.",
                 model.value_names[value]);
        return -1;
    }
    const double low = x->min_values.at[value], high = x->max_values.at[value];
    if (number < low || number > high) {
        snprintf(s->message, MESSAGE_SIZE,
                 "%s: the value %.9g is outside the range for which the equations were verified, "
                 "%.9g to %.9g.", model.value_names[value], number, low, high);
        return -1;
    }
    if (x->values.at[value] == number) return 0;
    if (x->has_stepped && method_prepare_change(s)) return -1;
    x->values.at[value] = number;
    /* Accelerations and reactions depend on the values; before the first step, positions and
       velocities do, too. */
    if (x->has_stepped)
        x->has_jumped = 1;
    else
        x->is_initialized = 0;
    refresh_numbers(s);
    return 0;
}

const double *instance_outputs(Instance *s) {
    Table *x = s->table;
    if (!s->has_outputs) {
        if (follow_values(s)) return NULL;
        method_evaluate(s);
        set_time(&x->output, instance_time(s), x->branch);
        evaluate_sum(&x->output, x->inputs, x->outputs);
        s->has_outputs = 1;
    }
    return x->outputs.at;
}

void write_direction(Instance *s, const double *direction, double *dp) {
    Table *x = s->table;
    copy(x->direction, x->values);
    copy(from(x->direction, x->values.size), (Reals){(double *)direction, x->values.size});
    if (x->numbers.size) model.write_direction(x->direction.at, NULL, x->numbers.at, LANES);
    for (int64_t k = 0; k < x->number_targets.size; k++)
        dp[x->number_targets.at[k]] = x->numbers.at[LANES * k];
}

int instance_derivative(Instance *s, const double *direction, double *result) {
    Table *x = s->table;
    if (!x->has_stepped)
        return fail(s, "Directional derivatives exist after the first step, not at t = %.9g s.",
                    x->t);
    if (follow_values(s)) return -1;
    void *state = malloc(instance_state_size());
    if (!state) return fail(s, "Out of memory at t = %.9g s.", x->t);
    memcpy(state, x, instance_state_size());
    const int code = method_derivative(s, direction, (Reals){result, x->outputs.size});
    memcpy(x, state, instance_state_size());
    refresh_numbers(s);
    free(state);
    return code;
}
