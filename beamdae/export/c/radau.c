/* Adaptive steps of an exported model by three-stage Radau IIA, on the stabilized index-1 form.

   Stages, Newton's iteration, error estimate and step size control are those of beamdae's Radau;
   see beamdae.integrators.radau and Hairer & Wanner, Solving ODEs II, 1996, section IV.8.

   While inputs do not change, steps pass over communication points, at which outputs are evaluated
   on the polynomial of the step: the cost does not depend on the communication step. If an input
   changes inside such a step, the step is repeated up to the communication point with the values
   before the change. Later steps end at communication points as long as inputs change, because a
   longer step would be wasted. */

#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define STAGES 3
/* Newton's iteration; see beamdae.integrators.radau.stages. */
#define MAX_ITERATIONS 10
#define FIRST_RATE 0.99
#define MAX_SECOND_GROWTH 2.0
#define STAGNATION_RATE 0.5
#define POSITION_ROUNDING 0x1p-51
/* Step size control; see beamdae.integrators.radau.step_loop. */
#define ERROR_EXPONENT 0.25
#define SAFETY 0.9
#define MIN_FACTOR 0.2
#define MAX_FACTOR 4.0
#define MIN_ERROR 1e-2
#define KEPT_GROWTH 1.2
#define KEEP_RATE 0.05
#define STEP_ROUNDING 1e-9
#define FAILURE_FACTOR 0.5
#define RECOVERY_FACTOR 1.1
#define SLOW_RATE 0.2
/* Shortest step, relative to the time at its end. */
#define MIN_RELATIVE_STEP 1e-12
/* A step of at least this fraction of the rest of an interval ends at its end. */
#define LAST_STEP_MARGIN (1.0 - 1e-9)
/* Largest number of steps in a communication step. */
#define MAX_STEPS 1e6
/* Shortest step that ends at a communication point, relative to the step of the model. Rounding
   errors of positions, divided by the square of the step, are errors of accelerations. */
#define MIN_STEP_SHARE 1e-2
/* Friction; see beamdae.integrators.input_jumps. */
#define MAX_FRICTION_ITERATIONS 50
#define FRICTION_TOLERANCE 1e-10
/* Contacts that a step passes over; see beamdae.integrators.events.contact_onsets. */
#define MIN_DEPTH 1e-9
#define SAMPLES 17
#define REFINEMENTS 5
/* Newton's iteration for the derivatives of a step, which is linear. */
#define MAX_DERIVATIVE_ITERATIONS 200
#define DERIVATIVE_TOLERANCE 1e-12

/* Numbers of the state: length and start of the last step; see StepSizeState in
   beamdae.integrators.radau.workspace for those of the step size control. `is_quiet` is 1 if no
   value has changed since the last communication point. */
typedef struct {
    double h, start, next_step, newton_limit, last_step, last_error, is_retry;
    double factors_step, rate, iterations, is_quiet;
} Steps;

/* y = (q, v, integrals of lam, integrals of mu), where mu corrects q' = v; w are the unknowns of
   the stages y + T w; see beamdae.integrators.radau.coefficients. */
struct Method {
    Steps *now;
    /* State, after the numbers: y and y' at both ends of the last step, its w, the parts of the
       reduced matrices, and the motion and values at the last communication point but one.
       `tolerances` are those of the tested multipliers, which grow with the largest values. */
    double *y, *yp, *start_y, *start_yp, *last_w, *tolerances, *jacobian, *begin;
    /* Work arrays. */
    double *w, *stages, *rates, *residuals, *x, *real_change, *complex_change, *right;
    double *complex_right, *velocities, *difference, *vector, *product, *constraint_errors, *error;
    double *weights;
    /* Derivatives of y and, for the last step, of w; steps update them if `has_tangent` is 1. */
    double *tangent, *tangent_w;
    int has_tangent;
    double *gaps;
    Sum gap_sum;
    Factors real, complex_;
};

static size_t size_of(const Model *model) { return 2 * ((size_t)model->n + model->m); }

/* Size of the numbers and of the arrays up to `tolerances`. */
static size_t motion_size(const Model *model) {
    return sizeof(Steps) / sizeof(double) + (4 + STAGES) * size_of(model) + model->n_tested;
}

size_t method_state_size(const Model *model) {
    return 2 * motion_size(model) + 3 * (size_t)model->step_pattern.nnz + 1 +
           sizeof(Scalars) / sizeof(double) + 1 + model->n_values;
}

void method_create(Instance *s, int *failed) {
    const Model *model = s->model;
    const size_t size = size_of(model), reduced = model->step_pattern.size;
    Method *w = s->method = calloc(1, sizeof(Method));
    if (!w) {
        *failed = 1;
        return;
    }
    double *state = s->method_state;
    w->now = (Steps *)state, state += sizeof(Steps) / sizeof(double);
    w->y = state, state += size, w->yp = state, state += size;
    w->start_y = state, state += size, w->start_yp = state, state += size;
    w->last_w = state, state += STAGES * size;
    w->tolerances = state, state += model->n_tested;
    w->jacobian = state, state += 3 * (size_t)model->step_pattern.nnz + 1, w->begin = state;
    create_factors(s, &w->real, &model->step_pattern, 0, failed);
    create_factors(s, &w->complex_, &model->step_pattern, 1, failed);
    w->w = new_array(s, STAGES * size, failed);
    w->stages = new_array(s, STAGES * size, failed);
    w->rates = new_array(s, STAGES * size, failed);
    w->residuals = new_array(s, STAGES * size, failed);
    w->x = new_array(s, 4 * size + model->n_p, failed);
    w->real_change = new_array(s, size, failed);
    w->complex_change = new_array(s, 2 * size, failed);
    w->right = new_array(s, reduced, failed);
    w->complex_right = new_array(s, 2 * reduced, failed);
    w->velocities = new_array(s, model->n, failed);
    w->difference = new_array(s, size, failed);
    w->vector = new_array(s, reduced, failed);
    w->product = new_array(s, reduced, failed);
    w->constraint_errors = new_array(s, reduced, failed);
    w->error = new_array(s, size, failed);
    w->weights = new_array(s, 2 * (size_t)model->n, failed);
    w->tangent = new_array(s, size, failed);
    w->tangent_w = new_array(s, STAGES * size, failed);
    w->gaps = new_array(s, model->n_gaps, failed);
    create_sum(s, &w->gap_sum, &model->gaps, failed);
}

void method_free(Instance *s) {
    if (!s->method) return;
    free_factors(&s->method->real);
    free_factors(&s->method->complex_);
    free(s->method);
}

/* Stages */

/* Set the velocities in `w` that q' = v defines to the derivatives of the positions; `v` are the
   velocities at the beginning of the step. */
static void derive_velocities(const Instance *s, double h, const double *v, double *w) {
    const Model *model = s->model;
    const Tableau *at = &model->tableau;
    const Index n = model->n;
    const size_t size = size_of(model);
    double *w0 = w, *w1 = w0 + size, *w2 = w1 + size;
    for (Index k = 0; k < model->n_defined; k++) {
        const Index i = model->defined[k];
        w0[n + i] = at->real_eigenvalue / h * w0[i] - at->start[0] * v[i];
        const double re = w1[i], im = w2[i];
        w1[n + i] = (at->eigenvalue_re * re - at->eigenvalue_im * im) / h - at->start[1] * v[i];
        w2[n + i] = (at->eigenvalue_im * re + at->eigenvalue_re * im) / h - at->start[2] * v[i];
    }
}

/* Predict w from the polynomial of the last step, which begins at `base` times its length, or with
   constant y' in a first step. */
static void predict_stages(Instance *s, double h, double base) {
    const Tableau *at = &s->model->tableau;
    const size_t size = size_of(s->model);
    Method *m = s->method;
    const double *last = m->last_w, ratio = h / m->now->last_step;
    double factors[STAGES][STAGES] = {{0.0}};
    for (int k = 0; k < STAGES && m->now->last_step > 0.0; k++) {
        const double x = base + at->nodes[k] * ratio;
        for (int j = 0; j < STAGES; j++) {
            const double *p = at->polynomial + j;
            const double stage = (x - base) * p[0] + (x * x - base * base) * p[STAGES] +
                                 (x * x * x - base * base * base) * p[2 * STAGES];
            for (int i = 0; i < STAGES; i++) factors[i][j] += at->from_stages[STAGES * i + k] * stage;
        }
    }
    for (int i = 0; i < STAGES; i++)
        for (size_t k = 0; k < size; k++)
            m->w[i * size + k] = m->now->last_step > 0.0
                                     ? factors[i][0] * last[k] + factors[i][1] * last[size + k] +
                                           factors[i][2] * last[2 * size + k]
                                     : h * at->uniform[i] * m->yp[k];
    derive_velocities(s, h, m->y + s->model->n, m->w);
}

/* Write result = factors of three rows, (3, 3), times the rows of w. */
static void combine_rows(const double *factors, double divisor, const double *w, size_t size,
                         double *result) {
    for (int i = 0; i < STAGES; i++, factors += STAGES, result += size)
        for (size_t k = 0; k < size; k++)
            result[k] = (factors[0] * w[k] + factors[1] * w[size + k] +
                         factors[2] * w[2 * size + k]) / divisor;
}

static void set_stages(Instance *s, double h) {
    const Tableau *at = &s->model->tableau;
    const size_t size = size_of(s->model);
    Method *m = s->method;
    combine_rows(at->to_stages, 1.0, m->w, size, m->stages);
    for (size_t k = 0; k < STAGES * size; k++) m->stages[k] += m->y[k % size];
    combine_rows(at->rates, h, m->w, size, m->rates);
}

/* Non-zeros of the real and the complex matrix of a step from the parts of the reduced matrices. */
static int factorize_matrices(Instance *s, double h) {
    const Tableau *at = &s->model->tableau;
    Method *m = s->method;
    const size_t nnz = s->model->step_pattern.nnz;
    const double *k = m->jacobian, *d = k + nnz, *mass = d + nnz;
    const double rate = at->real_eigenvalue / h, re = at->eigenvalue_re / h;
    const double im = at->eigenvalue_im / h;
    for (size_t e = 0; e < nnz; e++) {
        m->real.nonzeros[e] = k[e] + rate * d[e] + rate * rate * mass[e];
        m->complex_.nonzeros[2 * e] = k[e] + re * d[e] + (re * re - im * im) * mass[e];
        m->complex_.nonzeros[2 * e + 1] = im * d[e] + 2.0 * re * im * mass[e];
    }
    m->now->factors_step = 0.0;
    if (!factorize(&m->real) || !factorize(&m->complex_)) return SINGULAR;
    m->now->factors_step = h;
    return DONE;
}

static void set_inputs(Method *m, const double *y, const double *yp, size_t size) {
    memcpy(m->x, y, size * sizeof(double));
    memcpy(m->x + size, yp, size * sizeof(double));
}

/* Evaluate and factorize both matrices at the second stage, which lies between the other two. */
static int renew_matrices(Instance *s, double t, double h) {
    Method *m = s->method;
    const size_t size = size_of(s->model);
    set_inputs(m, m->stages + size, m->rates + size, size);
    set_time(&s->matrix, t + s->model->tableau.nodes[1] * h, s->now.branch);
    set_factors(&s->matrix, 1.0, 1.0, 1.0, 1.0, 1.0);
    evaluate(&s->matrix, m->x, m->jacobian);
    return factorize_matrices(s, h);
}

static void evaluate_residual(Instance *s, double t, const double *y, const double *yp,
                              double *result) {
    const Index n = s->model->n;
    set_inputs(s->method, y, yp, size_of(s->model));
    set_time(&s->residual, t, s->now.branch);
    evaluate(&s->residual, s->method->x, result);
    for (Index i = 0; i < n; i++) result[i] += yp[i] - y[n + i];
}

/* Entries of a right-hand side that remain in the reduced equations, `width` numbers each. */
static void reduce_right(const Model *model, size_t width, const double *full, double *reduced) {
    const size_t n = model->n, corrected = model->n_corrected, bytes = width * sizeof(double);
    memcpy(reduced, full + width * n, n * bytes);
    for (size_t k = 0; k < corrected; k++)
        memcpy(reduced + width * (n + k), full + width * model->corrected[k], bytes);
    memcpy(reduced + width * (n + corrected), full + width * 2 * n, 2 * model->m * bytes);
}

/* Correction of all unknowns, with x_v = c x_q for defined velocities, c = re + i im. */
static void expand_solution(const Model *model, size_t width, double re, double im,
                            const double *reduced, double *full) {
    const size_t n = model->n, corrected = model->n_corrected, bytes = width * sizeof(double);
    memcpy(full, reduced, n * bytes);
    for (size_t i = 0; i < n; i++) {
        const double *x = reduced + width * i;
        double *v = full + width * (n + i);
        v[0] = width == 2 ? re * x[0] - im * x[1] : re * x[0];
        if (width == 2) v[1] = re * x[1] + im * x[0];
    }
    for (size_t k = 0; k < corrected; k++)
        memcpy(full + width * (n + model->corrected[k]), reduced + width * (n + k), bytes);
    memcpy(full + width * 2 * n, reduced + width * (n + corrected), 2 * model->m * bytes);
}

/* Subtract the corrections that belong to `residuals` from `w`. */
static void correct_stages(Instance *s, double h, double *w) {
    const Model *model = s->model;
    const Tableau *at = &model->tableau;
    const size_t size = size_of(model);
    Method *m = s->method;
    const double *r0 = m->residuals, *r1 = r0 + size, *r2 = r1 + size, *t = at->from_stages;
    for (size_t k = 0; k < size; k++) {
        m->real_change[k] = t[0] * r0[k] + t[1] * r1[k] + t[2] * r2[k];
        m->complex_change[2 * k] = t[3] * r0[k] + t[4] * r1[k] + t[5] * r2[k];
        m->complex_change[2 * k + 1] = t[6] * r0[k] + t[7] * r1[k] + t[8] * r2[k];
    }
    reduce_right(model, 1, m->real_change, m->right);
    solve(&m->real, m->right);
    expand_solution(model, 1, at->real_eigenvalue / h, 0.0, m->right, m->real_change);
    reduce_right(model, 2, m->complex_change, m->complex_right);
    solve(&m->complex_, m->complex_right);
    expand_solution(model, 2, at->eigenvalue_re / h, at->eigenvalue_im / h, m->complex_right,
                    m->complex_change);
    for (size_t k = 0; k < size; k++) {
        w[k] -= m->real_change[k];
        w[size + k] -= m->complex_change[2 * k];
        w[2 * size + k] -= m->complex_change[2 * k + 1];
    }
}

/* Largest weighted correction of the first `count` positions and velocities. */
static double measure_change(const Instance *s, const double *weights, Index count) {
    const Method *m = s->method;
    double largest = 0.0;
    for (Index k = 0; k < count; k++) {
        const double pair = hypot(m->complex_change[2 * k], m->complex_change[2 * k + 1]);
        const double size = fmax(fabs(m->real_change[k]), pair) * weights[k];
        if (!(size <= largest)) largest = size;
        if (isnan(size)) return size;
    }
    return largest;
}

/* Return 1 if rounding errors of the residual explain corrections of a weighted size; see
   _is_rounding in stages.py. */
static int is_rounding(Instance *s, double h, double change) {
    const Model *model = s->model;
    const Pattern *at = &model->step_pattern;
    Method *m = s->method;
    const double *q = m->stages + size_of(model);
    if (measure_change(s, m->weights, model->n) > model->stagnation_limit) return 0;
    memset(m->right, 0, at->size * sizeof(double));
    for (Index j = 0; j < model->n; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            m->right[at->matrix_rows[e]] += POSITION_ROUNDING * fabs(m->jacobian[e] * q[j]);
    solve(&m->real, m->right);
    expand_solution(model, 1, model->tableau.real_eigenvalue / h, 0.0, m->right, m->error);
    double largest = 0.0;
    for (Index k = 0; k < 2 * model->n; k++)
        largest = fmax(largest, fabs(m->error[k]) * m->weights[k]);
    return change <= largest;
}

/* Solve for the stages of a step `h`; `renew` requests new factors. */
static int solve_stages(Instance *s, double h, int renew, double base) {
    const Model *model = s->model;
    const size_t size = size_of(model);
    Method *m = s->method;
    predict_stages(s, h, base);
    set_stages(s, h);
    const double h_rounding = h / model->rounding_ratio;
    for (Index i = 0; i < model->n; i++) {
        m->weights[i] = model->iteration_weights[i];
        m->weights[model->n + i] = fmin(model->iteration_weights[model->n + i],
                                        h_rounding * model->rounding_weights[i]);
    }
    if (renew) {
        const int code = renew_matrices(s, s->now.t, h);
        if (code != DONE) return code;
    }
    double previous = INFINITY, rate = FIRST_RATE, last_rate = 0.0;
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        m->now->iterations = k + 1;
        if (k > 0) set_stages(s, h);
        for (int i = 0; i < STAGES; i++)
            evaluate_residual(s, s->now.t + model->tableau.nodes[i] * h, m->stages + i * size,
                              m->rates + i * size, m->residuals + i * size);
        correct_stages(s, h, m->w);
        const double change = measure_change(s, m->weights, 2 * model->n);
        if (!isfinite(change)) return NOT_FINITE;
        if (k > 0) {
            rate = previous > 0.0 ? change / previous : 0.0;
            if (rate > STAGNATION_RATE) {
                const int rounding = is_rounding(s, h, change);
                if (rounding || change <= model->stagnation_limit) {
                    /* Rounding errors do not indicate how fast the iteration converged. */
                    m->now->rate = rounding ? last_rate : rate;
                    return DONE;
                }
            }
            if (rate > (k == 1 ? MAX_SECOND_GROWTH : 1.0)) break;
        }
        if (rate < 1.0 && change * rate <= 1.0 - rate) {
            m->now->rate = k > 0 ? rate : 0.0;
            return DONE;
        }
        if (k > 0) last_rate = rate;
        previous = change;
    }
    return NOT_CONVERGED;
}

/* Product of a part of the reduced matrix with `vector`. */
static void multiply_part(const Instance *s, int power, const double *vector, double *result) {
    const Pattern *at = &s->model->step_pattern;
    const double *values = s->method->jacobian + power * (size_t)at->nnz;
    memset(result, 0, at->size * sizeof(double));
    for (Index j = 0; j < at->size; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            result[at->matrix_rows[e]] += values[e] * vector[j];
}

/* Return the error relative to the tolerance; see estimate_error in stages.py. */
static double estimate_error(Instance *s, double h) {
    const Model *model = s->model;
    const Tableau *at = &model->tableau;
    const size_t n = model->n, size = size_of(model), corrected = model->n_corrected;
    const double rate = at->real_eigenvalue / h;
    Method *m = s->method;
    const double *w = m->w;
    double *e = m->difference, *right = m->right;
    for (size_t k = 0; k < size; k++)
        e[k] = m->yp[k] / rate + at->embedded[0] * w[k] + at->embedded[1] * w[size + k] +
               at->embedded[2] * w[2 * size + k];
    memset(m->vector, 0, model->step_pattern.size * sizeof(double));
    for (size_t i = 0; i < n; i++) m->vector[i] = e[n + i] + rate * e[i];
    multiply_part(s, 2, m->vector, right);
    multiply_part(s, 1, m->vector, m->constraint_errors);
    memcpy(m->vector, e, n * sizeof(double));
    for (size_t k = 0; k < corrected; k++) m->vector[n + k] = e[n + model->corrected[k]];
    memcpy(m->vector + n + corrected, e + 2 * n, 2 * (size_t)model->m * sizeof(double));
    multiply_part(s, 1, m->vector, m->product);
    for (size_t i = 0; i < model->step_pattern.size; i++)
        right[i] = rate * (right[i] + m->product[i]);
    multiply_part(s, 0, m->vector, m->product);
    for (size_t i = n + corrected; i < model->step_pattern.size; i++)
        right[i] += m->constraint_errors[i] + m->product[i];
    solve(&m->real, right);
    expand_solution(model, 1, rate, 0.0, right, m->error);
    for (Index k = 0; k < model->n_defined; k++) {
        const size_t i = model->defined[k];
        m->error[n + i] = rate * (right[i] - e[i]);
    }
    double largest = 0.0;
    for (size_t k = 0; k < 2 * n; k++) {
        double weight = model->test_weights[k];
        /* Rounding errors of positions divided by a short step are errors of velocities. */
        if (k >= n) weight = fmin(weight, h * model->rounding_weights[k - n]);
        const double error = fabs(m->error[k]) * weight;
        if (isnan(error)) return error;
        largest = fmax(largest, error);
    }
    for (Index k = 0; k < model->n_tested && h > model->shortest_tested_step; k++) {
        /* The estimate is that of their integrals over the step. */
        const double error = fabs(m->error[2 * n + k]) * rate / m->tolerances[k];
        if (isnan(error)) return error;
        largest = fmax(largest, error);
    }
    return largest;
}

/* Values at x, relative to the start of the last step: the start value, if `start` is not NULL, and
   the polynomial of w; `rates` are their time derivatives. */
static void evaluate_polynomial(const Instance *s, double x, const double *start, const double *w,
                                size_t k, double *value, double *rate) {
    const double *p = s->model->tableau.polynomial;
    const size_t size = size_of(s->model);
    double result = 0.0, slope = 0.0;
    for (int j = 0; j < STAGES; j++) {
        const double factor = w[j * size + k];
        result += x * (p[j] + x * (p[STAGES + j] + x * p[2 * STAGES + j])) * factor;
        slope += (p[j] + x * (2.0 * p[STAGES + j] + x * 3.0 * p[2 * STAGES + j])) * factor;
    }
    *value = (start ? start[k] : 0.0) + result;
    *rate = slope / s->method->now->h;
}

/* Positions, velocities, accelerations and multipliers at x of the last step. */
static void evaluate_step(const Instance *s, double x, const double *start, const double *w,
                          double *motion) {
    const size_t n = s->model->n, m = s->model->m;
    double unused;
    for (size_t i = 0; i < n; i++) {
        evaluate_polynomial(s, x, start, w, i, &motion[i], &unused);
        evaluate_polynomial(s, x, start, w, n + i, &motion[n + i], &motion[2 * n + i]);
    }
    for (size_t i = 0; i < m; i++)
        evaluate_polynomial(s, x, start, w, 2 * n + i, &unused, &motion[3 * n + i]);
}

/* Smallest gap of contact `k` at samples of the current step from *left to *right, relative to its
   start; the neighbors of the smallest sample replace *left and *right. */
static double sample_gap(Instance *s, double h, Index k, double *left, double *right) {
    Method *m = s->method;
    const double first = *left, spacing = (*right - *left) / (SAMPLES - 1);
    double lowest = INFINITY, unused;
    for (int i = 0; i < SAMPLES; i++) {
        const double x = first + i * spacing;
        for (Index j = 0; j < s->model->n; j++)
            evaluate_polynomial(s, x, m->y, m->w, j, &m->x[j], &unused);
        set_time(&m->gap_sum, s->now.t + x * h, s->now.branch);
        evaluate(&m->gap_sum, m->x, m->gaps);
        if (!(m->gaps[k] < lowest)) continue;
        lowest = m->gaps[k];
        *left = fmax(x - spacing, 0.0);
        *right = fmin(x + spacing, 1.0);
    }
    return lowest;
}

/* Return 1 if a contact is open at the start and at all stages of the current step, but closed in
   between: its force is zero wherever it was evaluated. */
static int passes_contact(Instance *s, double h) {
    const Model *model = s->model;
    Method *m = s->method;
    const size_t size = size_of(model);
    const double depth = MIN_DEPTH * model->length;
    for (Index k = 0; k < model->n_gaps; k++) {
        int is_open = 1;
        for (int i = -1; i < STAGES; i++) {
            const double *q = i < 0 ? m->y : m->stages + i * size;
            memcpy(m->x, q, model->n * sizeof(double));
            set_time(&m->gap_sum, s->now.t + (i < 0 ? 0.0 : model->tableau.nodes[i] * h),
                     s->now.branch);
            evaluate(&m->gap_sum, m->x, m->gaps);
            is_open &= m->gaps[k] > 0.0;
        }
        double left = 0.0, right = 1.0;
        for (int i = 0; i <= REFINEMENTS && is_open; i++) {
            const double spacing = (right - left) / (SAMPLES - 1);
            if (sample_gap(s, h, k, &left, &right) < -depth) return 1;
            /* The gap is smallest at an end of the step. */
            if (right - left < 1.5 * spacing) break;
        }
    }
    return 0;
}

/* Update the derivatives at the end of a step `h`, by Newton's iteration with the matrices of this
   step, whose stages are known. */
static int differentiate_step(Instance *s, double h) {
    const Model *model = s->model;
    const Tableau *at = &model->tableau;
    const size_t size = size_of(model), n = model->n;
    Method *m = s->method;
    double *y = m->tangent, *w = m->tangent_w, *dy = m->x + 2 * size, *dyp = dy + size, total = 0.0;
    if (renew_matrices(s, s->now.t, h) != DONE) return SINGULAR;
    memset(w, 0, STAGES * size * sizeof(double));
    derive_velocities(s, h, y + n, w);
    for (int k = 0; k < MAX_DERIVATIVE_ITERATIONS; k++) {
        for (int i = 0; i < STAGES; i++) {
            const double *to = at->to_stages + STAGES * i, *rates = at->rates + STAGES * i;
            double *residual = m->residuals + i * size;
            set_inputs(m, m->stages + i * size, m->rates + i * size, size);
            for (size_t j = 0; j < size; j++) {
                const double *x = w + j;
                dy[j] = y[j] + to[0] * x[0] + to[1] * x[size] + to[2] * x[2 * size];
                dyp[j] = (rates[0] * x[0] + rates[1] * x[size] + rates[2] * x[2 * size]) / h;
            }
            set_time(&s->residual_direction, s->now.t + at->nodes[i] * h, s->now.branch);
            evaluate(&s->residual_direction, m->x, residual);
            for (size_t j = 0; j < n; j++) residual[j] += dyp[j] - dy[n + j];
        }
        correct_stages(s, h, w);
        const double change = measure_change(s, model->iteration_weights, 2 * model->n);
        total = fmax(total, change);
        if (!isfinite(change)) return NOT_FINITE;
        if (k > 0 && change <= DERIVATIVE_TOLERANCE * total) {
            const double *to = at->to_stages + 2 * STAGES;
            for (size_t j = 0; j < size; j++)
                y[j] += to[0] * w[j] + to[1] * w[size + j] + to[2] * w[2 * size + j];
            return DONE;
        }
    }
    return NOT_CONVERGED;
}

/* Steps */

static int can_reuse_factors(const Steps *now, double h) {
    return fabs(h - now->factors_step) <= STEP_ROUNDING * h && now->rate <= KEEP_RATE;
}

/* Step ratio that the error allows, reduced after many Newton iterations. */
static double step_factor(const Steps *now, double error) {
    const double most = 2.0 * MAX_ITERATIONS;
    return SAFETY * (most + 1.0) / (most + now->iterations) / pow(error, ERROR_EXPONENT);
}

/* Set the next step after an accepted step `h`. */
static void choose_next_step(const Model *model, Steps *now, double h, double error) {
    const double proposed = now->next_step;
    error = fmax(error, MIN_ERROR);
    double factor = step_factor(now, error);
    if (now->last_step > 0.0)
        factor *= fmin(1.0, h / now->last_step * pow(now->last_error / error, ERROR_EXPONENT));
    factor = fmin(fmax(factor, MIN_FACTOR), now->is_retry != 0.0 ? 1.0 : MAX_FACTOR);
    if (now->rate < SLOW_RATE)
        now->newton_limit = fmin(RECOVERY_FACTOR * now->newton_limit, model->longest_step);
    const double candidate = fmin(factor * h, now->newton_limit);
    const int keep = h <= candidate && candidate <= KEPT_GROWTH * h && can_reuse_factors(now, h);
    now->next_step = keep ? h : candidate;
    /* A communication point has cut the step: its length tells nothing about the next one. */
    if (h < proposed * LAST_STEP_MARGIN)
        now->next_step = fmax(now->next_step, fmin(proposed, now->newton_limit));
    now->last_step = h, now->last_error = error, now->is_retry = 0.0;
}

/* Take one step that passes the error test and does not pass `end`. */
static int take_step(Instance *s, double end, double base) {
    const Model *model = s->model;
    const size_t bytes = size_of(model) * sizeof(double);
    Method *m = s->method;
    Steps *now = m->now;
    int failure = TOO_SMALL;
    for (;;) {
        const double remaining = end - s->now.t;
        const double smallest = MIN_RELATIVE_STEP * fabs(isfinite(end) ? end : s->now.t);
        const double h = now->next_step >= LAST_STEP_MARGIN * remaining
                             ? remaining
                             : fmin(now->next_step, 0.5 * remaining);
        if (!(h >= fmin(smallest, remaining)) || h <= 0.0) return failure;
        const int renew = !can_reuse_factors(now, h);
        const int code = solve_stages(s, h, renew, base);
        if (code != DONE) {
            now->factors_step = 0.0;
            if (renew) {
                failure = code;
                now->next_step = now->newton_limit = FAILURE_FACTOR * h;
                now->is_retry = 1.0;
            }
            continue;
        }
        const double error = estimate_error(s, h);
        if (isnan(error)) return NOT_FINITE;
        if (error < 1.0) {
            set_stages(s, h);
            if (model->n_gaps > 0 && passes_contact(s, h)) {
                /* Until a stage is inside the surface. */
                now->next_step = 0.5 * h;
                now->is_retry = 1.0;
                continue;
            }
            choose_next_step(model, now, h, error);
            if (m->has_tangent) {
                const int differentiated = differentiate_step(s, h);
                if (differentiated != DONE) return differentiated;
            }
            memcpy(m->start_y, m->y, bytes);
            memcpy(m->start_yp, m->yp, bytes);
            memcpy(m->last_w, m->w, STAGES * bytes);
            memcpy(m->y, m->stages + 2 * size_of(model), bytes);
            memcpy(m->yp, m->rates + 2 * size_of(model), bytes);
            for (Index k = 0; k < model->n_tested; k++)
                m->tolerances[k] = fmax(m->tolerances[k], model->multiplier_tolerance *
                                                              fabs(m->yp[2 * model->n + k]));
            now->start = s->now.t;
            now->h = h;
            s->now.t = h == remaining ? end : s->now.t + h;
            s->now.has_stepped = 1;
            return DONE;
        }
        failure = TOO_SMALL;
        now->next_step = h * fmin(fmax(step_factor(now, error), MIN_FACTOR), SAFETY);
        now->is_retry = 1.0;
    }
}

/* Take steps until `end` is reached; they pass over it, but not over `limit`. */
static int take_steps(Instance *s, double end, double limit) {
    for (double count = 0.0; s->now.t < end; count += 1.0) {
        if (count >= MAX_STEPS)
            return fail(s, "The communication step requires more than 1e6 internal steps, which "
                           "end at t = %.9g s; use shorter communication steps, or export the "
                           "model with a larger rtol.", s->now.t);
        if (report_step(s, take_step(s, limit, 1.0))) return -1;
    }
    return 0;
}

int method_advance(Instance *s, double end) {
    const Model *model = s->model;
    Steps *now = s->method->now;
    const Index k = s->now.interval;
    double limit = k < model->n_breakpoints ? model->breakpoints[k] : INFINITY;
    if (now->is_quiet == 0.0) limit = end;
    now->is_quiet = 1.0;
    if (limit > end || end - s->now.t > MIN_STEP_SHARE * model->step)
        if (take_steps(s, end, fmax(limit, end))) return -1;
    s->now.offset = end - s->now.t;
    return 0;
}

static void restart_prediction(Steps *now) {
    now->last_step = now->last_error = now->is_retry = 0.0;
}

int method_prepare_change(Instance *s) {
    Method *m = s->method;
    Steps *now = m->now;
    const size_t bytes = size_of(s->model) * sizeof(double);
    now->is_quiet = 0.0;
    if (s->now.offset >= 0.0) return 0;
    /* Repeat the last step up to the communication point. */
    const double end = instance_time(s), proposed = now->next_step;
    memcpy(m->y, m->start_y, bytes);
    memcpy(m->yp, m->start_yp, bytes);
    s->now.t = now->start;
    s->now.offset = 0.0;
    int code = end > s->now.t ? take_step(s, end, 0.0) : DONE;
    while (code == DONE && s->now.t < end) code = take_step(s, end, 1.0);
    now->next_step = fmax(now->next_step, proposed);
    return report_step(s, code);
}

/* See beamdae.integrators.input_jumps. */
int method_follow_values(Instance *s) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    Method *w = s->method;
    double *a = w->yp + n, *lam = w->yp + 2 * n, *residual = w->residuals;
    restart_prediction(w->now);
    evaluate_residual(s, s->now.t, w->y, w->yp, residual);
    for (Index k = 0; k < model->n_states; k++) { /* Rows x' - f. */
        const Index i = model->states[k];
        w->yp[i] = w->y[n + i] -= residual[n + i];
    }
    const int most = model->forces_depend_on_reactions ? MAX_FRICTION_ITERATIONS : 1;
    for (int k = 0; k < most; k++) {
        evaluate_residual(s, s->now.t, w->y, w->yp, residual);
        if (evaluate_motion(s, s->now.t, w->y, w->y + n, a, lam, 0.0) != DONE)
            return report_step(s, SINGULAR);
        for (Index i = 0; i < n; i++) s->solution[i] = -residual[n + i];
        for (Index i = 0; i < model->n_states; i++) s->solution[model->states[i]] = 0.0;
        memset(s->solution + n, 0, m * sizeof(double));
        solve(&s->saddle_factors, s->solution);
        double change = 0.0, largest = 0.0;
        for (Index i = 0; i < n + m; i++) {
            double *x = i < n ? &a[i] : &lam[i - n];
            *x += s->solution[i];
            change = fmax(change, fabs(s->solution[i]));
            largest = fmax(largest, fabs(*x));
        }
        if (!isfinite(largest)) return report_step(s, NOT_FINITE);
        if (change <= FRICTION_TOLERANCE * largest) return 0;
    }
    return most == 1 ? 0 : report_step(s, NOT_CONVERGED);
}

int method_restart(Instance *s) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    Method *w = s->method;
    Steps *now = w->now;
    const int code = make_consistent(s, 1.0);
    if (code != DONE) return code;
    memset(w->y, 0, size_of(model) * sizeof(double));
    memset(w->yp, 0, size_of(model) * sizeof(double));
    memcpy(w->y, s->q, n * sizeof(double));
    memcpy(w->y + n, s->v, n * sizeof(double));
    memcpy(w->yp, s->v, n * sizeof(double));
    memcpy(w->yp + n, s->ddq, n * sizeof(double));
    memcpy(w->yp + 2 * n, s->lam, m * sizeof(double));
    double fastest = model->start_rate;
    for (Index i = 0; i < n; i++) {
        if (!isfinite(s->ddq[i]) || !isfinite(s->v[i])) return NOT_FINITE;
        fastest = fmax(fastest, fabs(s->ddq[i]) * model->test_weights[i]);
    }
    now->next_step = fmax(sqrt(2.0 / fastest), MIN_RELATIVE_STEP * fabs(s->now.t));
    now->next_step = fmin(now->next_step, model->longest_step);
    now->newton_limit = model->longest_step;
    now->factors_step = now->iterations = 0.0;
    now->rate = 1.0;
    restart_prediction(now);
    return DONE;
}

void method_evaluate(const Instance *s, double *y) {
    const Index n = s->model->n;
    const Method *m = s->method;
    const double d = s->now.offset;
    if (d < 0.0) {
        evaluate_step(s, 1.0 + d / m->now->h, m->start_y, m->last_w, y);
        return;
    }
    memcpy(y, m->y, 2 * n * sizeof(double));
    memcpy(y + 2 * n, m->yp + n, ((size_t)n + s->model->m) * sizeof(double));
    /* After the end of the last step, accelerations are constant. */
    for (Index i = 0; i < n; i++) {
        y[i] += d * y[n + i] + 0.5 * d * d * y[2 * n + i];
        y[n + i] += d * y[2 * n + i];
    }
}

void method_begin_step(Instance *s) {
    double *to = s->method->begin;
    const size_t size = motion_size(s->model);
    memcpy(to, s->method_state, size * sizeof(double));
    memcpy(to + size, s->values, s->model->n_values * sizeof(double));
    memcpy(to + size + s->model->n_values, &s->now, sizeof(Scalars));
}

/* Repeat the steps since the last communication point but one. */
static int differentiate_steps(Instance *s, const double *direction, double end) {
    const Model *model = s->model;
    Method *m = s->method;
    const double *from = m->begin;
    const size_t size = motion_size(model);
    memcpy(s->method_state, from, size * sizeof(double));
    memcpy(s->values, from + size, model->n_values * sizeof(double));
    memcpy(&s->now, from + size + model->n_values, sizeof(Scalars));
    m->now->factors_step = 0.0;
    refresh_numbers(s, 0);
    if (method_prepare_change(s)) return -1;
    memset(m->tangent, 0, size_of(model) * sizeof(double));
    memset(m->tangent_w, 0, STAGES * size_of(model) * sizeof(double));
    write_direction(s, direction, m->x + 4 * size_of(model));
    m->has_tangent = 1;
    const int code = advance(s, end);
    m->has_tangent = 0;
    return code;
}

int method_derivative(Instance *s, const double *direction, double *result) {
    const Model *model = s->model;
    const size_t n = model->n, m = model->m, count = 3 * n + m;
    const Method *w = s->method;
    void *state = malloc(instance_state_size(s));
    if (!state) return fail(s, "Out of memory at t = %.9g s.", s->now.t);
    instance_get_state(s, state);
    int code = differentiate_steps(s, direction, instance_time(s));
    if (code == 0) {
        double *y = s->motion, *dy = y + count;
        method_evaluate(s, y);
        evaluate_step(s, 1.0, NULL, w->tangent_w, dy);
        memcpy(dy, w->tangent, 2 * n * sizeof(double));
        write_direction(s, direction, dy + count);
        set_time(&s->output_direction, instance_time(s), s->now.branch);
        evaluate(&s->output_direction, y, result);
    }
    const int restored = instance_set_state(s, state);
    free(state);
    return code ? code : restored;
}

void method_reset(Instance *s) {
    Method *m = s->method;
    m->now->is_quiet = 1.0;
    for (Index k = 0; k < s->model->n_tested; k++)
        m->tolerances[k] = s->model->multiplier_tolerances[k];
}

int method_restore(Instance *s) {
    const double h = s->method->now->factors_step;
    if (h > 0.0 && factorize_matrices(s, h) != DONE)
        return fail(s, "The matrix of the state at t = %.9g s is singular.", s->now.t);
    return 0;
}

unsigned long method_pivot_searches(const Instance *s) {
    return s->method->real.pivot_searches + s->method->complex_.pivot_searches;
}
