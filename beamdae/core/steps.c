/* Parts of steps that several methods share. */

#include "core.h"

/* A step of at least this fraction of the rest of an interval ends at the end of the interval. */
#define LAST_STEP_MARGIN (1.0 - 1e-9)
#define MAX_FRICTION_ITERATIONS 50
#define FRICTION_TOLERANCE 1e-10
#define MAX_FRICTION_ROUNDING 1e-6

/* The next step [s]: the rest of the interval if `step` covers it, otherwise at most half of it, so
   that the last step is not much shorter than those before it. */
double clip_step(double step, double remaining) {
    if (step >= LAST_STEP_MARGIN * remaining) return remaining;
    return smallest_of(step, 0.5 * remaining);
}

/* Lower the weights of multipliers whose values are the largest so far. */
void lower_weights(Reals weights, double tolerance, Reals values) {
    for (int64_t k = 0; k < weights.size; k++) {
        const double limit = tolerance * fabs(values.at[k]);
        if (limit * weights.at[k] > 1.0) weights.at[k] = 1.0 / limit;
    }
}

/* Motion at given positions and velocities */

static void copy_or_clear(Reals out, Reals x) {
    if (x.size)
        copy(out, x);
    else
        fill(out, 0.0);
}

void evaluate_motion(MotionBuffers *x, Sum *total, double t, Reals q, Reals v, Reals a, Reals lam) {
    const int64_t n = x->n, m = x->m;
    copy_or_clear(part(x->inputs, 0, n), q);
    copy_or_clear(part(x->inputs, n, 2 * n), v);
    copy_or_clear(part(x->inputs, 2 * n, 3 * n), a);
    copy_or_clear(part(x->inputs, 3 * n, 3 * n + m), lam);
    set_time(total, t, x->branch);
    evaluate_sum(total, x->inputs, x->levels);
}

int factorize_saddle(MotionBuffers *x, Reals v, Reals lam, double stiffness) {
    evaluate_motion(x, &x->motion, x->t, x->q, v, (Reals){0}, lam);
    set_time(&x->saddle, x->t, x->branch);
    set_matrix_factors(&x->saddle, stiffness, 0.0, 1.0, 1.0, 1.0, 1.0);
    evaluate_sum(&x->saddle, x->inputs, x->nonzeros);
    const int code = factorize(&x->linear, x->nonzeros);
    if (code != NEW_PIVOTS) x->linear.singular = 0;
    return code;
}

void solve_constraints(MotionBuffers *x, Reals right) {
    fill(part(x->solution, 0, x->n), 0.0);
    scale(from(x->solution, x->n), -1.0, right);
    solve(&x->linear, x->solution);
}

void evaluate_constraint_rate(MotionBuffers *x, Reals a, double interval, Reals rate) {
    const int64_t n = x->n, m = x->m;
    const Reals q = part(x->inputs, 0, n), v = part(x->inputs, n, 2 * n);
    fill(rate, 0.0);
    for (int side = 1; side >= -1; side -= 2) {
        const double d = side * interval;
        combine3(q, 1.0, x->q, d, x->v, 0.5 * d * d, a);
        combine2(v, 1.0, x->v, d, a);
        evaluate_motion(x, &x->motion, x->t + d, q, v, a, (Reals){0});
        add_to(rate, 0.5 / d, part(x->levels, n + 2 * m, n + 3 * m));
    }
}

/* The equations are linear but for friction, whose forces depend on reactions. The criteria are
   those of `ConsistencySolver`: reactions may be rounding errors beside the accelerations. */
int solve_accelerations(MotionBuffers *x, double stiffness, Reals change) {
    const int64_t n = x->n, m = x->m;
    const Reals lam = x->lam, forces = part(x->solution, 0, n), found = from(x->solution, n);
    const uint32_t *starts = x->linear.plan.matrix_starts.at, *rows = x->linear.plan.matrix_rows.at;
    double last = INFINITY;
    for (int k = 0; k < MAX_FRICTION_ITERATIONS; k++) {
        const int code = factorize_saddle(x, x->v, lam, stiffness);
        if (code != DONE) return code;
        scale(forces, -1.0, x->levels);
        if (change.size) add_to(forces, -1.0, change);
        scale(found, -1.0, from(x->levels, n + 2 * m));
        /* dF/dlam is the difference between the upper right block and G^T. */
        for (int64_t j = 0; j < n + m && x->has_friction; j++)
            for (uint32_t e = starts[j]; e < starts[j + 1]; e++) {
                const int64_t row = rows[e];
                const double value = x->nonzeros.at[e];
                if (j >= n && row < n) forces.at[row] += value * lam.at[j - n];
                if (j < n && row >= n) forces.at[j] -= value * lam.at[row - n];
            }
        solve(&x->linear, x->solution);
        double correction = 0.0, size = 0.0;
        for (int64_t i = 0; i < m; i++)
            correction = largest_of(correction, fabs(found.at[i] - lam.at[i]));
        for (int64_t i = 0; i < n + m; i++) size = largest_of(size, fabs(x->solution.at[i]));
        copy(lam, found);
        const double relative = correction > 0.0 ? correction / size : 0.0;
        const int is_rounding = last <= relative && relative <= MAX_FRICTION_ROUNDING;
        if (!x->has_friction || relative <= FRICTION_TOLERANCE || is_rounding) return DONE;
        last = relative;
    }
    return NOT_CONVERGED;
}

int solve_jump(MotionBuffers *x) {
    evaluate_motion(x, &x->motion, x->t, x->q, x->v, (Reals){0}, x->lam);
    for (int64_t i = 0; i < x->states.size; i++) /* Their rows are x' - f. */
        x->v.at[x->states.at[i]] -= x->levels.at[x->states.at[i]];
    const int code = solve_accelerations(x, 0.0, (Reals){0});
    for (int64_t i = 0; i < x->solution.size && code == DONE; i++)
        if (!isfinite(x->solution.at[i])) return NOT_FINITE;
    return code;
}
