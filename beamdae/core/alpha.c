/* Steps of the generalized-alpha family, fixed and adaptive; see integrators/alpha. */

#include "core.h"

/* Relative difference below which two steps are equal. */
#define SAME_STEP 1e-9
/* Interval of the finite difference of accelerations for the jerk, relative to the step. */
#define JERK_INTERVAL 1e-2
/* The step grows by a factor from MIN_GROWTH to MAX_GROWTH if this many steps allow it: new factors
   cost more than a few steps, and the estimate vanishes briefly when the jerk of a vibration
   crosses zero. */
#define STEPS_BEFORE_GROWTH 8
#define MIN_GROWTH 1.2
#define MAX_GROWTH 2.0
/* Bounds on the factor that reduces a step whose error is too large, and the factor after a failure
   of Newton's iteration, when the error is unknown. */
#define WEAKEST_SHRINKAGE 0.9
#define STRONGEST_SHRINKAGE 0.2
#define FAILURE_FACTOR 0.5
#define SAFETY 0.8
/* Coordinates whose vectors fit into the fastest processor cache together: several operations on
   them read each number from memory once. */
#define CHUNK 512
/* Newton's iteration keeps its factors while the rate of convergence, the ratio of successive
   corrections, is at most the first value, and computes new factors within a step if the rate
   exceeds the second one. */
#define KEEP_RATE 0.05
#define SLOW_RATE 0.2
/* With existing factors, the iteration diverges if the correction grows by more than this factor.
   With new factors, corrections of slender beams grow until the beams have their lengths again. */
#define MAX_CORRECTION_GROWTH 2.0
/* Lower bounds on the estimated rate of convergence from the second iteration on, and in the
   first. */
#define MIN_RATE 1e-4
#define MIN_FIRST_RATE 1e-2
#define MAX_ITERATIONS 12
/* Corrections that decrease by less than this factor are rounding errors: of positions, if they are
   at most ROUNDING_GROWTH times `min_correction_limit`, and of reactions, if they are smaller than
   REACTION_ROUNDING, relative to the largest reaction, or after this many iterations with new
   factors. */
#define STAGNATION_RATE 0.5
#define ROUNDING_GROWTH 10.0
#define REACTION_ROUNDING 1e-6
#define REACTION_ITERATIONS 4
/* Lower bound on the tolerance of reactions, relative to that of positions: squares of reactions
   would overflow at the start of a Gaussian pulse, where all are below 1e-150 N. */
#define MIN_REACTION_TOLERANCE 1e-60
/* Error of multipliers between the steps, relative to the difference from their extrapolation. */
#define MULTIPLIER_DIFFERENCE 0.125
/* Lower bound on the error, relative to the tolerance, from which the next step is computed. */
#define MIN_ERROR 1e-9

static void copy_motion(Motion *target, const Motion *source) {
    copy(target->q, source->q);
    copy(target->v, source->v);
    copy(target->ddq, source->ddq);
    copy(target->a, source->a);
    copy(target->lam, source->lam);
    target->h = source->h;
}

static void store_row(AlphaWorkspace *run) {
    const int64_t n = run->current.q.size;
    const Reals stored = row(run->rows, run->filled++);
    stored.at[0] = run->t;
    copy(part(stored, 1, 1 + n), run->current.q);
    copy(part(stored, 1 + n, 1 + 2 * n), run->current.v);
    copy(part(stored, 1 + 2 * n, 1 + 3 * n), run->current.ddq);
    copy(from(stored, 1 + 3 * n), run->current.lam);
}

/* Set the length h of the next steps, with the coefficients that depend on it. */
static void set_step(AlphaWorkspace *run, double h) {
    const double c_f = h * h * run->beta, before = run->accepted_motion.h;
    double *c = run->prediction.coefficients.at;
    c[0] = run->gamma / (h * run->beta);
    c[1] = (1.0 - run->alpha_m) / ((1.0 - run->alpha_f) * c_f);
    c[2] = c_f;
    run->step_ratio = before > 0.0 ? h / before : 0.0;
    run->current.h = h;
    run->rate = INFINITY;
}

/* Prepare for the starting values that the caller has just set, for steps `current.h`. */
static void begin_interval(AlphaWorkspace *run) {
    if (run->has_started) return;
    set_step(run, run->current.h);
    run->has_started = 1;
}

/* Newton's iteration */

static int factorize_step_matrix(AlphaWorkspace *run, double t) {
    evaluate_step_matrix(&run->form, t, run->branch, &run->prediction, run->x, run->nonzeros);
    const int code = factorize(&run->linear, run->nonzeros);
    /* With new pivots, the matrix is evaluated again. */
    if (code != NEW_PIVOTS) run->jacobians++;
    run->rate = code == DONE ? 0.0 : INFINITY;
    return code;
}

/* Iterate until the corrections of positions and of tested reactions are small. Without a test of
   the reactions, those of driven mechanisms, whose positions the constraints determine, would not
   converge with forces that depend on reactions or velocities. Rounding errors may exceed the
   limit: small corrections that no longer decrease end the iteration. */
static int iterate_newton(AlphaWorkspace *run, double t, int may_renew) {
    const int64_t n = run->current.q.size, m = run->current.lam.size;
    const double limit = run->correction_limit;
    const double rounding = ROUNDING_GROWTH * run->min_correction_limit;
    const Reals x = run->x, change = run->change;
    double previous = INFINITY;
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        evaluate_step_residual(&run->form, t, run->branch, &run->prediction, x, change);
        run->residuals++;
        solve(&run->linear, change);
        add_to(x, -1.0, change);
        const double q_size = euclidean_norm(part(change, 0, n), run->weights);
        double size = q_size;
        if (run->reaction_factor > 0.0) {
            const double reaction =
                run->reaction_factor *
                euclidean_norm(part(change, n, n + m), run->reaction_weights);
            size = sqrt(q_size * q_size + reaction * reaction);
        }
        if (k == 0 && !isfinite(size)) return NOT_FINITE;
        /* Corrections of reactions that remain after those of positions may grow. */
        const int of_reactions =
            q_size < size && size < INFINITY && q_size <= largest_of(limit, rounding);
        const int shrinks = size <= rounding || size <= MAX_CORRECTION_GROWTH * previous;
        if (!isfinite(size) || !(shrinks || of_reactions || may_renew)) return NOT_CONVERGED;
        if (k > 0) run->rate = previous > 0.0 ? largest_of(size / previous, MIN_RATE) : 0.0;
        const double rate = k > 0 ? run->rate : largest_of(run->rate, MIN_FIRST_RATE);
        if (rate < 1.0 && size * rate <= limit * (1.0 - rate)) return DONE;
        if (k > 0 && rate > STAGNATION_RATE) {
            if (size <= rounding) return DONE;
            const int is_small = size * run->newton_tolerance <= REACTION_ROUNDING * limit;
            if (of_reactions && (is_small || (may_renew && k + 1 >= REACTION_ITERATIONS)))
                return DONE;
            if (of_reactions && !may_renew) return NOT_CONVERGED;
        }
        if (may_renew && rate > SLOW_RATE) {
            const int code = factorize_step_matrix(run, t);
            if (code != DONE) return code;
        }
        previous = size;
    }
    return NOT_CONVERGED;
}

/* Newton's iteration of a fixed number of corrections with one matrix. */
static int iterate_fixed_number(AlphaWorkspace *run, double t) {
    const int64_t n = run->current.q.size;
    double previous = INFINITY;
    const int code = factorize_step_matrix(run, t);
    for (int64_t k = 0; k < run->fixed_iterations && code == DONE; k++) {
        evaluate_step_residual(&run->form, t, run->branch, &run->prediction, run->x, run->change);
        solve(&run->linear, run->change);
        add_to(run->x, -1.0, run->change);
        const double size = euclidean_norm(part(run->change, 0, n), run->weights);
        if (!isfinite(size)) return NOT_FINITE;
        if (size > MAX_CORRECTION_GROWTH * previous && size > run->correction_limit)
            return NOT_CONVERGED;
        previous = size;
    }
    return code;
}

/* Solve the step equations for x in up to three attempts: with the existing factors, with new
   factors, and with new factors starting from uniform motion. Uniform motion is the better first
   iterate under a violent load, when the accelerations of light, stiff coordinates are huge for an
   instant. */
static int solve_step(AlphaWorkspace *run, double t) {
    const int64_t n = run->current.q.size;
    const Reals x = part(run->x, 0, n), multipliers = from(run->x, n);
    if (run->fixed_iterations > 0) return iterate_fixed_number(run, t);
    copy(run->first_multipliers, multipliers);
    if (run->rate <= KEEP_RATE) {
        const int code = iterate_newton(run, t, 0);
        if (code == DONE || code == NOT_FINITE) return code;
        run->failures++;
    }
    int code = SINGULAR;
    for (int attempt = 0; attempt < 2; attempt++) {
        fill(x, 0.0);
        copy(multipliers, run->first_multipliers);
        if (attempt == 1)
            combine3(x, 1.0, run->current.q, run->current.h, run->current.v, -1.0,
                     run->prediction.q);
        code = factorize_step_matrix(run, t);
        if (code == DONE) code = iterate_newton(run, t, 1);
        if (code == DONE || code == NOT_FINITE || code == NEW_PIVOTS) return code;
        run->failures++;
    }
    run->linear.singular = 0;
    return code;
}

/* Set the limit of corrections, and the factor that compares those of reactions with it. */
static void set_correction_limit(AlphaWorkspace *run) {
    const double factor = run->newton_tolerance * run->prediction.coefficients.at[2];
    const double limit = factor * max_norm(run->current.ddq, run->weights);
    run->correction_limit = largest_of(limit, run->min_correction_limit);
    const double reaction = factor * max_norm(run->current.lam, run->reaction_weights);
    const double tolerance = largest_of(reaction / run->correction_limit, MIN_REACTION_TOLERANCE);
    run->reaction_factor = reaction > 0.0 ? 1.0 / tolerance : 0.0;
}

/* Steps */

/* Predict the coordinates begin:end with their derivatives, and store their last values; q'' is
   extrapolated. */
static void predict_coordinates(AlphaWorkspace *run, const double *extrapolation, int64_t begin,
                                int64_t end) {
    const double h = run->current.h, beta = run->beta, gamma = run->gamma;
    const double factor = 1.0 / (1.0 - run->alpha_m);
    StepPrediction *at = &run->prediction;
    const Reals q = part(run->current.q, begin, end), v = part(run->current.v, begin, end);
    const Reals a = part(run->current.a, begin, end), ddq = part(run->current.ddq, begin, end);
    const Reals predicted = part(at->a, begin, end);
    const Reals a_predicted = part(run->a_predicted, begin, end);
    const Reals ddq_n = part(run->ddq_n, begin, end);
    combine2(predicted, extrapolation[0], ddq, extrapolation[1], ddq_n);
    combine3(a_predicted, factor * (1.0 - run->alpha_f), predicted, factor * run->alpha_f, ddq,
             -factor * run->alpha_m, a);
    combine4(part(at->q, begin, end), 1.0, q, h, v, h * h * (0.5 - beta), a, h * h * beta,
             a_predicted);
    combine3(part(at->v, begin, end), 1.0, v, h * (1.0 - gamma), a, h * gamma, a_predicted);
    copy(ddq_n, ddq);
    copy(part(run->a_n, begin, end), a);
    if (run->form.stabilized) copy(part(at->before, begin, end), q);
    fill(part(run->x, begin, end), 0.0);
}

/* Advance the current motion to the time t; a failure leaves it unchanged. */
static int advance_step(AlphaWorkspace *run, double t) {
    const int64_t n = run->current.q.size, end = n + run->current.lam.size;
    Motion *current = &run->current;
    StepPrediction *at = &run->prediction;
    const double *c = at->coefficients.at;
    const double extrapolation[2] = {1.0 + run->step_ratio, -run->step_ratio};
    const Reals multipliers = part(run->x, n, end);
    for (int64_t begin = 0; begin < n; begin += CHUNK)
        predict_coordinates(run, extrapolation, begin, begin + CHUNK < n ? begin + CHUNK : n);
    combine2(multipliers, c[2] * extrapolation[0], current->lam, c[2] * extrapolation[1],
             run->lam_n);
    copy(run->lam_n, current->lam);
    fill(from(run->x, end), 0.0);
    set_correction_limit(run);
    const int code = solve_step(run, t);
    if (code != DONE) return code;
    const Reals q = evaluate_step_position(&run->form, at, run->x);
    for (int64_t begin = 0; begin < n; begin += CHUNK) {
        const int64_t stop = begin + CHUNK < n ? begin + CHUNK : n;
        const Reals d = part(run->x, begin, stop);
        copy(part(current->q, begin, stop), from(q, begin));
        combine2(part(current->v, begin, stop), 1.0, from(at->v, begin), c[0], d);
        combine2(part(current->ddq, begin, stop), 1.0, from(at->a, begin), c[1], d);
        combine2(part(current->a, begin, stop), 1.0, from(run->a_predicted, begin), 1.0 / c[2], d);
    }
    scale(current->lam, 1.0 / c[2], multipliers);
    run->t = t;
    run->step_ratio = 1.0;
    return DONE;
}

/* Change accelerations and multipliers after a jump of held inputs. Positions and velocities are
   continuous. The changes solve the equations of a step of length zero: these are the equations of
   motion with M + c_v/c_a C + K/c_a in place of M, which reduces the accelerations of modes too
   fast for the step, as at the start of an interval. The algorithmic acceleration changes by the
   same amount. */
static int apply_input_jump(AlphaWorkspace *run) {
    const int64_t n = run->current.q.size, end = n + run->current.lam.size;
    Motion *current = &run->current;
    StepPrediction *at = &run->prediction;
    const double *c = at->coefficients.at;
    const Reals x = run->x, change = part(run->change, 0, n), multipliers = part(x, n, end);
    copy(at->q, current->q);
    copy(at->before, current->q);
    copy(at->a, current->ddq);
    fill(part(x, 0, n), 0.0);
    scale(multipliers, c[2], current->lam);
    fill(from(x, end), 0.0);
    if (run->states.size > 0) { /* Their rows are c_f (x' - f). */
        copy(at->v, current->v);
        evaluate_step_residual(&run->form, run->t, run->branch, at, x, run->change);
        for (int64_t i = 0; i < run->states.size; i++) {
            const int64_t k = run->states.at[i];
            current->v.at[k] -= change.at[k] / c[2];
        }
    }
    copy(at->v, current->v);
    set_correction_limit(run);
    const int code = solve_step(run, run->t);
    if (code != DONE) return code;
    scale(change, c[1], x);
    for (int64_t i = 0; i < run->states.size; i++) change.at[run->states.at[i]] = 0.0;
    add_to(current->ddq, 1.0, change);
    add_to(current->a, 1.0, change);
    add_to(run->ddq_n, 1.0, change);
    /* The differences from which the predictor extrapolates do not change. */
    combine3(run->lam_n, 1.0, run->lam_n, -1.0, current->lam, 1.0 / c[2], multipliers);
    scale(current->lam, 1.0 / c[2], multipliers);
    run->has_jumped = 0;
    return DONE;
}

int take_fixed_steps(AlphaWorkspace *run) {
    begin_interval(run);
    if (run->has_jumped) return apply_input_jump(run);
    while (run->step_count < run->total_steps) {
        if (run->filled == run->most) return FULL;
        const int64_t next = run->step_count + 1;
        const int last = next == run->total_steps;
        const int code =
            advance_step(run, last ? run->end : next * run->current.h + run->start_time);
        if (code != DONE) return code;
        run->step_count = next;
        store_row(run);
    }
    return DONE;
}

/* Adaptive steps */

/* Jerk P q''' prescribed by holonomic constraints, the first part of `jerk.solution`; see
   `ConsistencySolver.evaluate_normal_jerk`. */
static int evaluate_normal_jerk(AlphaWorkspace *run, double interval) {
    MotionBuffers *jerk = &run->jerk;
    const Motion *at = &run->accepted_motion;
    const Integers velocity_rows = run->form.velocity_rows;
    jerk->t = run->t, jerk->branch = run->branch;
    jerk->q = at->q, jerk->v = at->v;
    evaluate_constraint_rate(jerk, at->ddq, interval, run->constraint_rate);
    for (int64_t k = 0; k < velocity_rows.size; k++)
        run->constraint_rate.at[velocity_rows.at[k] - jerk->n] = 0.0;
    const int code = factorize_saddle(jerk, jerk->v, (Reals){0}, 0.0);
    if (code == DONE) solve_constraints(jerk, run->constraint_rate);
    return code;
}

/* Convert the motion to the step length h, preserving second order.

   a_n = q''_n + shift h_n q''' + O(h^2) depends on the last step h_n; for a step h it becomes
   q''_n + (h / h_n) (a_n - q''_n). In the index-3 form, the velocities contain the error
   h_n^2 defect P q''', which compensates the local error defect h^3 q''' so that positions satisfy
   the constraints. This velocity error is converted to h^2 defect P q'''. Without the first
   conversion, the method would be of first order if the step changed repeatedly; without the
   second, multipliers would be of first order after every change. Cf. Arnold, Hante & Koebis, PAMM
   14 (2014) 27. Bruls & Arnold, J. Comput. Nonlinear Dyn. 3 (2008) 041007, instead make the
   parameters depend on the step ratio. */
static int change_step(AlphaWorkspace *run, double h) {
    const Motion *accepted = &run->accepted_motion;
    Motion *current = &run->current;
    const double h_n = accepted->h, ratio = h / h_n;
    copy_motion(current, accepted);
    if (run->corrects_velocities && h != h_n) {
        const int code = evaluate_normal_jerk(run, JERK_INTERVAL * h);
        if (code != DONE) {
            current->h = 0.0;
            return code == NEW_PIVOTS ? NEW_PIVOTS : STEP_NOT_CHANGED;
        }
        combine2(current->v, 1.0, accepted->v, (h * h - h_n * h_n) * run->defect,
                 run->jerk.solution);
    }
    combine2(current->a, 1.0 - ratio, accepted->ddq, ratio, accepted->a);
    set_step(run, h);
    return DONE;
}

/* Factor for the next step; the error, relative to the tolerance, grows with h^3. */
static double step_factor(double error) {
    return SAFETY * pow(largest_of(error, MIN_ERROR), -1.0 / 3.0);
}

/* Largest error of the tested multipliers relative to their tolerances. The difference from the
   extrapolated multipliers is of order h^2; the power 3/2 makes its ratio to the tolerance grow
   with h^3, as the error of the positions. */
static double multiplier_error(const AlphaWorkspace *run) {
    const int64_t first = run->current.q.size;
    double largest = 0.0;
    for (int64_t k = 0; k < run->multiplier_weights.size; k++) {
        const double change = run->x.at[first + k] - run->first_multipliers.at[k];
        largest = largest_of(largest, fabs(change) * run->multiplier_weights.at[k]);
    }
    const double c_f = run->prediction.coefficients.at[2];
    return pow(MULTIPLIER_DIFFERENCE * largest / c_f, 1.5);
}

/* Error of the step h relative to the tolerance, from the change of the algorithmic acceleration.
   It causes errors of positions of order h^3, and of velocities of order h^2, which the power 3/2
   makes as large in motions with the rate of the scales: forces that are shorter than a step hardly
   change positions. */
static double estimate_error(AlphaWorkspace *run, double h, int has_extrapolated) {
    combine2(run->a_predicted, 1.0, run->current.a, -1.0, run->a_n);
    const double position = h * h * max_norm(run->a_predicted, run->weights);
    const double velocity = h * max_norm(run->a_predicted, run->velocity_weights);
    const double largest = join_largest(position, velocity * sqrt(velocity));
    const double error = fabs(run->defect) * largest / run->tolerance;
    if (has_extrapolated && h > run->shortest_tested_step)
        return largest_of(error, multiplier_error(run));
    return error;
}

/* Count an accepted step; increase the step if the last eight accepted steps allow it. */
static void accept_step(AlphaWorkspace *run, double h) {
    run->steps_checked++;
    run->max_error = largest_of(run->max_error, run->error);
    if (run->steps_checked < STEPS_BEFORE_GROWTH) return;
    const double growth = smallest_of(step_factor(run->max_error), MAX_GROWTH);
    if (growth >= MIN_GROWTH) run->next_step = smallest_of(h * growth, run->max_step);
    run->steps_checked = 0;
    run->max_error = 0.0;
}

/* Reduce the step after an error that is too large or unknown. */
static void reject_step(AlphaWorkspace *run, double h) {
    double shrinkage = FAILURE_FACTOR;
    if (isfinite(run->error))
        shrinkage = largest_of(smallest_of(step_factor(run->error), WEAKEST_SHRINKAGE),
                               STRONGEST_SHRINKAGE);
    run->next_step = h * shrinkage;
    run->unclipped_step = 0.0;
    run->steps_checked = 0;
    run->max_error = 0.0;
}

int take_adaptive_steps(AlphaWorkspace *run) {
    Motion *current = &run->current, *accepted = &run->accepted_motion;
    begin_interval(run);
    if (run->has_jumped) {
        const int code = apply_input_jump(run);
        copy_motion(accepted, current);
        return code;
    }
    while (run->t < run->end) {
        if (run->filled == run->most) return FULL;
        const double remaining = run->end - run->t;
        double h = clip_step(run->next_step, remaining);
        if (h < run->next_step) run->unclipped_step = largest_of(run->unclipped_step, run->next_step);
        const int last = h == remaining;
        if (fabs(h - accepted->h) <= SAME_STEP * h) h = accepted->h;
        if (h != current->h) {
            run->next_step = h;
            if (accepted->h == 0.0) return FIRST_STEP;
            const int code = change_step(run, h);
            if (code != DONE) return code;
        }
        const double t = run->t;
        const int has_extrapolated = run->step_ratio > 0.0;
        copy(run->lam_before, run->lam_n);
        int code = advance_step(run, last ? run->end : t + h);
        if (code == NEW_PIVOTS) return code;
        run->error = INFINITY;
        if (code == DONE) {
            run->error = estimate_error(run, h, has_extrapolated);
            code = ERROR_TOO_LARGE;
        }
        if (run->error <= 1.0) {
            copy_motion(accepted, current);
            lower_weights(run->multiplier_weights, run->multiplier_tolerance, current->lam);
            accept_step(run, h);
            store_row(run);
            continue;
        }
        run->t = t;
        run->rejections++;
        reject_step(run, h);
        copy_motion(current, accepted);
        if (run->multiplier_weights.size > 0) copy(run->lam_n, run->lam_before);
        /* Negated, so that NaN also stops the run. */
        if (!(run->next_step >= run->min_step)) return code;
        current->h = 0.0;
    }
    return DONE;
}
