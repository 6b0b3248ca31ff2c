/* Parts of steps that several methods share. */

#include "core.h"

/* A step of at least this fraction of the rest of an interval ends at the end of the interval. */
#define LAST_STEP_MARGIN (1.0 - 1e-9)
#define FRICTION_TOLERANCE 1e-10

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

/* Make the rates of states, the accelerations and the multipliers consistent after a jump of held
   inputs. Without friction, whose forces depend on reactions, the equations are linear. */
int solve_jump(InputJumpWorkspace *run) {
    const int64_t n = run->form.n, m = run->change.size - n;
    const Reals y = run->y, yp = run->yp, change = run->change, residual = run->residual;
    const Reals a = part(yp, n, 2 * n), lam = part(run->has_impulses ? yp : y, 2 * n, 2 * n + m);
    evaluate_residual(&run->form, run->t, run->branch, y, yp, residual);
    for (int64_t i = 0; i < run->states.size; i++) { /* Their rows are x' - f. */
        const int64_t k = run->states.at[i];
        y.at[n + k] -= residual.at[n + k];
        yp.at[k] = y.at[n + k];
    }
    for (int64_t iteration = 0; iteration < run->max_iterations; iteration++) {
        evaluate_residual(&run->form, run->t, run->branch, y, yp, residual);
        scale(part(change, 0, n), -1.0, from(residual, n));
        fill(from(change, n), 0.0);
        for (int64_t i = 0; i < run->states.size; i++) change.at[run->states.at[i]] = 0.0;
        copy(part(run->motion, 0, 2 * n), y);
        copy(part(run->motion, 2 * n, 3 * n), a);
        copy(from(run->motion, 3 * n), lam);
        set_time(&run->saddle, run->t, run->branch);
        set_matrix_factors(&run->saddle, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0);
        evaluate_sum(&run->saddle, run->motion, run->nonzeros);
        const int code = factorize(&run->linear, run->nonzeros);
        if (code != NEW_PIVOTS) run->linear.singular = 0;
        if (code != DONE) return code;
        solve(&run->linear, change);
        add_to(a, 1.0, change);
        add_to(lam, 1.0, from(change, n));
        const double size = largest_of(max_norm(a, run->weights), max_norm(lam, run->weights));
        if (!isfinite(size + max_norm(part(yp, 0, n), run->weights))) return NOT_FINITE;
        if (run->max_iterations == 1 || max_norm(change, run->weights) <= FRICTION_TOLERANCE * size)
            return DONE;
    }
    return NOT_CONVERGED;
}
