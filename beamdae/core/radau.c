/* Steps of three-stage Radau IIA of order 5; see integrators/radau.

   A step h from (t, y) solves R(t + c_i h, Y_i, Y'_i) = 0 with Y_i = y + h sum_j a_ij Y'_j and ends
   at Y_3. In terms of W, with Y - y = T W and h Y' = RATES W, Newton's equations decouple into real
   and complex equations; see integrators/radau/coefficients.py. */

#include "core.h"

#define MAX_ITERATIONS 10
/* Rate of convergence assumed in the first iteration; later iterations measure it. */
#define FIRST_RATE 0.99
/* The iteration stagnates at its rounding errors if a correction shrinks by less than this
   factor. */
#define STAGNATION_RATE 0.5
/* The local error of the embedded third-order method is of order 4. */
#define ERROR_EXPONENT 0.25
#define SAFETY 0.9
/* Bounds on the ratio of successive steps. */
#define MIN_FACTOR 0.2
#define MAX_FACTOR 4.0
/* Lower bound on the error, relative to the tolerance, from which the next step is computed. */
#define MIN_ERROR 1e-2
/* The step, and with it the factors, is kept if it would grow by less than this factor and Newton's
   iteration converges faster than KEEP_RATE. */
#define KEPT_GROWTH 1.2
#define KEEP_RATE 0.05
/* Relative difference below which two steps are equal: steps between the samples of a controller
   differ by rounding. */
#define STEP_ROUNDING 1e-9
/* Factor that reduces the step after a failure of Newton's iteration. */
#define FAILURE_FACTOR 0.5

static inline double entry(Reals2 x, int64_t i, int64_t j) { return x.at[i * x.columns + j]; }

/* Stages */

static inline double real_eigenvalue(const Stages *run) { return run->tableau.eigenvalues.at[0]; }

static inline double _Complex complex_eigenvalue(const Stages *run) {
    return CMPLX(run->tableau.eigenvalues.at[1], run->tableau.eigenvalues.at[2]);
}

/* Where no correction by joints enters q' = v, set velocities of the stages to the derivatives of
   their positions. */
static void derive_velocities(Stages *run, double h) {
    const Tableau *tableau = &run->tableau;
    const KinematicReduction *at = &run->reduction;
    const int64_t n = run->velocities.size;
    const Reals v = from(run->y, n);
    for (int i = 0; i < 3; i++) {
        const double *rates = row(tableau->rate_blocks, i).at;
        combine4(run->velocities, rates[0] / h, row(run->w, 0), rates[1] / h, row(run->w, 1),
                 rates[2] / h, row(run->w, 2), -tableau->start.at[i], v);
        PICK(row(run->w, i).at, at->defined_velocities.at, run->velocities.at, at->defined.at, 0,
             at->defined.size);
    }
}

/* Predict W from the last collocation polynomial, or with constant y' in a first step. */
void predict_stages(Stages *run, double h) {
    const Tableau *tableau = &run->tableau;
    const double last_step = run->step_size.last_step;
    if (last_step == 0.0) {
        for (int i = 0; i < 3; i++) scale(row(run->w, i), h * tableau->uniform.at[i], run->yp);
        derive_velocities(run, h);
        return;
    }
    double *extrapolation = run->extrapolation.at;
    for (int i = 0; i < 9; i++) extrapolation[i] = 0.0;
    for (int k = 0; k < 3; k++) {
        const double x = 1.0 + tableau->nodes.at[k] * (h / last_step);
        for (int j = 0; j < 3; j++) {
            double stage = (x - 1.0) * entry(tableau->polynomial, 0, j) +
                           (x * x - 1.0) * entry(tableau->polynomial, 1, j);
            stage += (x * x * x - 1.0) * entry(tableau->polynomial, 2, j);
            for (int i = 0; i < 3; i++)
                extrapolation[3 * i + j] += entry(tableau->from_stages, i, k) * stage;
        }
    }
    for (int i = 0; i < 3; i++) {
        const double *factors = extrapolation + 3 * i;
        combine3(row(run->w, i), factors[0], row(run->last_w, 0), factors[1], row(run->last_w, 1),
                 factors[2], row(run->last_w, 2));
    }
    derive_velocities(run, h);
}

/* Compute the stages Y and Y' from W. */
void set_stages(Stages *run, double h) {
    const Reals w0 = row(run->w, 0), w1 = row(run->w, 1), w2 = row(run->w, 2);
    for (int i = 0; i < 3; i++) {
        const double *to_stages = row(run->tableau.to_stages, i).at;
        const double *rates = row(run->tableau.rates, i).at;
        combine4(row(run->stages, i), 1.0, run->y, to_stages[0], w0, to_stages[1], w1,
                 to_stages[2], w2);
        combine3(row(run->rates, i), rates[0] / h, w0, rates[1] / h, w1, rates[2] / h, w2);
    }
}

static Reals jacobian_part(const Stages *run, Reals jacobian, int power) {
    const int64_t size = run->real_nonzeros.size;
    return part(jacobian, power * size, (power + 1) * size);
}

int factorize_stages(Stages *run, double h, Reals jacobian) {
    const double rate = real_eigenvalue(run) / h;
    const double _Complex complex_rate = complex_eigenvalue(run) / h;
    const double _Complex square = multiply_complex(complex_rate, complex_rate);
    const Reals a = jacobian_part(run, jacobian, 0), b = jacobian_part(run, jacobian, 1);
    const Reals c = jacobian_part(run, jacobian, 2);
    combine3(run->real_nonzeros, 1.0, a, rate, b, rate * rate, c);
    for (int64_t i = 0; i < a.size; i++)
        run->complex_nonzeros.at[i] = a.at[i] + complex_rate * b.at[i] + square * c.at[i];
    const int real_code = factorize(&run->real_solver, run->real_nonzeros);
    const int complex_code = factorize_complex(&run->complex_solver, run->complex_nonzeros);
    if (real_code == NEW_PIVOTS || complex_code == NEW_PIVOTS) return NEW_PIVOTS;
    run->real_solver.singular = run->complex_solver.singular = 0;
    return real_code == SINGULAR || complex_code == SINGULAR ? SINGULAR : DONE;
}

/* Derivatives of forces by resultants, followed by those of resultants by q and v. */
static const double *resultant_derivatives(const Stages *run) {
    return run->jacobian.at + 3 * run->real_nonzeros.size;
}

/* Remaining entries of a right-hand side, with the forces of the residuals of resultants. */
#define REDUCE_RIGHT(run, n, full, reduced)                                                        \
    do {                                                                                           \
        const KinematicReduction *at_ = &(run)->reduction;                                         \
        const double *forces_ = resultant_derivatives(run);                                        \
        const uint32_t *starts_ = at_->force_starts.at, *rows_ = at_->force_rows.at;               \
        const int64_t count_ = at_->corrected.size, n_ = (n);                                      \
        const int64_t last_ = (reduced).size - count_ + n_;                                        \
        for (int64_t i_ = 0; i_ < n_; i_++) (reduced).at[i_] = (full).at[n_ + i_];                 \
        PICK((reduced).at, at_->remaining_velocities.at, (full).at, at_->corrected.at, 0, count_); \
        for (int64_t i_ = n_ + count_; i_ < (reduced).size; i_++)                                  \
            (reduced).at[i_] = (full).at[i_ - count_ + n_];                                        \
        for (int64_t i_ = last_; i_ < (full).size; i_++)                                           \
            for (uint32_t e_ = starts_[i_ - last_]; e_ < starts_[i_ - last_ + 1]; e_++)            \
                (reduced).at[rows_[e_]] += forces_[e_] * (full).at[i_];                            \
    } while (0)

static inline double multiply_real(double x, double y) { return x * y; }

/* Correction of all unknowns, with x_v = c x_q for defined velocities. Resultants satisfy their
   linearized laws, whose residuals `full` contains. */
#define EXPAND_SOLUTION(product, run, n, c, reduced, full)                                         \
    do {                                                                                           \
        const KinematicReduction *at_ = &(run)->reduction;                                         \
        const double *laws_ = resultant_derivatives(run) + at_->force_rows.size;                   \
        const uint32_t *starts_ = at_->law_starts.at, *columns_ = at_->law_columns.at;             \
        const int64_t count_ = at_->corrected.size, n_ = (n);                                      \
        const int64_t last_ = (reduced).size - count_ + n_;                                        \
        for (int64_t i_ = 0; i_ < n_; i_++) (full).at[i_] = (reduced).at[i_];                      \
        for (int64_t i_ = 0; i_ < n_; i_++) (full).at[n_ + i_] = product(c, (reduced).at[i_]);     \
        PICK((full).at, at_->corrected_velocities.at, (reduced).at,                                \
             at_->remaining_velocities.at, 0, count_);                                             \
        for (int64_t i_ = 2 * n_; i_ < last_; i_++)                                                \
            (full).at[i_] = (reduced).at[i_ - n_ + count_];                                        \
        for (int64_t i_ = last_; i_ < (full).size; i_++) {                                         \
            (full).at[i_] = -(full).at[i_];                                                        \
            for (uint32_t e_ = starts_[i_ - last_]; e_ < starts_[i_ - last_ + 1]; e_++)            \
                (full).at[i_] += laws_[e_] * (full).at[columns_[e_]];                              \
            (full).at[i_] = product(1.0 / (c), (full).at[i_]);                                     \
        }                                                                                          \
    } while (0)

/* Subtract the corrections from W that belong to the solutions `right` and `complex_right` of the
   reduced equations. */
void subtract_corrections(Stages *run, double h) {
    const int64_t n = run->velocities.size;
    const double rate = real_eigenvalue(run) / h;
    const double _Complex complex_rate = complex_eigenvalue(run) / h;
    EXPAND_SOLUTION(multiply_real, run, n, rate, run->right, run->real_change);
    EXPAND_SOLUTION(multiply_complex, run, n, complex_rate, run->complex_right,
                    run->complex_change);
    for (int64_t i = 0; i < run->complex_change.size; i++) {
        run->complex_real.at[i] = creal(run->complex_change.at[i]);
        run->complex_imaginary.at[i] = cimag(run->complex_change.at[i]);
    }
    add_to(row(run->w, 0), -1.0, run->real_change);
    add_to(row(run->w, 1), -1.0, run->complex_real);
    add_to(row(run->w, 2), -1.0, run->complex_imaginary);
}

/* Newton's iteration */

int factorize_matrices(RadauWorkspace *run, double h) {
    Stages *base = &run->base;
    run->factors_step = 0.0;
    evaluate_jacobian_parts(&run->form, run->t + base->tableau.nodes.at[1] * h, run->branch,
                            row(base->stages, 1), row(base->rates, 1), base->jacobian);
    const int code = factorize_stages(base, h, base->jacobian);
    if (code != NEW_PIVOTS) run->jacobians++;
    if (code == DONE) run->factors_step = h;
    return code;
}

void correct_stages(RadauWorkspace *run, double h) {
    Stages *base = &run->base;
    const double *a = base->tableau.from_stages.at;
    const Reals r0 = row(run->stage_residuals, 0), r1 = row(run->stage_residuals, 1);
    const Reals r2 = row(run->stage_residuals, 2);
    combine3(base->real_change, a[0], r0, a[1], r1, a[2], r2);
    for (int64_t i = 0; i < base->complex_change.size; i++)
        base->complex_change.at[i] = CMPLX(a[3] * r0.at[i] + a[4] * r1.at[i] + a[5] * r2.at[i],
                                           a[6] * r0.at[i] + a[7] * r1.at[i] + a[8] * r2.at[i]);
    REDUCE_RIGHT(base, run->form.n, base->real_change, base->right);
    REDUCE_RIGHT(base, run->form.n, base->complex_change, base->complex_right);
    solve(&base->real_solver, base->right);
    solve_complex(&base->complex_solver, base->complex_right);
    subtract_corrections(base, h);
}

double max_modulus(Complexes x, Reals weights) {
    double largest = 0.0;
    for (int64_t i = 0; i < weights.size; i++)
        largest = join_largest(largest, cabs(x.at[i] * weights.at[i]));
    return largest;
}

/* Largest residual, beyond rounding errors of positions and velocities, of the laws of resultants in
   the stages, relative to the largest resultant. */
static double law_error(const RadauWorkspace *run, double h) {
    const KinematicReduction *at = &run->base.reduction;
    const double *laws = resultant_derivatives(&run->base) + at->force_rows.size;
    const int64_t count = at->law_starts.size - 1, first = run->form.size - count, n = run->form.n;
    double error = 0.0, largest = 0.0;
    for (int64_t k = 0; k < count; k++) {
        double rounding = 0.0;
        for (uint32_t e = at->law_starts.at[k]; e < at->law_starts.at[k + 1]; e++) {
            const int64_t column = at->law_columns.at[e], coordinate = column % n;
            const double size = fabs(laws[e]) / run->velocity_rounding_weights.at[coordinate];
            rounding += column < n ? size : size / h;
        }
        for (int i = 0; i < 3; i++) {
            const double residual = row(run->stage_residuals, i).at[first + k];
            error = join_largest(error, fabs(residual) - run->rounding_ratio * rounding);
            largest = join_largest(largest, fabs(row(run->base.rates, i).at[first + k]));
        }
    }
    return error > 0.0 ? error / largest : 0.0;
}

static int iterate_newton(RadauWorkspace *run, double h) {
    Stages *base = &run->base;
    const Reals weights = run->iteration_weights;
    double previous = INFINITY, rate = FIRST_RATE, last_ratio = 0.0;
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        run->iterations = k + 1;
        if (k > 0) set_stages(base, h);
        for (int i = 0; i < 3; i++)
            evaluate_residual(&run->form, run->t + base->tableau.nodes.at[i] * h, run->branch,
                              row(base->stages, i), row(base->rates, i),
                              row(run->stage_residuals, i));
        run->residuals += 3;
        const double error = law_error(run, h);
        correct_stages(run, h);
        const double real_size = max_norm(part(base->real_change, 0, weights.size), weights);
        const double complex_size = max_modulus(base->complex_change, weights);
        if (!isfinite(real_size) || !isfinite(complex_size)) return NOT_FINITE;
        const double size = largest_of(real_size, complex_size);
        if (k > 0) {
            /* Corrections may alternate: the first one also changes forces, which the norm does not
               contain and which cause most of the second. */
            const double ratio = previous > 0.0 ? size / previous : 0.0;
            rate = k > 1 ? sqrt(ratio * last_ratio) : ratio;
            last_ratio = ratio;
            if (rate > STAGNATION_RATE && size <= run->stagnation_limit &&
                error <= run->law_tolerance) {
                run->rate = rate;
                return DONE;
            }
            if (k > 1 && rate > 1.0) break;
        }
        if (rate < 1.0 && size * rate <= 1.0 - rate && error * rate <= run->law_tolerance) {
            run->rate = k > 0 ? rate : 0.0;
            return DONE;
        }
        previous = size;
    }
    return NOT_CONVERGED;
}

/* At the start of an interval, set resultants to those of the positions and velocities: the values
   of their laws, which are last in the residual, without them. */
static void determine_resultants(RadauWorkspace *run) {
    const Reals residual = row(run->stage_residuals, 0);
    const int64_t count = run->base.reduction.law_starts.size - 1;
    if (count == 0) return;
    const Reals resultants = from(run->base.yp, residual.size - count);
    fill(resultants, 0.0);
    evaluate_residual(&run->form, run->t, run->branch, run->base.y, run->base.yp, residual);
    run->residuals++;
    copy(resultants, from(residual, residual.size - count));
}

/* Solve for the stages of a step h; `renew` requests new factors. */
static int solve_stages(RadauWorkspace *run, double h, int renew) {
    if (run->base.step_size.last_step == 0.0) determine_resultants(run);
    predict_stages(&run->base, h);
    set_stages(&run->base, h);
    minimum(from(run->iteration_weights, run->form.n), run->velocity_weights,
            h / run->rounding_ratio, run->velocity_rounding_weights);
    if (renew) {
        const int code = factorize_matrices(run, h);
        if (code != DONE) return code;
    }
    return iterate_newton(run, h);
}

/* Error test */

/* Set `out` to a part of the matrix times a vector. */
static void multiply_part(const RadauWorkspace *run, int power, Reals x, Reals out) {
    const Reals values = jacobian_part(&run->base, run->base.jacobian, power);
    fill(out, 0.0);
    for (int64_t e = 0; e < values.size; e++)
        out.at[run->entry_rows.at[e]] += values.at[e] * x.at[run->entry_columns.at[e]];
}

/* Write the error estimate, filtered to damp stiff components, to `error`.

   With y^ = y_n + h (y'_n / gamma + sum_i b^_i Y'_i), of order 3, and e = y^ - y_{n+1}, the filter
   (R_y + (gamma/h) R_y') x = (gamma/h) R_y' e passes slow components and damps fast ones. For
   R = M y' - f(y), this is the estimate of RADAU5. Constraints do not contain y', so their rows of
   R_y' e are zero. In these rows, the right-hand side is R_y e: the error of the prescribed motion,
   which is the only error if all motions are prescribed. Multipliers enter R by their derivatives,
   in the same columns of both matrices, so that their errors do not affect other components. */
static void estimate_error(RadauWorkspace *run, double h) {
    Stages *base = &run->base;
    const KinematicReduction *at = &base->reduction;
    const int64_t n = run->form.n, first = n + at->corrected.size;
    const double rate = real_eigenvalue(base) / h, *embedded = base->tableau.embedded.at;
    const Reals difference = run->difference, velocities = base->velocities, right = base->right;
    combine4(difference, 1.0 / rate, base->yp, embedded[0], row(base->w, 0), embedded[1],
             row(base->w, 1), embedded[2], row(base->w, 2));
    /* In rows q' = v, the right-hand side is rate * e_q. The reduced equations require zeros there:
       x_v + rate * e_q replaces x_v, and e_v + rate * e_q replaces e_v in the other rows. */
    combine2(velocities, 1.0, from(difference, n), rate, difference);
    fill(run->vector, 0.0);
    copy(part(run->vector, 0, n), velocities);
    /* The parts of R_y in the rows of constraints, and of (gamma/h) R_y' in the others. */
    multiply_part(run, 2, run->vector, right);
    multiply_part(run, 1, run->vector, run->constraint_errors);
    reduce_unknowns(at, n, difference, run->vector);
    multiply_part(run, 1, run->vector, run->product);
    combine2(right, rate, right, rate, run->product);
    multiply_part(run, 0, run->vector, run->product);
    combine2(from(right, first), 1.0, from(run->constraint_errors, first), 1.0,
             from(run->product, first));
    solve(&base->real_solver, right);
    EXPAND_SOLUTION(multiply_real, base, n, rate, right, run->error);
    combine2(velocities, rate, right, -rate, difference);
    PICK(run->error.at, at->defined_velocities.at, velocities.at, at->defined.at, 0,
         at->defined.size);
}

/* Largest error of the tested components relative to their tolerances. The estimate of multipliers
   is that of their integrals over the step. */
static double measure_error(RadauWorkspace *run, double h) {
    const int64_t n = run->form.n;
    /* Rounding errors of positions divided by a short step are errors of velocities. */
    minimum(from(run->test_weights, n), run->tested_velocity_weights, h,
            run->velocity_rounding_weights);
    const double error = max_norm(part(run->error, 0, run->test_weights.size), run->test_weights);
    if (h <= run->shortest_tested_step) return error;
    const Reals weights = run->multiplier_weights;
    const Reals tested = part(run->error, 2 * n, 2 * n + weights.size);
    return largest_of(error, max_norm(tested, weights) * (real_eigenvalue(&run->base) / h));
}

/* Steps */

static int can_reuse_factors(const RadauWorkspace *run, double h) {
    return fabs(h - run->factors_step) <= STEP_ROUNDING * h && run->rate <= KEEP_RATE;
}

/* Step ratio that the error allows, reduced after many Newton iterations. */
static double step_factor(const RadauWorkspace *run, double error) {
    const int64_t most = 2 * MAX_ITERATIONS;
    return SAFETY * (most + 1) / (most + run->iterations) / pow(error, ERROR_EXPONENT);
}

/* Set the next step after an accepted step h; see `StepSizeState`. */
static void accept_step(RadauWorkspace *run, double h, double error) {
    StepSizeState *size = &run->base.step_size;
    error = largest_of(error, MIN_ERROR);
    double factor = step_factor(run, error);
    if (size->last_step > 0.0)
        factor *= smallest_of(1.0, h / size->last_step *
                                       pow(size->last_error / error, ERROR_EXPONENT));
    factor = smallest_of(largest_of(factor, MIN_FACTOR), size->is_retry ? 1.0 : MAX_FACTOR);
    const double candidate = smallest_of(factor * h, size->longest);
    const int keep = h <= candidate && candidate <= KEPT_GROWTH * h && can_reuse_factors(run, h);
    size->next_step = keep ? h : candidate;
    /* After a rejected attempt, its failure explains why the next step may be too small. */
    if (!size->is_retry) run->failure_code = TOO_SMALL;
    size->last_step = h;
    size->last_error = error;
    size->is_retry = 0;
}

/* Store the stages of an accepted step as rows; the last stage starts the next step. */
static void store_step(RadauWorkspace *run, double h, int last) {
    Stages *base = &run->base;
    const int64_t n = run->form.n;
    set_stages(base, h);
    for (int i = 0; i < 3; i++) {
        const Reals stored = row(run->rows, run->filled + i);
        stored.at[0] = run->t + base->tableau.nodes.at[i] * h;
        copy(part(stored, 1, 1 + 2 * n), row(base->stages, i));
        /* The multipliers are derivatives of unknowns and follow the accelerations in y'. */
        copy(from(stored, 1 + 2 * n), from(row(base->rates, i), n));
        copy(row(base->last_w, i), row(base->w, i));
    }
    lower_weights(run->multiplier_weights, run->multiplier_tolerance,
                  from(row(base->rates, 2), 2 * n));
    run->t = last ? run->end : run->t + h;
    row(run->rows, run->filled + 2).at[0] = run->t;
    run->filled += 3;
    copy(base->y, row(base->stages, 2));
    copy(base->yp, row(base->rates, 2));
}

/* Take steps that pass the error test until the interval ends or the rows are full. Return DONE,
   FULL, NEW_PIVOTS, or the code of the last failure if steps become too small. */
int take_radau_steps(RadauWorkspace *run) {
    StepSizeState *size = &run->base.step_size;
    while (run->t < run->end) {
        if (run->filled == 3 * run->most) return FULL;
        const double remaining = run->end - run->t, h = clip_step(size->next_step, remaining);
        /* The next step is NaN after an error estimate that is NaN. */
        if (size->next_step != size->next_step || h < smallest_of(size->smallest, remaining))
            return (int)run->failure_code;
        const int renew = !can_reuse_factors(run, h);
        const int code = solve_stages(run, h, renew);
        if (code == NEW_PIVOTS) return code;
        if (code != DONE) {
            run->failures++;
            run->factors_step = 0.0;
            if (renew) {
                run->rejections++;
                run->failure_code = code;
                size->next_step = FAILURE_FACTOR * h;
                size->is_retry = 1;
            }
            continue;
        }
        estimate_error(run, h);
        const double error = measure_error(run, h);
        if (error < 1.0) {
            accept_step(run, h, error);
            store_step(run, h, h == remaining);
            continue;
        }
        run->rejections++;
        run->failure_code = ERROR_TOO_LARGE;
        size->next_step = h * smallest_of(largest_of(step_factor(run, error), MIN_FACTOR), SAFETY);
        if (error != error) size->next_step = error;
        size->is_retry = 1;
    }
    return DONE;
}
