/* Generalized-alpha steps of an exported model, in the index-3 form.

   Method, scaling, Newton's iteration and starting values are those of beamdae's GeneralizedAlpha:
   Arnold & Bruls, Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0. */

#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Newton's iteration; see beamdae.integrators.compiled_run. */
#define KEEP_RATE 0.05
#define SLOW_RATE 0.2
#define MAX_CORRECTION_GROWTH 2.0
#define MIN_RATE 1e-4
#define MIN_FIRST_RATE 1e-2
#define MAX_ITERATIONS 12
/* Rounding errors of corrections; see beamdae.integrators.alpha.step_loop. */
#define STAGNATION_RATE 0.5
#define ROUNDING_GROWTH 10.0
#define REACTION_ROUNDING 1e-6
#define REACTION_ITERATIONS 4
#define MIN_REACTION_TOLERANCE 1e-60
/* Starting values; see beamdae.integrators.alpha.family. */
#define JERK_INTERVAL 1e-2
#define STIFF_TIME 0.5
/* Relative difference of equal steps. */
#define SAME_STEP 1e-9
/* Shortest step, relative to the internal step. Rounding errors of positions, divided by the square
   of the step, are errors of accelerations and reactions. */
#define MIN_STEP_SHARE 1e-2

/* Numbers of the state: step, ratio to the step before, rate of Newton's iteration, and whether
   there are factors and whether inputs have jumped since the last step. */
typedef struct {
    double h, step_ratio, rate, has_factors, follows_jump;
} Steps;

struct Method {
    Steps *now;
    /* State, after the numbers. */
    double *a, *ddq_n, *lam_n, *start, *jump;
    /* Work arrays. */
    double *a_predicted, *first_iterate, *change, *at_q, *at_v, *at_a, *x, *jerk;
    double c_v, c_a, c_f, correction_limit, reaction_factor;
    /* Sizes of the last correction: of positions, and of positions and reactions. */
    double q_size, size;
    /* The non-zeros of `step_factors` are part of the state. */
    Factors step_factors, derivative_factors;
};

size_t method_state_size(const Model *model) {
    return sizeof(Steps) / sizeof(double) + 8 * (size_t)model->n + 3 * (size_t)model->m +
           model->step_pattern.nnz;
}

void method_create(Instance *s, int *failed) {
    const size_t n = s->model->n, m = s->model->m;
    Method *w = s->method = calloc(1, sizeof(Method));
    if (!w) {
        *failed = 1;
        return;
    }
    double *state = s->method_state;
    w->now = (Steps *)state, state += sizeof(Steps) / sizeof(double);
    w->a = state, state += n, w->ddq_n = state, state += n, w->lam_n = state, state += m;
    w->start = state, state += 3 * n + m, w->jump = state, state += 3 * n + m;
    create_factors(s, &w->step_factors, &s->model->step_pattern, 0, failed);
    create_factors(s, &w->derivative_factors, &s->model->step_pattern, 0, failed);
    w->step_factors.nonzeros = state;
    w->at_q = new_array(s, n, failed);
    w->at_v = new_array(s, n, failed);
    w->at_a = new_array(s, n, failed);
    w->x = new_array(s, n + m, failed);
    w->a_predicted = new_array(s, n, failed);
    w->first_iterate = new_array(s, n + m, failed);
    w->change = new_array(s, n + m, failed);
    w->jerk = new_array(s, n, failed);
}

void method_free(Instance *s) {
    if (!s->method) return;
    free_factors(&s->method->step_factors);
    free_factors(&s->method->derivative_factors);
    free(s->method);
}

/* Equations of a step */

static void set_motion(Instance *s, double lam_factor) {
    Method *w = s->method;
    const Index n = s->model->n, m = s->model->m;
    double *y = s->motion;
    for (Index i = 0; i < n; i++) {
        y[i] = w->at_q[i] + w->x[i];
        y[n + i] = w->at_v[i] + w->c_v * w->x[i];
        y[2 * n + i] = w->at_a[i] + w->c_a * w->x[i];
    }
    for (Index i = 0; i < m; i++) y[3 * n + i] = lam_factor * w->x[n + i];
}

static void scale_residual(const Instance *s, double *result) {
    Method *w = s->method;
    const Model *model = s->model;
    for (Index i = 0; i < model->n; i++) result[i] *= w->c_f;
    for (Index k = 0; k < model->n_velocity_rows; k++) result[model->velocity_rows[k]] /= w->c_v;
}

static void evaluate_residual(Instance *s, double t) {
    Method *w = s->method;
    set_time(&s->residual, t, s->now.branch);
    set_motion(s, 1.0 / w->c_f);
    evaluate(&s->residual, s->motion, w->change);
    scale_residual(s, w->change);
}

static int factorize_matrix(Instance *s, Factors *factors, double t) {
    Method *w = s->method;
    set_time(&s->matrix, t, s->now.branch);
    set_factors(&s->matrix, w->c_f, w->c_f * w->c_v, w->c_f * w->c_a, 1.0 / w->c_v, 1.0 / w->c_f);
    set_motion(s, 1.0);
    evaluate(&s->matrix, s->motion, factors->nonzeros);
    return factorize(factors) ? DONE : SINGULAR;
}

static int factorize_step_matrix(Instance *s, double t) {
    Method *w = s->method;
    const int code = factorize_matrix(s, &w->step_factors, t);
    w->now->has_factors = code == DONE;
    w->now->rate = code == DONE ? 0.0 : INFINITY;
    return code;
}

static void set_step(Instance *s, double h) {
    Method *w = s->method;
    const Model *model = s->model;
    w->now->h = h;
    w->c_f = h * h * model->beta;
    w->c_v = model->gamma / (h * model->beta);
    w->c_a = (1.0 - model->alpha_m) / ((1.0 - model->alpha_f) * w->c_f);
}

static double correct(Instance *s) {
    Method *w = s->method;
    const Model *model = s->model;
    double square = 0.0, reactions = 0.0;
    solve(&w->step_factors, w->change);
    for (Index i = 0; i < model->n + model->m; i++) w->x[i] -= w->change[i];
    for (Index i = 0; i < model->n; i++) {
        const double weighted = w->change[i] * model->weights[i];
        square += weighted * weighted;
    }
    w->q_size = w->size = sqrt(square);
    if (w->reaction_factor > 0.0) {
        for (Index i = model->n; i < model->n + model->m; i++)
            reactions += w->change[i] * w->change[i];
        w->size = sqrt(square + w->reaction_factor * w->reaction_factor * reactions);
    }
    return w->size;
}

static int iterate_newton(Instance *s, double t, int may_renew) {
    Method *w = s->method;
    const double rounding = ROUNDING_GROWTH * s->model->min_correction_limit;
    double previous = INFINITY;
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        evaluate_residual(s, t);
        const double size = correct(s), limit = w->correction_limit;
        if (k == 0 && !isfinite(size)) return NOT_FINITE;
        /* Corrections of reactions that remain after those of positions may grow. */
        const int of_reactions =
            w->q_size < size && size < INFINITY && w->q_size <= fmax(limit, rounding);
        if (!(size <= rounding || of_reactions || size <= MAX_CORRECTION_GROWTH * previous))
            return NOT_CONVERGED;
        if (k > 0) w->now->rate = previous > 0.0 ? fmax(size / previous, MIN_RATE) : 0.0;
        const double rate = k > 0 ? w->now->rate : fmax(w->now->rate, MIN_FIRST_RATE);
        if (rate < 1.0 && size * rate <= limit * (1.0 - rate)) return DONE;
        if (k > 0 && rate > STAGNATION_RATE) {
            if (size <= rounding) return DONE;
            const int is_small = size * s->model->newton_tolerance <= REACTION_ROUNDING * limit;
            if (of_reactions && (is_small || (may_renew && k + 1 >= REACTION_ITERATIONS)))
                return DONE;
            if (of_reactions && !may_renew) return NOT_CONVERGED;
        }
        if (may_renew && rate > SLOW_RATE) {
            const int code = factorize_step_matrix(s, t);
            if (code != DONE) return code;
        }
        previous = size;
    }
    return NOT_CONVERGED;
}

static int solve_step(Instance *s, double t) {
    Method *w = s->method;
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
            else if (size > MAX_CORRECTION_GROWTH * previous && size > w->correction_limit)
                code = NOT_CONVERGED;
            previous = size;
        }
        return code;
    }
    memcpy(w->first_iterate, w->x, bytes);
    if (w->now->rate <= KEEP_RATE) {
        code = iterate_newton(s, t, 0);
        if (code == DONE || code == NOT_FINITE) return code;
    }
    for (int attempt = 0; attempt < 2; attempt++) {
        memcpy(w->x, w->first_iterate, bytes);
        if (attempt == 1) /* from uniform motion */
            for (Index i = 0; i < model->n; i++)
                w->x[i] = s->q[i] + w->now->h * s->v[i] - w->at_q[i];
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
    Method *w = s->method;
    const Model *model = s->model;
    double largest = 0.0, reaction = 0.0;
    for (Index i = 0; i < model->n; i++)
        largest = fmax(largest, fabs(s->ddq[i] * model->weights[i]));
    for (Index i = 0; i < model->m && model->tests_reactions; i++)
        reaction = fmax(reaction, fabs(s->lam[i]));
    w->correction_limit =
        fmax(model->newton_tolerance * w->c_f * largest, model->min_correction_limit);
    reaction *= model->newton_tolerance * w->c_f;
    const double tolerance = fmax(reaction / w->correction_limit, MIN_REACTION_TOLERANCE);
    w->reaction_factor = reaction > 0.0 ? 1.0 / tolerance : 0.0;
}

/* Let the equations of a step of length zero begin at y = (q, v, q'', lam). */
static void hold_motion(Instance *s, const double *y) {
    Method *w = s->method;
    const Index n = s->model->n, m = s->model->m;
    const size_t bytes = n * sizeof(double);
    memcpy(w->at_q, y, bytes);
    memcpy(w->at_v, y + n, bytes);
    memcpy(w->at_a, y + 2 * n, bytes);
    memset(w->x, 0, bytes);
    for (Index i = 0; i < m; i++) w->x[n + i] = w->c_f * y[3 * n + i];
}

/* Change accelerations and multipliers after a jump of values; see apply_input_jump in
   beamdae.integrators.alpha.step_loop. */
static int apply_jump(Instance *s) {
    Method *w = s->method;
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    pack_state(s, s->motion);
    hold_motion(s, s->motion);
    if (model->n_states) { /* The rows of first-order states are c_f (x' - f). */
        evaluate_residual(s, s->now.t);
        for (Index k = 0; k < model->n_states; k++) {
            const Index i = model->states[k];
            w->at_v[i] = s->v[i] -= w->change[i] / w->c_f;
        }
    }
    set_correction_limit(s);
    const int code = solve_step(s, s->now.t);
    if (code != DONE) return code;
    set_motion(s, 1.0 / w->c_f);
    memcpy(w->jump, s->motion, (3 * (size_t)n + m) * sizeof(double));
    w->now->follows_jump = 1;
    for (Index k = 0; k < model->n_states; k++) w->x[model->states[k]] = 0.0;
    for (Index i = 0; i < n; i++) {
        const double change = w->c_a * w->x[i];
        s->ddq[i] += change;
        w->a[i] += change;
        w->ddq_n[i] += change;
    }
    for (Index i = 0; i < m; i++) {
        const double lam = w->x[n + i] / w->c_f;
        w->lam_n[i] += lam - s->lam[i];
        s->lam[i] = lam;
    }
    return DONE;
}

int method_follow_values(Instance *s) { return report_step(s, apply_jump(s)); }

int method_prepare_change(Instance *s) {
    (void)s;
    return 0;
}

void method_begin_step(Instance *s) { (void)s; }

static int advance_step(Instance *s, double t) {
    Method *w = s->method;
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    const double h = w->now->h, r = w->now->step_ratio, beta = model->beta, gamma = model->gamma;
    const double factor = 1.0 / (1.0 - model->alpha_m);
    /* Where the accelerations at the beginning of the step were determined. */
    if (w->now->follows_jump)
        memcpy(w->start, w->jump, (3 * (size_t)n + m) * sizeof(double));
    else
        pack_state(s, w->start);
    set_correction_limit(s);
    for (Index i = 0; i < n; i++) {
        const double ddq = s->ddq[i], a = w->a[i];
        const double at_a = (1.0 + r) * ddq - r * w->ddq_n[i];
        const double predicted = factor * (1.0 - model->alpha_f) * at_a +
                                 factor * model->alpha_f * ddq - factor * model->alpha_m * a;
        w->at_q[i] = s->q[i] + h * s->v[i] + h * h * ((0.5 - beta) * a + beta * predicted);
        w->at_v[i] = s->v[i] + h * ((1.0 - gamma) * a + gamma * predicted);
        w->at_a[i] = at_a;
        w->a_predicted[i] = predicted;
        w->ddq_n[i] = ddq;
        w->x[i] = 0.0;
    }
    for (Index i = 0; i < m; i++) {
        w->x[n + i] = w->c_f * ((1.0 + r) * s->lam[i] - r * w->lam_n[i]);
        w->lam_n[i] = s->lam[i];
    }
    const int code = solve_step(s, t);
    if (code != DONE) return code;
    for (Index i = 0; i < n; i++) {
        s->q[i] = w->at_q[i] + w->x[i];
        s->v[i] = w->at_v[i] + w->c_v * w->x[i];
        s->ddq[i] = w->at_a[i] + w->c_a * w->x[i];
        w->a[i] = w->a_predicted[i] + w->x[i] / w->c_f;
    }
    for (Index i = 0; i < m; i++) s->lam[i] = w->x[n + i] / w->c_f;
    s->now.t = t;
    w->now->step_ratio = 1.0;
    w->now->follows_jump = 0;
    s->now.has_stepped = 1;
    return DONE;
}

/* Time derivative of g'' at constant acceleration, by a central difference, in `rate`. */
static void evaluate_constraint_rate(Instance *s, double delta) {
    Method *w = s->method;
    const Index n = s->model->n, m = s->model->m;
    double *q = w->at_q, *v = w->at_v;
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

/* Second difference of the forces along the velocities, in `change`; see StateEvaluator. */
static void evaluate_force_change(Instance *s, double delta, double *change) {
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    double *step = s->method->at_q, *y = s->motion;
    for (Index i = 0; i < n; i++) step[i] = delta * s->v[i];
    for (Index k = 0; k < model->n_states; k++) step[model->states[k]] = 0.0;
    memset(y, 0, (3 * n + m) * sizeof(double));
    memset(change, 0, n * sizeof(double));
    memcpy(y + n, s->v, n * sizeof(double));
    set_time(&s->smooth_motion, s->now.t, s->now.branch);
    for (int shift = -1; shift <= 1; shift++) {
        for (Index i = 0; i < n; i++) y[i] = s->q[i] + shift * step[i];
        evaluate(&s->smooth_motion, y, s->levels);
        for (Index i = 0; i < n; i++) change[i] += (shift == 0 ? -2.0 : 1.0) * s->levels[i];
    }
    for (Index k = 0; k < model->n_states; k++) change[model->states[k]] = 0.0;
}

/* Set accelerations, multipliers and starting values; see AlphaStart. */
int method_restart(Instance *s) {
    Method *w = s->method;
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    const size_t bytes = n * sizeof(double);
    const double h = w->now->h, ratio = fmin(h / model->step, 1.0);
    w->now->rate = INFINITY;
    w->now->has_factors = w->now->follows_jump = w->now->step_ratio = 0.0;
    /* Gaps divided by the square of the step are errors of accelerations. */
    int code = make_consistent(s, ratio * ratio);
    if (code != DONE) return code;
    memset(w->jerk, 0, bytes);
    memset(w->a_predicted, 0, bytes);
    if (m > 0) {
        evaluate_constraint_rate(s, JERK_INTERVAL * h);
        if (evaluate_motion(s, s->now.t, s->q, s->v, NULL, NULL, 0.0) != DONE) return SINGULAR;
        solve_constraints(s, s->rate, -1.0);
        memcpy(w->jerk, s->solution, bytes);
        memcpy(w->a_predicted, w->jerk, bytes);
        if (model->n_velocity_rows) { /* The jerk of holonomic constraints alone. */
            for (Index k = 0; k < model->n_velocity_rows; k++)
                s->rate[model->velocity_rows[k] - n] = 0.0;
            solve_constraints(s, s->rate, -1.0);
            memcpy(w->a_predicted, s->solution, bytes);
        }
    }
    evaluate_force_change(s, STIFF_TIME * h, w->change);
    code = solve_accelerations(s, STIFF_TIME * h * STIFF_TIME * h, w->change);
    if (code != DONE) return code;
    for (Index i = 0; i < n; i++) {
        s->ddq[i] = s->solution[i];
        w->a[i] = s->ddq[i] + model->shift * h * w->jerk[i];
        s->v[i] += h * h * model->defect * w->a_predicted[i];
    }
    for (Index i = 0; i < n; i++)
        if (!isfinite(w->a[i]) || !isfinite(s->v[i])) return NOT_FINITE;
    return DONE;
}

/* Equal steps to `end`. If `end` is too near for a step, the state remains that at the end of the
   last step, and the offset of `end` is stored. */
int method_advance(Instance *s, double end) {
    const double start = s->now.t, length = end - start, step = s->model->step;
    s->now.offset = fmax(length, 0.0);
    if (length <= MIN_STEP_SHARE * step) return 0;
    const double count = fmax(ceil(length / step - SAME_TIME), 1.0);
    const double h = length / count, rounding = SAME_STEP * h + TIME_ROUNDING * fabs(end);
    s->now.offset = 0.0;
    if (fabs(h - s->method->now->h) > rounding) {
        set_step(s, h);
        if (restart(s)) return -1;
    }
    for (double k = 1.0; k <= count; k += 1.0)
        if (report_step(s, advance_step(s, k < count ? start + k * h : end))) return -1;
    return 0;
}

/* After the end of the last step, accelerations are constant. */
void method_evaluate(const Instance *s, double *y) {
    const Index n = s->model->n;
    const double d = s->now.offset;
    pack_state(s, y);
    for (Index i = 0; i < n; i++) {
        y[i] += d * y[n + i] + 0.5 * d * d * y[2 * n + i];
        y[n + i] += d * y[2 * n + i];
    }
}

/* Derivative of the scaled residual along the direction in `motion`, in `change`. */
static void evaluate_direction(Instance *s, double t) {
    Method *w = s->method;
    set_motion(s, 1.0 / w->c_f);
    set_time(&s->residual_direction, t, s->now.branch);
    evaluate(&s->residual_direction, s->motion, w->change);
    scale_residual(s, w->change);
}

static int solve_direction(Instance *s, double t) {
    Method *w = s->method;
    if (factorize_matrix(s, &w->derivative_factors, t) != DONE)
        return fail(s, "The matrix is singular at t = %.9g s.", t);
    evaluate_direction(s, t);
    solve(&w->derivative_factors, w->change);
    return 0;
}

int method_derivative(Instance *s, const double *direction, double *result) {
    Method *w = s->method;
    const Model *model = s->model;
    const Index n = model->n, m = model->m;
    /* Inputs of both sums: (q, v, a, lam), their derivatives, and those of p. */
    const size_t size = 3 * (size_t)n + m;
    const double h = w->now->h;
    double *y = s->motion, *dy = y + size, *dp = dy + size, *dx = w->change;
    memset(dy, 0, size * sizeof(double));
    write_direction(s, direction, dp);
    /* Accelerations at the beginning of the step. */
    hold_motion(s, w->start);
    if (model->n_states) {
        evaluate_direction(s, s->now.t - h);
        for (Index k = 0; k < model->n_states; k++) {
            const Index i = model->states[k];
            dy[n + i] = -dx[i] / w->c_f;
        }
    }
    if (solve_direction(s, s->now.t - h)) return -1;
    for (Index k = 0; k < model->n_states; k++) dx[model->states[k]] = 0.0;
    for (Index i = 0; i < n; i++) {
        const double change = -w->c_a * dx[i];
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
        dy[n + i] -= w->c_v * dx[i];
        dy[2 * n + i] -= w->c_a * dx[i];
    }
    for (Index i = 0; i < m; i++) dy[3 * n + i] = -dx[n + i] / w->c_f;
    set_time(&s->output_direction, s->now.t, s->now.branch);
    evaluate(&s->output_direction, y, result);
    return 0;
}
void method_reset(Instance *s) {
    s->method->now->rate = INFINITY;
    set_step(s, s->model->step);
}

int method_restore(Instance *s) {
    Method *w = s->method;
    set_step(s, w->now->h);
    /* Factors are a function of the matrix. */
    if (w->now->has_factors && !factorize(&w->step_factors))
        return fail(s, "The matrix of the state at t = %.9g s is singular.", s->now.t);
    return 0;
}

unsigned long method_pivot_searches(const Instance *s) {
    return s->method->step_factors.pivot_searches + s->method->derivative_factors.pivot_searches;
}
