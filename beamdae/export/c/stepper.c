/* Generalized-alpha steps of an exported model, in the index-3 form.

   Method, scaling, Newton's iteration and starting values are those of beamdae's GeneralizedAlpha:
   Arnold & Bruls, Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0. */

#include "stepper.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Newton's iteration; see beamdae.integrators.compiled_run. */
#define KEEP_RATE 0.05
#define SLOW_RATE 0.2
#define MAX_CORRECTION_GROWTH 2.0
#define MIN_RATE 1e-4
#define MIN_FIRST_RATE 1e-2
#define MAX_ITERATIONS 12
/* Starting values; see beamdae.integrators.alpha.family. */
#define JERK_INTERVAL 1e-2
#define STIFF_TIME 0.5
/* Positions and friction; see beamdae.equations.starts.consistent_start. */
#define POSITION_TOLERANCE 1e-12
#define RIGID_TIME 1.0
#define MAX_POSITION_ITERATIONS 50
#define MAX_FRICTION_ITERATIONS 50
#define FRICTION_TOLERANCE 1e-10
/* Accuracy of solutions; see beamdae.linear.elimination. */
#define MAX_BACKWARD_ERROR 1e-10
#define MAX_REFINEMENTS 2
/* Difference of equal times relative to the step, and relative difference of equal steps. */
#define SAME_TIME 1e-6
#define SAME_STEP 1e-9
/* Rounding errors of the length of a step, relative to the time at its end. */
#define TIME_ROUNDING (4.0 * DBL_EPSILON)
/* Shortest step, relative to the internal step. Rounding errors of positions, divided by the square
   of the step, are errors of accelerations and reactions. */
#define MIN_STEP_SHARE 1e-2
/* Largest number of internal steps in a communication step. */
#define MAX_STEPS 1e9

enum { DONE = 0, NOT_CONVERGED = 1, NOT_FINITE = 2, SINGULAR = 3 };
/* Indices of the shared numbers of matrices; see beamdae.symbolic.local_symbols. */
enum { TIME, BRANCH, C_Q, C_V, C_A, C_L, C_H, C_R };

typedef struct {
    const Plan *plan;
    double *shared, *local, *out;
} Sum;

typedef struct {
    const Pattern *pattern;
    double *nonzeros, *upper, *lower, *inverse, *x;
    double *solution, *right, *residual, *terms;
    /* Factors with row exchanges, row by row; allocated when first needed. */
    double *dense;
    Index *pivots;
    int refinements, is_dense;
} Factors;

/* Numbers of the state that are not in arrays. */
typedef struct {
    double t, offset, branch, h, step_ratio, rate;
    Index interval;
    int is_initialized, has_factors, has_stepped, has_jumped, follows_jump, mode;
} Scalars;

struct Instance {
    const Model *model;
    Scalars now;
    /* State: arrays in one block, from q to nonzeros. */
    double *block;
    size_t n_state;
    double *q, *v, *ddq, *a, *lam, *ddq_n, *lam_n, *values, *start, *jump, *nonzeros;
    /* Work arrays. */
    double *p, *a_predicted, *first_iterate, *change, *motion, *levels, *rate, *solution;
    double *at_q, *at_v, *at_a, *x;
    double *outputs, *jerk, *numbers;
    double c_v, c_a, c_f, correction_limit;
    int fixed_iterations, has_outputs;
    unsigned long pivot_searches;
    Factors step_factors, derivative_factors, saddle_factors;
    Sum residual, matrix, motion_sum, saddle, output_sum, residual_direction, output_direction;
    double *allocated[64];
    int n_allocated;
    char message[MESSAGE_SIZE];
};

/* Memory */

static double *new_array(Instance *s, size_t size, int *failed) {
    double *array = calloc(size + 1, sizeof(double));
    if (!array || s->n_allocated == 64) {
        *failed = 1;
        free(array);
        return NULL;
    }
    s->allocated[s->n_allocated++] = array;
    return array;
}

static void create_sum(Instance *s, Sum *sum, const Plan *plan, int *failed) {
    sum->plan = plan;
    sum->shared = new_array(s, plan->n_shared, failed);
    sum->local = new_array(s, plan->n_local, failed);
    sum->out = new_array(s, plan->n_out, failed);
}

static void create_factors(Instance *s, Factors *f, const Pattern *pattern, int *failed) {
    f->pattern = pattern;
    f->upper = new_array(s, pattern->n_upper, failed);
    f->lower = new_array(s, pattern->n_lower, failed);
    double *work = new_array(s, 6 * (size_t)pattern->size, failed);
    if (!work) return;
    f->inverse = work, work += pattern->size;
    f->x = work, work += pattern->size;
    f->solution = work, work += pattern->size;
    f->right = work, work += pattern->size;
    f->residual = work, work += pattern->size;
    f->terms = work;
}

static int fail(Instance *s, const char *text, double t) {
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

static void evaluate(const Sum *sum, const double *x, double *result) {
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

static void set_time(const Sum *sum, double t, double branch) {
    sum->shared[TIME] = t;
    sum->shared[BRANCH] = branch;
}

static void set_factors(const Sum *sum, double c_q, double c_v, double c_a, double c_h,
                        double c_r) {
    double *c = sum->shared;
    c[C_Q] = c_q, c[C_V] = c_v, c[C_A] = c_a, c[C_L] = 1.0, c[C_H] = c_h, c[C_R] = c_r;
}

/* Linear equations */

static int eliminate(Factors *f) {
    const Pattern *at = f->pattern;
    double *x = f->x;
    for (Index j = 0; j < at->size; j++) x[j] = 0.0;
    for (Index j = 0; j < at->size; j++) {
        for (Index e = at->starts[j]; e < at->starts[j + 1]; e++)
            x[at->positions[e]] = f->nonzeros[at->sources[e]];
        for (Index p = at->upper_starts[j]; p < at->upper_starts[j + 1]; p++) {
            const Index k = at->upper_rows[p];
            const double factor = x[k];
            x[k] = 0.0;
            f->upper[p] = factor;
            for (Index q = at->lower_starts[k]; q < at->lower_starts[k + 1]; q++)
                x[at->lower_rows[q]] -= f->lower[q] * factor;
        }
        const double inverse = 1.0 / x[j];
        if (!isfinite(inverse) || inverse == 0.0) return 0;
        f->inverse[j] = inverse;
        x[j] = 0.0;
        for (Index q = at->lower_starts[j]; q < at->lower_starts[j + 1]; q++) {
            f->lower[q] = x[at->lower_rows[q]] * inverse;
            x[at->lower_rows[q]] = 0.0;
        }
    }
    return 1;
}

static void substitute(Factors *f, double *right) {
    const Pattern *at = f->pattern;
    const Index size = at->size;
    double *x = f->x;
    for (Index k = 0; k < size; k++) x[k] = right[at->order[k]];
    for (Index k = 0; k < size; k++) {
        const double value = x[k];
        for (Index q = at->lower_starts[k]; q < at->lower_starts[k + 1]; q++)
            x[at->lower_rows[q]] -= f->lower[q] * value;
    }
    for (Index k = size; k-- > 0;) {
        const double value = x[k] * f->inverse[k];
        x[k] = value;
        for (Index p = at->upper_starts[k]; p < at->upper_starts[k + 1]; p++)
            x[at->upper_rows[p]] -= f->upper[p] * value;
    }
    for (Index k = 0; k < size; k++) right[at->order[k]] = x[k];
}

/* Elimination of the full matrix with partial pivoting and scaled rows. */
static int eliminate_dense(Factors *f) {
    const Pattern *at = f->pattern;
    const size_t size = at->size;
    if (!f->dense) {
        f->dense = malloc(size * size * sizeof(double));
        f->pivots = malloc(size * sizeof(Index));
        if (!f->dense || !f->pivots) return 0;
    }
    double *a = f->dense, *scale = f->terms;
    memset(a, 0, size * size * sizeof(double));
    for (size_t j = 0; j < size; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            a[at->matrix_rows[e] * size + j] = f->nonzeros[e];
    for (size_t i = 0; i < size; i++) {
        scale[i] = 0.0;
        for (size_t j = 0; j < size; j++) scale[i] = fmax(scale[i], fabs(a[i * size + j]));
        scale[i] = 1.0 / scale[i];
        if (!isfinite(scale[i]) || scale[i] == 0.0) return 0;
    }
    for (size_t k = 0; k < size; k++) {
        size_t best = k;
        for (size_t i = k + 1; i < size; i++)
            if (fabs(a[i * size + k]) * scale[i] > fabs(a[best * size + k]) * scale[best]) best = i;
        f->pivots[k] = (Index)best;
        if (best != k) {
            for (size_t j = 0; j < size; j++) {
                const double swap = a[k * size + j];
                a[k * size + j] = a[best * size + j];
                a[best * size + j] = swap;
            }
            scale[best] = scale[k];
        }
        const double inverse = 1.0 / a[k * size + k];
        if (!isfinite(inverse) || inverse == 0.0) return 0;
        for (size_t i = k + 1; i < size; i++) {
            const double factor = a[i * size + k] * inverse;
            a[i * size + k] = factor;
            if (factor == 0.0) continue;
            for (size_t j = k + 1; j < size; j++) a[i * size + j] -= factor * a[k * size + j];
        }
    }
    return 1;
}

static void substitute_dense(Factors *f, double *right) {
    const size_t size = f->pattern->size;
    const double *a = f->dense;
    for (size_t k = 0; k < size; k++) {
        const double swap = right[k];
        right[k] = right[f->pivots[k]];
        right[f->pivots[k]] = swap;
    }
    for (size_t i = 1; i < size; i++)
        for (size_t j = 0; j < i; j++) right[i] -= a[i * size + j] * right[j];
    for (size_t i = size; i-- > 0;) {
        for (size_t j = i + 1; j < size; j++) right[i] -= a[i * size + j] * right[j];
        right[i] /= a[i * size + i];
    }
}

static void substitute_any(Factors *f, double *right) {
    if (f->is_dense)
        substitute_dense(f, right);
    else
        substitute(f, right);
}

/* Set `residual` to right - matrix x; return 1 if x is accurate (Oettli & Prager). */
static int update_residual(Factors *f, const double *x, const double *right) {
    const Pattern *at = f->pattern;
    for (Index i = 0; i < at->size; i++) {
        f->residual[i] = right[i];
        f->terms[i] = fabs(right[i]);
    }
    for (Index j = 0; j < at->size; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++) {
            const double term = f->nonzeros[e] * x[j];
            f->residual[at->matrix_rows[e]] -= term;
            f->terms[at->matrix_rows[e]] += fabs(term);
        }
    int is_accurate = 1;
    for (Index i = 0; i < at->size; i++)
        is_accurate &= fabs(f->residual[i]) <= MAX_BACKWARD_ERROR * f->terms[i];
    return is_accurate;
}

/* Set the number of refinements for a solution to which all columns contribute equally. */
static int set_refinements(Factors *f) {
    const Pattern *at = f->pattern;
    double *x = f->solution, *right = f->right;
    for (Index i = 0; i < at->size; i++) x[i] = right[i] = 0.0;
    for (Index j = 0; j < at->size; j++) {
        double largest = 0.0;
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            largest = fmax(largest, fabs(f->nonzeros[e]));
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            right[at->matrix_rows[e]] += f->nonzeros[e] / largest;
    }
    memcpy(f->residual, right, at->size * sizeof(double));
    for (f->refinements = 0; f->refinements <= MAX_REFINEMENTS; f->refinements++) {
        substitute_any(f, f->residual);
        for (Index i = 0; i < at->size; i++) x[i] += f->residual[i];
        if (update_residual(f, x, right)) return 1;
    }
    return 0;
}

static int factorize(Instance *s, Factors *f) {
    f->is_dense = 0;
    if (eliminate(f) && set_refinements(f)) return DONE;
    s->pivot_searches++;
    f->is_dense = 1;
    return eliminate_dense(f) && set_refinements(f) ? DONE : SINGULAR;
}

static void solve(Factors *f, double *right) {
    const Index size = f->pattern->size;
    if (f->refinements == 0) {
        substitute_any(f, right);
        return;
    }
    memcpy(f->right, right, size * sizeof(double));
    substitute_any(f, right);
    for (int k = 0; k < f->refinements; k++) {
        update_residual(f, right, f->right);
        substitute_any(f, f->residual);
        for (Index i = 0; i < size; i++) right[i] += f->residual[i];
    }
}

/* Equations of a step */

static void set_motion(Instance *s, double lam_factor) {
    const Index n = s->model->n, m = s->model->m;
    double *y = s->motion;
    for (Index i = 0; i < n; i++) {
        y[i] = s->at_q[i] + s->x[i];
        y[n + i] = s->at_v[i] + s->c_v * s->x[i];
        y[2 * n + i] = s->at_a[i] + s->c_a * s->x[i];
    }
    for (Index i = 0; i < m; i++) y[3 * n + i] = lam_factor * s->x[n + i];
}

static void scale_residual(const Instance *s, double *result) {
    const Model *model = s->model;
    for (Index i = 0; i < model->n; i++) result[i] *= s->c_f;
    for (Index k = 0; k < model->n_velocity_rows; k++) result[model->velocity_rows[k]] /= s->c_v;
}

static void evaluate_residual(Instance *s, double t) {
    set_time(&s->residual, t, s->now.branch);
    set_motion(s, 1.0 / s->c_f);
    evaluate(&s->residual, s->motion, s->change);
    scale_residual(s, s->change);
}

static int factorize_matrix(Instance *s, Factors *factors, double t) {
    set_time(&s->matrix, t, s->now.branch);
    set_factors(&s->matrix, s->c_f, s->c_f * s->c_v, s->c_f * s->c_a, 1.0 / s->c_v, 1.0 / s->c_f);
    set_motion(s, 1.0);
    evaluate(&s->matrix, s->motion, factors->nonzeros);
    return factorize(s, factors);
}

static int factorize_step_matrix(Instance *s, double t) {
    const int code = factorize_matrix(s, &s->step_factors, t);
    s->now.has_factors = code == DONE;
    s->now.rate = code == DONE ? 0.0 : INFINITY;
    return code;
}

static void set_step(Instance *s, double h) {
    const Model *model = s->model;
    s->now.h = h;
    s->c_f = h * h * model->beta;
    s->c_v = model->gamma / (h * model->beta);
    s->c_a = (1.0 - model->alpha_m) / ((1.0 - model->alpha_f) * s->c_f);
}

static double correct(Instance *s) {
    const Model *model = s->model;
    double square = 0.0;
    solve(&s->step_factors, s->change);
    for (Index i = 0; i < model->n + model->m; i++) s->x[i] -= s->change[i];
    for (Index i = 0; i < model->n; i++) {
        const double weighted = s->change[i] * model->weights[i];
        square += weighted * weighted;
    }
    return sqrt(square);
}

static int iterate_newton(Instance *s, double t, int may_renew) {
    double previous = INFINITY;
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        evaluate_residual(s, t);
        const double size = correct(s);
        if (k == 0 && !isfinite(size)) return NOT_FINITE;
        if (!(size <= MAX_CORRECTION_GROWTH * previous)) return NOT_CONVERGED;
        if (k > 0) s->now.rate = previous > 0.0 ? fmax(size / previous, MIN_RATE) : 0.0;
        const double rate = k > 0 ? s->now.rate : fmax(s->now.rate, MIN_FIRST_RATE);
        if (rate < 1.0 && size * rate <= s->correction_limit * (1.0 - rate)) return DONE;
        if (may_renew && rate > SLOW_RATE) {
            const int code = factorize_step_matrix(s, t);
            if (code != DONE) return code;
        }
        previous = size;
    }
    return NOT_CONVERGED;
}

static int solve_step(Instance *s, double t) {
    const Model *model = s->model;
    const size_t bytes = (model->n + model->m) * sizeof(double);
    int code;
    if (s->fixed_iterations > 0) {
        double previous = INFINITY;
        code = factorize_step_matrix(s, t);
        for (int k = 0; k < s->fixed_iterations && code == DONE; k++) {
            evaluate_residual(s, t);
            const double size = correct(s);
            if (!isfinite(size))
                code = NOT_FINITE;
            else if (size > MAX_CORRECTION_GROWTH * previous && size > s->correction_limit)
                code = NOT_CONVERGED;
            previous = size;
        }
        return code;
    }
    memcpy(s->first_iterate, s->x, bytes);
    if (s->now.rate <= KEEP_RATE) {
        code = iterate_newton(s, t, 0);
        if (code == DONE || code == NOT_FINITE) return code;
    }
    for (int attempt = 0; attempt < 2; attempt++) {
        memcpy(s->x, s->first_iterate, bytes);
        if (attempt == 1) /* from uniform motion */
            for (Index i = 0; i < model->n; i++)
                s->x[i] = s->q[i] + s->now.h * s->v[i] - s->at_q[i];
        code = factorize_step_matrix(s, t);
        if (code == DONE) code = iterate_newton(s, t, 1);
        if (code == DONE || code == NOT_FINITE) return code;
    }
    return code;
}

static void pack_state(const Instance *s, double *y) {
    const Index n = s->model->n, m = s->model->m;
    memcpy(y, s->q, n * sizeof(double));
    memcpy(y + n, s->v, n * sizeof(double));
    memcpy(y + 2 * n, s->ddq, n * sizeof(double));
    memcpy(y + 3 * n, s->lam, m * sizeof(double));
}

static void set_correction_limit(Instance *s) {
    const Model *model = s->model;
    double largest = 0.0;
    for (Index i = 0; i < model->n; i++)
        largest = fmax(largest, fabs(s->ddq[i] * model->weights[i]));
    s->correction_limit =
        fmax(model->newton_tolerance * s->c_f * largest, model->min_correction_limit);
}

/* Let the equations of a step of length zero begin at y = (q, v, q'', lam). */
static void hold_motion(Instance *s, const double *y) {
    const Index n = s->model->n, m = s->model->m;
    const size_t bytes = n * sizeof(double);
    memcpy(s->at_q, y, bytes);
    memcpy(s->at_v, y + n, bytes);
    memcpy(s->at_a, y + 2 * n, bytes);
    memset(s->x, 0, bytes);
    for (Index i = 0; i < m; i++) s->x[n + i] = s->c_f * y[3 * n + i];
}

/* Change accelerations and multipliers after a jump of values; see apply_input_jump in
   beamdae.integrators.alpha.step_loop. */
static int apply_jump(Instance *s) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    pack_state(s, s->motion);
    hold_motion(s, s->motion);
    if (model->n_states) { /* The rows of first-order states are c_f (x' - f). */
        evaluate_residual(s, s->now.t);
        for (Index k = 0; k < model->n_states; k++) {
            const Index i = model->states[k];
            s->at_v[i] = s->v[i] -= s->change[i] / s->c_f;
        }
    }
    set_correction_limit(s);
    const int code = solve_step(s, s->now.t);
    if (code != DONE) return code;
    set_motion(s, 1.0 / s->c_f);
    memcpy(s->jump, s->motion, (3 * (size_t)n + m) * sizeof(double));
    s->now.follows_jump = 1;
    for (Index k = 0; k < model->n_states; k++) s->x[model->states[k]] = 0.0;
    for (Index i = 0; i < n; i++) {
        const double change = s->c_a * s->x[i];
        s->ddq[i] += change;
        s->a[i] += change;
        s->ddq_n[i] += change;
    }
    for (Index i = 0; i < m; i++) {
        const double lam = s->x[n + i] / s->c_f;
        s->lam_n[i] += lam - s->lam[i];
        s->lam[i] = lam;
    }
    s->now.has_jumped = 0;
    s->has_outputs = 0;
    return DONE;
}

static int advance_step(Instance *s, double t) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    const double h = s->now.h, r = s->now.step_ratio, beta = model->beta, gamma = model->gamma;
    const double factor = 1.0 / (1.0 - model->alpha_m);
    /* Where the accelerations at the beginning of the step were determined. */
    if (s->now.follows_jump)
        memcpy(s->start, s->jump, (3 * (size_t)n + m) * sizeof(double));
    else
        pack_state(s, s->start);
    set_correction_limit(s);
    for (Index i = 0; i < n; i++) {
        const double ddq = s->ddq[i], a = s->a[i];
        const double at_a = (1.0 + r) * ddq - r * s->ddq_n[i];
        const double predicted = factor * (1.0 - model->alpha_f) * at_a +
                                 factor * model->alpha_f * ddq - factor * model->alpha_m * a;
        s->at_q[i] = s->q[i] + h * s->v[i] + h * h * ((0.5 - beta) * a + beta * predicted);
        s->at_v[i] = s->v[i] + h * ((1.0 - gamma) * a + gamma * predicted);
        s->at_a[i] = at_a;
        s->a_predicted[i] = predicted;
        s->ddq_n[i] = ddq;
        s->x[i] = 0.0;
    }
    for (Index i = 0; i < m; i++) {
        s->x[n + i] = s->c_f * ((1.0 + r) * s->lam[i] - r * s->lam_n[i]);
        s->lam_n[i] = s->lam[i];
    }
    const int code = solve_step(s, t);
    if (code != DONE) return code;
    for (Index i = 0; i < n; i++) {
        s->q[i] = s->at_q[i] + s->x[i];
        s->v[i] = s->at_v[i] + s->c_v * s->x[i];
        s->ddq[i] = s->at_a[i] + s->c_a * s->x[i];
        s->a[i] = s->a_predicted[i] + s->x[i] / s->c_f;
    }
    for (Index i = 0; i < m; i++) s->lam[i] = s->x[n + i] / s->c_f;
    s->now.t = t;
    s->now.step_ratio = 1.0;
    s->now.follows_jump = 0;
    s->now.has_stepped = 1;
    s->has_outputs = 0;
    return DONE;
}

/* Consistent starting values, at the start and at breakpoints */

/* Evaluate (F, g, g', g'') in `levels`, and the saddle-point matrix if `coefficient` is not
   negative, with mass M + coefficient K. */
static int evaluate_motion(Instance *s, double t, const double *q, const double *v, const double *a,
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
    return factorize(s, &s->saddle_factors);
}

/* Solve [[M, G^T], [G, 0]] (x, mu) = (0, right) with the last factors; x is in `solution`. */
static void solve_constraints(Instance *s, const double *right, double sign) {
    const Index n = s->model->n, m = s->model->m;
    memset(s->solution, 0, n * sizeof(double));
    for (Index i = 0; i < m; i++) s->solution[n + i] = sign * right[i];
    solve(&s->saddle_factors, s->solution);
}

/* Close the gaps that the steps have left; see ConsistencySolver. */
static int close_joints(Instance *s) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    /* Gaps divided by the square of the step are errors of accelerations. */
    const double ratio = fmin(s->now.h / model->step, 1.0);
    const double tolerance = POSITION_TOLERANCE * fmax(1.0, model->length);
    double previous = INFINITY;
    for (int k = 0; k < MAX_POSITION_ITERATIONS && m > 0; k++) {
        double gap = 0.0;
        evaluate_motion(s, s->now.t, s->q, NULL, NULL, NULL, -1.0);
        for (Index i = 0; i < m; i++) gap = fmax(gap, fabs(s->levels[n + i]));
        if (gap <= tolerance * ratio * ratio || (gap <= tolerance && gap > 0.5 * previous)) break;
        previous = gap;
        if (evaluate_motion(s, s->now.t, s->q, NULL, NULL, NULL, RIGID_TIME * RIGID_TIME) != DONE)
            return SINGULAR;
        solve_constraints(s, s->levels + n, -1.0);
        for (Index i = 0; i < model->n_states; i++) s->solution[model->states[i]] = 0.0;
        for (Index i = 0; i < n; i++) s->q[i] += s->solution[i];
    }
    return DONE;
}

/* Accelerations and multipliers in `solution`; see ConsistencySolver.acceleration. */
static int solve_accelerations(Instance *s, double coefficient) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    double *lam = s->rate;
    memset(lam, 0, (m + 1) * sizeof(double));
    for (int k = 0; k < MAX_FRICTION_ITERATIONS; k++) {
        if (evaluate_motion(s, s->now.t, s->q, s->v, NULL, lam, coefficient) != DONE)
            return SINGULAR;
        for (Index i = 0; i < n; i++) s->solution[i] = -s->levels[i];
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
        double change = 0.0, size = 0.0;
        for (Index i = 0; i < m; i++) {
            change = fmax(change, fabs(s->solution[n + i] - lam[i]));
            size = fmax(size, fabs(s->solution[n + i]));
            lam[i] = s->solution[n + i];
        }
        if (change <= FRICTION_TOLERANCE * size) return DONE;
    }
    return NOT_CONVERGED;
}

/* Time derivative of g'' at constant acceleration, by a central difference, in `rate`. */
static void evaluate_constraint_rate(Instance *s, double delta) {
    const Index n = s->model->n, m = s->model->m;
    double *q = s->at_q, *v = s->at_v;
    for (int side = 1; side >= -1; side -= 2) {
        const double d = side * delta;
        for (Index i = 0; i < n; i++) {
            q[i] = s->q[i] + d * s->v[i] + 0.5 * d * d * s->ddq[i];
            v[i] = s->v[i] + d * s->ddq[i];
        }
        evaluate_motion(s, s->now.t + d, q, v, s->ddq, NULL, -1.0);
        for (Index i = 0; i < m; i++) {
            const double level = s->levels[n + 2 * m + i] / (2.0 * delta);
            s->rate[i] = side == 1 ? level : s->rate[i] - level;
        }
    }
}

/* Set accelerations, multipliers and starting values for steps of length h; see AlphaStart. */
static int restart(Instance *s, double h) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    const size_t bytes = n * sizeof(double);
    s->now.rate = INFINITY;
    s->now.has_factors = 0;
    s->now.has_jumped = s->now.follows_jump = 0;
    s->now.step_ratio = 0.0;
    set_step(s, h);
    int code = close_joints(s);
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
    code = solve_accelerations(s, 0.0);
    if (code != DONE) return code;
    memcpy(s->ddq, s->solution, bytes);
    memcpy(s->lam, s->solution + n, m * sizeof(double));
    memset(s->jerk, 0, bytes);
    memset(s->a_predicted, 0, bytes);
    if (m > 0) {
        evaluate_constraint_rate(s, JERK_INTERVAL * h);
        if (evaluate_motion(s, s->now.t, s->q, s->v, NULL, NULL, 0.0) != DONE) return SINGULAR;
        solve_constraints(s, s->rate, -1.0);
        memcpy(s->jerk, s->solution, bytes);
        memcpy(s->a_predicted, s->jerk, bytes);
        if (model->n_velocity_rows) { /* The jerk of holonomic constraints alone. */
            for (Index k = 0; k < model->n_velocity_rows; k++)
                s->rate[model->velocity_rows[k] - n] = 0.0;
            solve_constraints(s, s->rate, -1.0);
            memcpy(s->a_predicted, s->solution, bytes);
        }
    }
    code = solve_accelerations(s, STIFF_TIME * h * STIFF_TIME * h);
    if (code != DONE) return code;
    for (Index i = 0; i < n; i++) {
        s->ddq[i] = s->solution[i];
        s->a[i] = s->ddq[i] + model->shift * h * s->jerk[i];
        s->v[i] += h * h * model->defect * s->a_predicted[i];
    }
    for (Index i = 0; i < n; i++)
        if (!isfinite(s->a[i]) || !isfinite(s->v[i])) return NOT_FINITE;
    s->has_outputs = 0;
    return DONE;
}

static int restart_or_fail(Instance *s, double h) {
    const int code = restart(s, h);
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

static void refresh_numbers(Instance *s, int all) {
    const Model *model = s->model;
    const Sum *sums[] = {&s->residual,   &s->matrix,
                         &s->motion_sum, &s->saddle,
                         &s->output_sum, &s->residual_direction,
                         &s->output_direction};
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
    const size_t n = model->n, m = model->m, nnz = model->step_pattern.nnz;
    int failed = 0;
    if (!s) return NULL;
    s->model = model;
    s->n_state = 11 * n + 4 * m + model->n_values + nnz;
    double *x = s->block = new_array(s, s->n_state, &failed);
    if (failed) {
        instance_free(s);
        return NULL;
    }
    s->q = x, x += n, s->v = x, x += n, s->ddq = x, x += n, s->a = x, x += n;
    s->lam = x, x += m, s->ddq_n = x, x += n, s->lam_n = x, x += m;
    s->values = x, x += model->n_values;
    s->start = x, x += 3 * n + m, s->jump = x, x += 3 * n + m, s->nonzeros = x;
    s->p = new_array(s, model->n_p, &failed);
    s->at_q = new_array(s, n, &failed);
    s->at_v = new_array(s, n, &failed);
    s->at_a = new_array(s, n, &failed);
    s->x = new_array(s, n + m, &failed);
    s->a_predicted = new_array(s, n, &failed);
    s->first_iterate = new_array(s, n + m, &failed);
    s->change = new_array(s, n + m, &failed);
    s->motion = new_array(s, 2 * (3 * n + m) + model->n_p, &failed);
    s->levels = new_array(s, n + 3 * m, &failed);
    s->rate = new_array(s, m, &failed);
    s->solution = new_array(s, n + m, &failed);
    s->outputs = new_array(s, model->n_outputs, &failed);
    s->jerk = new_array(s, n, &failed);
    s->numbers = new_array(s, model->n_numbers, &failed);
    create_sum(s, &s->residual, &model->residual, &failed);
    create_sum(s, &s->matrix, &model->matrix, &failed);
    create_sum(s, &s->motion_sum, &model->motion, &failed);
    create_sum(s, &s->saddle, &model->saddle, &failed);
    create_sum(s, &s->output_sum, &model->outputs, &failed);
    create_sum(s, &s->residual_direction, &model->residual_direction, &failed);
    create_sum(s, &s->output_direction, &model->outputs_direction, &failed);
    create_factors(s, &s->step_factors, &model->step_pattern, &failed);
    create_factors(s, &s->derivative_factors, &model->step_pattern, &failed);
    create_factors(s, &s->saddle_factors, &model->saddle_pattern, &failed);
    s->step_factors.nonzeros = s->nonzeros;
    s->derivative_factors.nonzeros = new_array(s, nnz, &failed);
    s->saddle_factors.nonzeros = new_array(s, model->saddle_pattern.nnz, &failed);
    s->fixed_iterations = model->fixed_iterations;
    if (failed) {
        instance_free(s);
        return NULL;
    }
    instance_reset(s);
    return s;
}

void instance_free(Instance *s) {
    if (!s) return;
    Factors *factors[] = {&s->step_factors, &s->derivative_factors, &s->saddle_factors};
    for (int k = 0; k < 3; k++) {
        free(factors[k]->dense);
        free(factors[k]->pivots);
    }
    for (int k = 0; k < s->n_allocated; k++) free(s->allocated[k]);
    free(s);
}

const char *instance_message(const Instance *s) { return s->message; }

int instance_reset(Instance *s) {
    const Model *model = s->model;
    memset(s->block, 0, s->n_state * sizeof(double));
    memset(&s->now, 0, sizeof(s->now));
    s->message[0] = 0;
    memcpy(s->q, model->q, model->n * sizeof(double));
    memcpy(s->v, model->v, model->n * sizeof(double));
    if (model->n_values) memcpy(s->values, model->values, model->n_values * sizeof(double));
    if (model->n_p) memcpy(s->p, model->p, model->n_p * sizeof(double));
    s->now.rate = INFINITY;
    set_step(s, model->step);
    set_branch(s);
    refresh_numbers(s, 1);
    return 0;
}

int instance_initialize(Instance *s) {
    const Model *model = s->model;
    memcpy(s->q, model->q, model->n * sizeof(double));
    memcpy(s->v, model->v, model->n * sizeof(double));
    s->now.is_initialized = 1;
    return restart_or_fail(s, model->step);
}

static int report_step(Instance *s, int code) {
    if (code == NOT_CONVERGED)
        return fail(s, "Newton's iteration did not converge at t = %.9g s; export the model "
                       "with a smaller step, or check its inputs.", s->now.t);
    if (code == NOT_FINITE)
        return fail(s, "The residual is not finite at t = %.9g s; check inputs and "
                       "parameters.", s->now.t);
    if (code == SINGULAR)
        return fail(s, "The matrix is singular or not finite at t = %.9g s; export the model "
                       "with a smaller step, or check inputs and parameters.", s->now.t);
    return 0;
}

/* Make accelerations and multipliers consistent with the present values. */
static int follow_values(Instance *s) {
    if (!s->now.is_initialized) return instance_initialize(s);
    return s->now.has_jumped ? report_step(s, apply_jump(s)) : 0;
}

/* Positions and velocities of y after the offset of the time, at constant acceleration. */
static void extrapolate(const Instance *s, double *y) {
    const Index n = s->model->n;
    const double d = s->now.offset;
    for (Index i = 0; i < n; i++) {
        y[i] += d * y[n + i] + 0.5 * d * d * y[2 * n + i];
        y[n + i] += d * y[2 * n + i];
    }
}

/* Equal steps to `end` in one smooth interval. If `end` is too near for a step, the state remains
   that at the end of the last step, and the offset of `end` is stored. */
static int advance_smoothly(Instance *s, double end) {
    const double start = s->now.t, length = end - start, step = s->model->step;
    s->has_outputs = 0;
    s->now.offset = fmax(length, 0.0);
    if (length <= MIN_STEP_SHARE * step) return 0;
    const double count = fmax(ceil(length / step - SAME_TIME), 1.0);
    const double h = length / count, rounding = SAME_STEP * h + TIME_ROUNDING * fabs(end);
    s->now.offset = 0.0;
    if (fabs(h - s->now.h) > rounding ? restart_or_fail(s, h) : follow_values(s)) return -1;
    for (double k = 1.0; k <= count; k += 1.0)
        if (report_step(s, advance_step(s, k < count ? start + k * h : end))) return -1;
    return 0;
}

int instance_advance(Instance *s, double end) {
    const Model *model = s->model;
    if (!s->now.is_initialized && instance_initialize(s)) return -1;
    const double tolerance = SAME_TIME * model->step;
    if (!(end - s->now.t <= MAX_STEPS * model->step))
        return fail(s, "The communication step at t = %.9g s contains more than 1e9 internal "
                       "steps.", s->now.t);
    /* A breakpoint at the end is left to the next call, whose inputs may differ. */
    while (s->now.interval < model->n_breakpoints &&
           model->breakpoints[s->now.interval] < end - tolerance) {
        if (advance_smoothly(s, model->breakpoints[s->now.interval])) return -1;
        pack_state(s, s->motion);
        extrapolate(s, s->motion);
        memcpy(s->q, s->motion, model->n * sizeof(double));
        memcpy(s->v, s->motion + model->n, model->n * sizeof(double));
        s->now.t += s->now.offset;
        s->now.offset = 0.0;
        s->now.interval++;
        set_branch(s);
        if (restart_or_fail(s, s->now.h)) return -1;
    }
    return advance_smoothly(s, end);
}

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
        pack_state(s, s->motion);
        extrapolate(s, s->motion);
        set_time(&s->output_sum, instance_time(s), s->now.branch);
        evaluate(&s->output_sum, s->motion, s->outputs);
        s->has_outputs = 1;
    }
    return s->outputs;
}

/* Derivative of the scaled residual along the direction in `motion`, in `change`. */
static void evaluate_direction(Instance *s, double t) {
    set_motion(s, 1.0 / s->c_f);
    set_time(&s->residual_direction, t, s->now.branch);
    evaluate(&s->residual_direction, s->motion, s->change);
    scale_residual(s, s->change);
}

static int solve_direction(Instance *s, double t) {
    if (factorize_matrix(s, &s->derivative_factors, t) != DONE)
        return fail(s, "The matrix is singular at t = %.9g s.", t);
    evaluate_direction(s, t);
    solve(&s->derivative_factors, s->change);
    return 0;
}

int instance_derivative(Instance *s, const double *direction, double *result) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    if (!s->now.has_stepped)
        return fail(s, "Directional derivatives exist after the first step, not at t = %.9g s.",
                    s->now.t);
    if (follow_values(s)) return -1;
    /* Inputs of both sums: (q, v, a, lam), their derivatives, and those of p. */
    const size_t size = 3 * (size_t)n + m;
    const double h = s->now.h;
    double *y = s->motion, *dy = y + size, *dp = dy + size, *dx = s->change;
    memset(dy, 0, (size + model->n_p) * sizeof(double));
    if (model->n_numbers > 0) model->numbers_direction(s->values, direction, s->numbers);
    for (Index k = 0; k < model->n_numbers; k++) dp[model->number_targets[k]] = s->numbers[k];
    /* Accelerations at the beginning of the step. */
    hold_motion(s, s->start);
    if (model->n_states) {
        evaluate_direction(s, s->now.t - h);
        for (Index k = 0; k < model->n_states; k++) {
            const Index i = model->states[k];
            dy[n + i] = -dx[i] / s->c_f;
        }
    }
    if (solve_direction(s, s->now.t - h)) return -1;
    for (Index k = 0; k < model->n_states; k++) dx[model->states[k]] = 0.0;
    for (Index i = 0; i < n; i++) {
        const double change = -s->c_a * dx[i];
        dy[i] = h * dy[n + i] + 0.5 * h * h * change;
        dy[n + i] += h * change;
        dy[2 * n + i] = change;
    }
    /* Step. */
    pack_state(s, y);
    hold_motion(s, y);
    if (solve_direction(s, s->now.t)) return -1;
    for (Index i = 0; i < n; i++) {
        dy[i] -= dx[i];
        dy[n + i] -= s->c_v * dx[i];
        dy[2 * n + i] -= s->c_a * dx[i];
    }
    for (Index i = 0; i < m; i++) dy[3 * n + i] = -dx[n + i] / s->c_f;
    set_time(&s->output_direction, s->now.t, s->now.branch);
    evaluate(&s->output_direction, y, result);
    return 0;
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
    set_step(s, s->now.h);
    refresh_numbers(s, 0);
    /* Factors are a function of the matrix. */
    if (s->now.has_factors && factorize(s, &s->step_factors) != DONE)
        return fail(s, "The matrix of the state at t = %.9g s is singular.", s->now.t);
    return 0;
}

void instance_fix_iterations(Instance *s, int count) { s->fixed_iterations = count; }

unsigned long instance_pivot_searches(const Instance *s) { return s->pivot_searches; }
