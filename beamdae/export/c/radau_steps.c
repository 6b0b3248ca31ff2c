/* Adaptive steps of an exported model by three-stage Radau IIA: the core takes the steps.

   While inputs do not change, steps pass over communication points, at which outputs are evaluated
   on the polynomial of the step: the cost does not depend on the communication step. If an input
   changes inside such a step, the step is repeated up to the communication point with the values
   before the change. Later steps end at communication points as long as inputs change, because a
   longer step would be wasted. */

#include "instance.h"

#include <string.h>

#define STAGES 3
/* Shortest step, relative to the time at its end. */
#define MIN_RELATIVE_STEP 1e-12
/* Largest number of steps in a communication step. */
#define MAX_STEPS 1e6
/* Contacts that a step passes over; see beamdae.integrators.events.closings. */
#define MIN_DEPTH 1e-9
#define SAMPLES 17
#define REFINEMENTS 5
/* Newton's iteration for the derivatives of a step, which is linear. */
#define MAX_DERIVATIVE_ITERATIONS 200
#define DERIVATIVE_TOLERANCE 1e-12

static RadauTable *table_of(Instance *s) { return (RadauTable *)s->table; }

void method_forget_factors(Instance *s) { table_of(s)->run.factors_step = 0.0; }

void method_reset(Instance *s) {
    table_of(s)->is_quiet = 1;
    table_of(s)->run.most = 1;
}

/* Copies of the first words of the block, without addresses: states contain them. */
static void save_words(const RadauTable *x, Reals to) {
    memcpy(to.at, x, to.size * sizeof(double));
    clear_addresses(to.at);
}

/* Return to saved words. Factors do not belong to them. */
static void roll_back(RadauTable *x, Reals saved) {
    const double step = x->run.factors_step, rate = x->run.rate;
    memcpy(x, saved.at, saved.size * sizeof(double));
    write_addresses(&x->base);
    x->run.factors_step = step;
    x->run.rate = rate;
}

/* Value at the start of the last step of an array of the motion. */
static Reals value_before(const RadauTable *x, Reals array) {
    return (Reals){x->before.at + (array.at - (const double *)x), array.size};
}

/* Polynomials */

/* Values at u, relative to the start of the last step: the start values, if there are any, and the
   polynomials of `w`, and their time derivatives, for unknowns that begin at `first`. */
static void evaluate_polynomials(const RadauTable *x, double u, Reals start, Reals2 w,
                                 int64_t first, Reals values, Reals rates) {
    const Reals2 p = x->run.base.tableau.polynomial;
    double c[STAGES], d[STAGES];
    for (int j = 0; j < STAGES; j++) {
        const double p0 = p.at[j], p1 = p.at[p.columns + j], p2 = p.at[2 * p.columns + j];
        c[j] = u * (p0 + u * (p1 + u * p2));
        d[j] = (p0 + u * (2.0 * p1 + u * 3.0 * p2)) / x->h;
    }
    const Reals w0 = from(row(w, 0), first), w1 = from(row(w, 1), first);
    const Reals w2 = from(row(w, 2), first);
    combine3(values, c[0], w0, c[1], w1, c[2], w2);
    if (start.size) add_to(values, 1.0, from(start, first));
    combine3(rates, d[0], w0, d[1], w1, d[2], w2);
}

/* Write (q, v, a, lam) at u of the last step; `levels` are lost. */
static void evaluate_step(const RadauTable *x, double u, Reals start, Reals2 w, Reals motion) {
    const int64_t n = x->base.n, m = x->base.m;
    const Reals unused = part(x->base.starter.levels, 0, n);
    evaluate_polynomials(x, u, start, w, 0, part(motion, 0, n), unused);
    evaluate_polynomials(x, u, start, w, n, part(motion, n, 2 * n), part(motion, 2 * n, 3 * n));
    evaluate_polynomials(x, u, start, w, 2 * n, part(x->base.starter.levels, 0, m),
                         part(motion, 3 * n, 3 * n + m));
}

/* Contacts */

static void evaluate_gaps(RadauTable *x, double t, Reals q) {
    const Reals inputs = part(x->base.inputs, 0, x->base.n);
    copy(inputs, q);
    set_time(&x->gap_sum, t, x->base.branch);
    evaluate_sum(&x->gap_sum, inputs, x->gaps);
}

/* Smallest gap of contact `k` at samples of the last step from *left to *right, relative to its
   start at t; the neighbors of the smallest sample replace *left and *right. */
static double sample_gap(RadauTable *x, double t, int64_t k, double *left, double *right) {
    const double first = *left, spacing = (*right - *left) / (SAMPLES - 1);
    const Reals q = part(x->base.starter.solution, 0, x->base.n), rates = part(x->base.starter.levels, 0, q.size);
    double lowest = INFINITY;
    for (int i = 0; i < SAMPLES; i++) {
        const double u = first + i * spacing;
        evaluate_polynomials(x, u, value_before(x, x->run.base.y), x->run.base.last_w, 0, q, rates);
        evaluate_gaps(x, t + u * x->h, q);
        if (!(x->gaps.at[k] < lowest)) continue;
        lowest = x->gaps.at[k];
        *left = fmax(u - spacing, 0.0);
        *right = fmin(u + spacing, 1.0);
    }
    return lowest;
}

/* Return 1 if a contact is open at the start t and at all stages of the last step, but closed in
   between: its force is zero wherever it was evaluated. */
static int passes_contact(RadauTable *x, double t) {
    const Stages *stages = &x->run.base;
    for (int64_t k = 0; k < x->gaps.size; k++) {
        evaluate_gaps(x, t, value_before(x, stages->y));
        int is_open = x->gaps.at[k] > 0.0;
        for (int i = 0; i < STAGES; i++) {
            evaluate_gaps(x, t + stages->tableau.nodes.at[i] * x->h, row(stages->stages, i));
            is_open &= x->gaps.at[k] > 0.0;
        }
        double left = 0.0, right = 1.0;
        for (int i = 0; i <= REFINEMENTS && is_open; i++) {
            const double spacing = (right - left) / (SAMPLES - 1);
            if (sample_gap(x, t, k, &left, &right) < -MIN_DEPTH * x->base.length) return 1;
            /* The gap is smallest at an end of the step. */
            if (right - left < 1.5 * spacing) break;
        }
    }
    return 0;
}

static void renew_step_pivots(Instance *s) {
    Stages *stages = &table_of(s)->run.base;
    renew_pivots(s, &stages->real_solver, 0);
    renew_pivots(s, (LinearSolver *)&stages->complex_solver, 1);
}

/* Derivatives */

/* Update the derivatives at the end of the last step, which began at t, by Newton's iteration with
   its matrices; its stages are known. */
static int differentiate_step(Instance *s, double t) {
    RadauTable *x = table_of(s);
    RadauWorkspace *run = &x->run;
    Stages *stages = &run->base;
    const int64_t n = x->base.n, size = run->form.size;
    const Reals dy = part(x->stage, 2 * size, 3 * size);
    const Reals dyp = part(x->stage, 3 * size, 4 * size), weights = run->iteration_weights;
    const double h = x->h;
    double total = 0.0;
    int code;
    run->t = t;
    while ((code = factorize_matrices(run, h)) == NEW_PIVOTS) renew_step_pivots(s);
    if (code != DONE) return code;
    const Stages at = *stages;
    /* Zeros, apart from velocities, which are those of the positions. */
    stages->y = x->tangent, stages->yp = x->zeros, stages->step_size.last_step = 0.0;
    stages->stages = x->tangent_stages, stages->rates = x->tangent_rates;
    predict_stages(stages, h);
    code = NOT_CONVERGED;
    for (int k = 0; k < MAX_DERIVATIVE_ITERATIONS && code == NOT_CONVERGED; k++) {
        set_stages(stages, h);
        for (int i = 0; i < STAGES; i++) {
            const Reals residual = row(run->stage_residuals, i);
            copy(part(x->stage, 0, size), row(at.stages, i));
            copy(part(x->stage, size, 2 * size), row(at.rates, i));
            copy(dy, row(stages->stages, i));
            copy(dyp, row(stages->rates, i));
            set_time(&x->base.residual_direction, t + at.tableau.nodes.at[i] * h, x->base.branch);
            evaluate_sum(&x->base.residual_direction, x->stage, residual);
            combine3(part(residual, 0, n), 1.0, residual, 1.0, dyp, -1.0, from(dy, n));
        }
        correct_stages(run, h);
        const double change = join_largest(
            max_norm(part(stages->real_change, 0, weights.size), weights),
            max_modulus(stages->complex_change, weights));
        total = fmax(total, change);
        if (!isfinite(change)) {
            code = NOT_FINITE;
        } else if (k > 0 && change <= DERIVATIVE_TOLERANCE * total) {
            set_stages(stages, h);
            copy(x->tangent, row(stages->stages, STAGES - 1));
            for (int i = 0; i < STAGES; i++) copy(row(x->tangent_w, i), row(stages->w, i));
            code = DONE;
        }
    }
    *stages = at;
    return code;
}

/* Steps */

/* Take one step that passes the error test and does not pass `limit`. */
static int take_step(Instance *s, double limit) {
    RadauTable *x = table_of(s);
    RadauWorkspace *run = &x->run;
    StepSizeState *size = &run->base.step_size;
    for (;;) {
        const double t = x->base.t;
        run->t = t;
        run->branch = x->base.branch;
        run->end = limit;
        run->filled = 0;
        size->smallest = fmax(MIN_RELATIVE_STEP * fabs(isfinite(limit) ? limit : t), DBL_MIN);
        save_words(x, x->before);
        int code;
        while ((code = take_radau_steps(run)) == NEW_PIVOTS) renew_step_pivots(s);
        release_matrices(s);
        if (code < 0) return code;
        x->h = size->last_step;
        if (x->gaps.size && passes_contact(x, t)) {
            /* Until a stage is inside the surface. */
            const double h = x->h;
            roll_back(x, x->before);
            size->next_step = 0.5 * h;
            size->is_retry = 1;
            continue;
        }
        x->base.t = run->t;
        x->base.has_stepped = 1;
        if (!x->has_tangent) return DONE;
        code = differentiate_step(s, t);
        release_matrices(s);
        return code;
    }
}

/* Take steps until `end` is reached; they pass over it, but not over `limit`. */
static int take_steps(Instance *s, double end, double limit) {
    for (double count = 0.0; s->table->t < end; count += 1.0) {
        if (count >= MAX_STEPS)
            return fail(s, "The communication step requires more than 1e6 internal steps, which "
                           "end at t = %.9g s; use shorter communication steps, or export the "
                           "model with a larger rtol.", s->table->t);
        if (report_step(s, take_step(s, limit))) return -1;
    }
    return 0;
}

int method_advance(Instance *s, double end) {
    RadauTable *x = table_of(s);
    const Table *base = s->table;
    const int64_t k = base->interval;
    double limit = k < base->breakpoints.size ? base->breakpoints.at[k] : INFINITY;
    if (!x->is_quiet) limit = end;
    x->is_quiet = 1;
    if (limit > end || end - base->t > MIN_STEP_SHARE * model.step)
        if (take_steps(s, end, fmax(limit, end))) return -1;
    s->table->offset = end - base->t;
    return 0;
}

static void restart_prediction(StepSizeState *size) {
    size->last_step = size->last_error = 0.0;
    size->is_retry = 0;
}

int method_prepare_change(Instance *s) {
    RadauTable *x = table_of(s);
    StepSizeState *size = &x->run.base.step_size;
    x->is_quiet = 0;
    if (s->table->offset >= 0.0) return 0;
    /* Repeat the last step up to the communication point. */
    const double end = instance_time(s), proposed = size->next_step;
    roll_back(x, x->before);
    x->is_quiet = 0;
    s->table->offset = 0.0;
    if (take_steps(s, end, end)) return -1;
    size->next_step = fmax(size->next_step, proposed);
    return 0;
}

int method_follow_values(Instance *s) {
    RadauTable *x = table_of(s);
    MotionBuffers *start = &x->base.starter;
    const int64_t n = start->n, m = start->m;
    const Reals y = x->run.base.y, yp = x->run.base.yp;
    restart_prediction(&x->run.base.step_size);
    copy(start->q, y);
    copy(start->v, from(y, n));
    copy(start->lam, from(yp, 2 * n));
    const int code = follow_jump(s);
    release_matrices(s);
    if (code != DONE) return report_step(s, code);
    for (int64_t i = 0; i < start->states.size; i++) { /* Their accelerations are continuous. */
        const int64_t k = start->states.at[i];
        y.at[n + k] = yp.at[k] = start->v.at[k];
        start->solution.at[k] = yp.at[n + k];
    }
    copy(part(yp, n, 2 * n + m), start->solution);
    return 0;
}

int method_restart(Instance *s) {
    RadauTable *x = table_of(s);
    const Table *base = s->table;
    const int64_t n = base->n;
    RadauWorkspace *run = &x->run;
    StepSizeState *size = &run->base.step_size;
    const Reals y = run->base.y, yp = run->base.yp;
    const int code = make_consistent(s, 1.0);
    if (code != DONE) return code;
    fill(y, 0.0);
    fill(yp, 0.0);
    copy(part(y, 0, n), base->q);
    copy(part(y, n, 2 * n), base->v);
    copy(part(yp, 0, n), base->v);
    copy(part(yp, n, 2 * n), base->ddq);
    copy(part(yp, 2 * n, 2 * n + base->m), base->lam);
    double fastest = x->start_rate;
    for (int64_t i = 0; i < n; i++) {
        if (!isfinite(base->ddq.at[i]) || !isfinite(base->v.at[i])) return NOT_FINITE;
        fastest = fmax(fastest, fabs(base->ddq.at[i]) * run->test_weights.at[i]);
    }
    size->next_step = fmax(sqrt(2.0 / fastest), MIN_RELATIVE_STEP * fabs(base->t));
    size->next_step = fmin(size->next_step, size->longest);
    run->factors_step = 0.0;
    run->iterations = 0;
    run->rate = 1.0;
    run->failure_code = TOO_SMALL;
    restart_prediction(size);
    return DONE;
}

void method_evaluate(Instance *s) {
    RadauTable *x = table_of(s);
    const Table *base = s->table;
    const Stages *stages = &x->run.base;
    const int64_t n = base->n, m = base->m;
    const double d = base->offset;
    const Reals q = part(base->inputs, 0, n), v = part(base->inputs, n, 2 * n);
    const Reals a = part(base->inputs, 2 * n, 3 * n);
    if (d < 0.0) {
        evaluate_step(x, 1.0 + d / x->h, value_before(x, stages->y), stages->last_w, base->inputs);
        return;
    }
    copy(part(base->inputs, 0, 2 * n), stages->y);
    copy(part(base->inputs, 2 * n, 3 * n + m), from(stages->yp, n));
    /* After the end of the last step, accelerations are constant. */
    combine3(q, 1.0, q, d, v, 0.5 * d * d, a);
    add_to(v, d, a);
}

void method_begin_step(Instance *s) {
    const RadauTable *x = table_of(s);
    save_words(x, x->begin);
}

/* Repeat the steps since the last communication point but one. */
int method_derivative(Instance *s, const double *direction, Reals result) {
    RadauTable *x = table_of(s);
    Table *base = s->table;
    const int64_t n = base->n, size = 3 * n + base->m;
    const Reals dy = part(base->inputs, size, 2 * size);
    const double end = instance_time(s);
    roll_back(x, x->begin);
    x->run.factors_step = 0.0;
    refresh_numbers(s);
    if (method_prepare_change(s)) return -1;
    fill(x->tangent, 0.0);
    for (int i = 0; i < STAGES; i++) fill(row(x->tangent_w, i), 0.0);
    write_direction(s, direction, from(x->stage, 4 * x->run.form.size).at);
    x->has_tangent = 1;
    if (advance(s, end)) return -1;
    method_evaluate(s);
    evaluate_step(x, 1.0, (Reals){0}, x->tangent_w, dy);
    copy(part(dy, 0, 2 * n), x->tangent);
    write_direction(s, direction, from(base->inputs, 2 * size).at);
    set_time(&base->output_direction, end, base->branch);
    evaluate_sum(&base->output_direction, base->inputs, result);
    return 0;
}
