/* Generalized-alpha steps of an exported model, in the index-3 form: the core takes the steps.

   Starting values are those of beamdae's GeneralizedAlpha: Arnold & Bruls, Multibody Syst. Dyn. 18
   (2007) 185, doi:10.1007/s11044-007-9084-0. */

#include "instance.h"

/* Starting values; see beamdae.integrators.alpha.family. */
#define JERK_INTERVAL 1e-2
#define STIFF_TIME 0.5
/* Relative difference of equal steps. */
#define SAME_STEP 1e-9

static AlphaTable *table_of(Instance *s) { return (AlphaTable *)s->table; }

void method_forget_factors(Instance *s) { table_of(s)->run.rate = INFINITY; }

void method_reset(Instance *s) { table_of(s)->run.current.h = model.step; }

/* Call the steps of the core. */
static int take_steps(Instance *s) {
    AlphaWorkspace *run = &table_of(s)->run;
    int code;
    run->t = s->table->t;
    run->branch = s->table->branch;
    run->most = 1;
    run->filled = 0;
    while ((code = take_fixed_steps(run)) == NEW_PIVOTS) renew_pivots(s, &run->linear, 0);
    release_matrices(s);
    return code;
}

int method_follow_values(Instance *s) {
    AlphaTable *x = table_of(s);
    AlphaWorkspace *run = &x->run;
    const StepPrediction *at = &run->prediction;
    const int64_t n = x->base.n;
    const double *c = at->coefficients.at;
    run->has_jumped = 1;
    const int code = take_steps(s);
    run->has_jumped = 0;
    if (code < 0) return report_step(s, code);
    combine2(part(x->jump, 0, n), 1.0, at->q, 1.0, run->x);
    combine2(part(x->jump, n, 2 * n), 1.0, at->v, c[0], run->x);
    combine2(part(x->jump, 2 * n, 3 * n), 1.0, at->a, c[1], run->x);
    scale(from(x->jump, 3 * n), 1.0 / c[2], from(run->x, n));
    x->follows_jump = 1;
    return 0;
}

int method_prepare_change(Instance *s) { return 0; }

void method_begin_step(Instance *s) {}

static void pack_motion(const Table *x, Reals y) {
    const int64_t n = x->n;
    copy(part(y, 0, n), x->q);
    copy(part(y, n, 2 * n), x->v);
    copy(part(y, 2 * n, 3 * n), x->ddq);
    copy(part(y, 3 * n, 3 * n + x->m), x->lam);
}

/* Starting values */

/* Second difference of the forces along the velocities; see StateEvaluator. */
static void evaluate_force_change(AlphaTable *x, double delta, Reals change) {
    Table *base = &x->base;
    const Reals none = {0}, step = x->run.prediction.q, shifted = x->run.prediction.a;
    scale(step, delta, base->v);
    clear_states(base, step);
    fill(change, 0.0);
    for (int shift = -1; shift <= 1; shift++) {
        combine2(shifted, 1.0, base->q, shift, step);
        evaluate_motion(&base->starter, &x->smooth_motion, base->t, shifted, base->v, none, none);
        add_to(change, shift == 0 ? -2.0 : 1.0, base->starter.levels);
    }
    clear_states(base, change);
}

/* Set accelerations, multipliers and starting values; see AlphaStart. */
int method_restart(Instance *s) {
    AlphaTable *x = table_of(s);
    Table *base = s->table;
    AlphaWorkspace *run = &x->run;
    MotionBuffers *start = &base->starter;
    const Reals change = part(run->change, 0, base->n);
    const double h = run->current.h, ratio = fmin(h / model.step, 1.0);
    run->has_started = run->has_jumped = x->follows_jump = 0;
    run->accepted_motion.h = 0.0;
    /* Gaps divided by the square of the step are errors of accelerations. */
    int code = make_consistent(s, ratio * ratio);
    if (code != DONE) return code;
    fill(x->jerk, 0.0);
    fill(x->velocity_error, 0.0);
    if (base->m > 0) {
        evaluate_constraint_rate(start, base->ddq, JERK_INTERVAL * h, base->rate);
        if (factorize_start(s, base->v, 0.0) != DONE) return SINGULAR;
        solve_constraints(start, base->rate);
        copy(x->jerk, start->solution);
        /* The jerk of holonomic constraints alone. */
        for (int64_t k = 0; k < run->form.velocity_rows.size; k++)
            base->rate.at[run->form.velocity_rows.at[k] - base->n] = 0.0;
        solve_constraints(start, base->rate);
        copy(x->velocity_error, start->solution);
    }
    evaluate_force_change(x, STIFF_TIME * h, change);
    code = solve_start(s, STIFF_TIME * h * STIFF_TIME * h, change);
    if (code != DONE) return code;
    copy(base->ddq, start->solution);
    combine2(run->current.a, 1.0, base->ddq, x->shift * h, x->jerk);
    add_to(base->v, h * h * run->defect, x->velocity_error);
    for (int64_t i = 0; i < base->n; i++)
        if (!isfinite(run->current.a.at[i]) || !isfinite(base->v.at[i])) return NOT_FINITE;
    return DONE;
}

/* Steps */

/* Equal steps to `end`. If `end` is too near for a step, the state remains that at the end of the
   last step, and the offset of `end` is stored. */
int method_advance(Instance *s, double end) {
    AlphaTable *x = table_of(s);
    Table *base = s->table;
    AlphaWorkspace *run = &x->run;
    const double length = end - base->t;
    base->offset = fmax(length, 0.0);
    if (length <= MIN_STEP_SHARE * model.step) return 0;
    const double count = fmax(ceil(length / model.step - SAME_TIME), 1.0);
    const double h = length / count, rounding = SAME_STEP * h + TIME_ROUNDING * fabs(end);
    base->offset = 0.0;
    if (fabs(h - run->current.h) > rounding) {
        run->current.h = h;
        if (restart(s)) return -1;
    }
    run->start_time = base->t;
    run->end = end;
    run->step_count = 0;
    run->total_steps = (int64_t)count;
    while (run->step_count < run->total_steps) {
        if (x->follows_jump)
            copy(x->start, x->jump);
        else
            pack_motion(base, x->start);
        if (report_step(s, take_steps(s))) return -1;
        base->t = run->t;
        base->has_stepped = 1;
        x->follows_jump = 0;
    }
    return 0;
}

/* After the end of the last step, accelerations are constant. */
void method_evaluate(Instance *s) {
    Table *x = s->table;
    const int64_t n = x->n;
    const double d = x->offset;
    const Reals q = part(x->inputs, 0, n), v = part(x->inputs, n, 2 * n);
    const Reals a = part(x->inputs, 2 * n, 3 * n);
    pack_motion(x, x->inputs);
    combine3(q, 1.0, q, d, v, 0.5 * d * d, a);
    add_to(v, d, a);
}

/* Derivatives */

/* Derivative of the scaled residual along the direction in `inputs`, in `change`. */
static void evaluate_direction(AlphaTable *x, double t) {
    AlphaWorkspace *run = &x->run;
    const int64_t n = x->base.n;
    const double *c = run->prediction.coefficients.at;
    set_time(&x->base.residual_direction, t, x->base.branch);
    evaluate_sum(&x->base.residual_direction, x->base.inputs, run->change);
    scale(part(run->change, 0, n), c[2], run->change);
    for (int64_t k = 0; k < run->form.velocity_rows.size; k++)
        run->change.at[run->form.velocity_rows.at[k]] /= c[0];
}

/* Let the equations of a step of length zero begin at y = (q, v, q'', lam). */
static void hold_motion(AlphaTable *x, Reals y) {
    StepPrediction *at = &x->run.prediction;
    const int64_t n = x->base.n;
    copy(at->q, y);
    copy(at->v, from(y, n));
    copy(at->a, from(y, 2 * n));
    fill(x->run.x, 0.0);
    scale(from(x->run.x, n), at->coefficients.at[2], from(y, 3 * n));
    copy(part(x->base.inputs, 0, y.size), y);
}

static int solve_direction(Instance *s, double t) {
    AlphaWorkspace *run = &table_of(s)->run;
    evaluate_step_matrix(&run->form, t, run->branch, &run->prediction, run->x, run->nonzeros);
    int code;
    while ((code = factorize(&run->linear, run->nonzeros)) == NEW_PIVOTS)
        renew_pivots(s, &run->linear, 0);
    run->linear.singular = 0;
    if (code != DONE)
        return fail(s, "The matrix is singular at t = %.9g s.", t);
    evaluate_direction(table_of(s), t);
    solve(&run->linear, run->change);
    release_matrices(s);
    return 0;
}

int method_derivative(Instance *s, const double *direction, Reals result) {
    AlphaTable *x = table_of(s);
    Table *base = s->table;
    AlphaWorkspace *run = &x->run;
    const int64_t n = base->n, m = base->m, size = 3 * n + m;
    const Reals y = part(base->inputs, 0, size), dy = part(base->inputs, size, 2 * size);
    const Reals dq = part(dy, 0, n), dv = part(dy, n, 2 * n), da = part(dy, 2 * n, 3 * n);
    const Reals dx = run->change, q = part(dx, 0, n);
    const double h = run->current.h, *c = run->prediction.coefficients.at;
    fill(dy, 0.0);
    write_direction(s, direction, from(base->inputs, 2 * size).at);
    /* Accelerations at the beginning of the step. */
    run->branch = base->branch;
    hold_motion(x, x->start);
    if (base->starter.states.size) {
        evaluate_direction(x, base->t - h);
        for (int64_t k = 0; k < base->starter.states.size; k++)
            dv.at[base->starter.states.at[k]] = -dx.at[base->starter.states.at[k]] / c[2];
    }
    if (solve_direction(s, base->t - h)) return -1;
    clear_states(base, dx);
    combine2(dq, h, dv, -0.5 * h * h * c[1], q);
    add_to(dv, -h * c[1], q);
    scale(da, -c[1], q);
    /* Step. */
    pack_motion(base, y);
    hold_motion(x, y);
    if (solve_direction(s, base->t)) return -1;
    add_to(dq, -1.0, q);
    add_to(dv, -c[0], q);
    add_to(da, -c[1], q);
    scale(from(dy, 3 * n), -1.0 / c[2], from(dx, n));
    set_time(&base->output_direction, base->t, base->branch);
    evaluate_sum(&base->output_direction, base->inputs, result);
    return 0;
}
