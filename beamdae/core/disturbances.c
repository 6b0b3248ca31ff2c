/* Variational equations: linearized Radau steps for disturbances; see analysis/periodic.

   The steps propagate a block of disturbances at a time, one per vector lane: factors and matrices
   are read once per block. Vectors hold the first entry of all lanes, then the second one; indices
   and `KinematicReduction` refer to such vectors. */

#include "core.h"

#define MAX_ITERATIONS 20
/* The iteration stagnates at its rounding errors if a correction shrinks by less than this factor;
   corrections below this multiple of the tolerance are then accepted. */
#define STAGNATION_RATE 0.5
#define STAGNATION_FACTOR 1e3
/* Rate of convergence assumed in the first iteration of a step; later iterations measure it. */
#define FIRST_RATE 0.9
/* Disturbances whose size is smaller have decayed; products with tolerances would underflow. */
#define MIN_SIZE 1e-280

/* Evaluate the Jacobians of a step and factorize both matrices at its second stage. */
static int factorize_step(VariationalWorkspace *run, double h) {
    for (int i = 0; i < 3; i++) {
        const int64_t k = 3 * run->next + i;
        evaluate_jacobian_parts(&run->form, run->times.at[k], run->branch, row(run->states, k),
                                row(run->state_rates, k), row(run->jacobians, i));
    }
    return factorize_stages(&run->base, h, row(run->jacobians, 1));
}

/* Set the weights in which errors of the stages are at most 1 in each lane. They are relative to
   the disturbance of the lane, which is zero in lanes without one. */
static void set_weights(VariationalWorkspace *run) {
    const int64_t count = run->scales.size;
    for (int lane = 0; lane < LANES; lane++) {
        const double *y = run->base.y.at + lane;
        double size = 0.0;
        for (int64_t i = 0; i < count; i++)
            size = join_largest(size, fabs(y[LANES * i] * run->scales.at[i]));
        size *= run->tolerance;
        const double factor = size > MIN_SIZE ? 1.0 / size : 0.0;
        for (int64_t i = 0; i < count; i++)
            run->weights.at[LANES * i + lane] = factor * run->scales.at[i];
    }
}

/* Set the residual of stage i to the sum of all parts times their unknowns. The parts act on the
   stage, on its rates, and on accelerations; q' = v holds for defined velocities. */
static void multiply_parts(VariationalWorkspace *run, int i) {
    Stages *base = &run->base;
    const int64_t n = base->velocities.size, size = base->right.size;
    const uint32_t *starts = run->row_starts.at;
    const double *jacobian = row(run->jacobians, i).at;
    const Vector *unknowns = (const Vector *)run->unknowns.at;
    Vector *residual = (Vector *)row(run->residuals, i).at;
    reduce_unknowns(&base->reduction, n, row(base->stages, i), part(run->unknowns, 0, size));
    reduce_unknowns(&base->reduction, n, row(base->rates, i),
                    part(run->unknowns, size, 2 * size));
    copy(from(run->unknowns, 2 * size), from(row(base->rates, i), n));
    for (int64_t k = 0; k + 1 < run->row_starts.size; k++) {
        Vector sum = broadcast(0.0);
        for (uint32_t e = starts[k]; e < starts[k + 1]; e++)
            sum = plus(sum, scaled(jacobian[run->entry_sources.at[e]],
                                   unknowns[run->entry_columns.at[e]]));
        residual[k] = sum;
    }
}

/* Set the right-hand sides of the decoupled equations to combinations of the residuals. */
static void combine_residuals(VariationalWorkspace *run) {
    const double *a = run->base.tableau.from_stages.at;
    const Reals r0 = row(run->residuals, 0), r1 = row(run->residuals, 1);
    const Reals r2 = row(run->residuals, 2);
    double *complex_right = (double *)run->base.complex_right.at;
    combine3(run->base.right, a[0], r0, a[1], r1, a[2], r2);
    for (int64_t i = 0; i < r0.size; i++) {
        complex_right[2 * i] = a[3] * r0.at[i] + a[4] * r1.at[i] + a[5] * r2.at[i];
        complex_right[2 * i + 1] = a[6] * r0.at[i] + a[7] * r1.at[i] + a[8] * r2.at[i];
    }
}

/* Write block k of the disturbances at the end of the step to `ends`. The linear stage equations
   are solved by the simplified Newton iteration of radau.c, which begins with the extrapolation of
   the last step. */
static int propagate(VariationalWorkspace *run, double h, int64_t k) {
    Stages *base = &run->base;
    const Reals weights = run->weights, end = row(run->ends, k);
    copy(base->y, row(run->disturbances, k));
    for (int i = 0; i < 3; i++) copy(row(base->last_w, i), row(run->disturbances_w, 3 * k + i));
    predict_stages(base, h);
    set_weights(run);
    /* All disturbances have the same iteration matrix. */
    double previous = INFINITY, rate = run->rate > 0.0 ? run->rate : FIRST_RATE;
    for (int iteration = 0; iteration < MAX_ITERATIONS; iteration++) {
        set_stages(base, h);
        for (int i = 0; i < 3; i++) multiply_parts(run, i);
        combine_residuals(run);
        solve_lanes(&base->real_solver, base->right);
        solve_complex_lanes(&base->complex_solver, base->complex_right);
        subtract_corrections(base, h);
        double size = max_norm(part(base->real_change, 0, weights.size), weights);
        size = largest_of(size, max_norm(part(base->complex_real, 0, weights.size), weights));
        size = largest_of(size, max_norm(part(base->complex_imaginary, 0, weights.size), weights));
        if (!isfinite(size)) return NOT_FINITE;
        if (iteration > 0) rate = previous > 0.0 ? size / previous : 0.0;
        const int stagnates = rate > STAGNATION_RATE && size <= STAGNATION_FACTOR;
        if (stagnates || (rate < 1.0 && size * rate <= 1.0 - rate)) {
            const double *to_end = row(base->tableau.to_stages, 2).at;
            if (iteration > 0) run->rate = largest_of(run->rate, rate);
            combine4(end, 1.0, base->y, to_end[0], row(base->w, 0), to_end[1], row(base->w, 1),
                     to_end[2], row(base->w, 2));
            /* The equations do not depend on the time integrals of the multipliers. */
            fill(from(end, weights.size), 0.0);
            for (int i = 0; i < 3; i++) copy(row(run->ends_w, 3 * k + i), row(base->w, i));
            return DONE;
        }
        previous = size;
    }
    return NOT_CONVERGED;
}

/* Propagate the disturbances through the steps from `next` on. A step that fails leaves them
   unchanged. */
int propagate_disturbances(VariationalWorkspace *run) {
    while (run->next < run->steps) {
        const double h = run->h.at[run->next];
        int code = factorize_step(run, h);
        run->rate = 0.0;
        for (int64_t k = 0; code == DONE && k < run->count; k++) code = propagate(run, h, k);
        if (code != DONE) return code;
        for (int64_t k = 0; k < run->count; k++) copy(row(run->disturbances, k), row(run->ends, k));
        for (int64_t k = 0; k < 3 * run->count; k++)
            copy(row(run->disturbances_w, k), row(run->ends_w, k));
        run->base.step_size.last_step = h;
        run->next++;
    }
    return DONE;
}
