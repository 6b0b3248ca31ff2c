/* Residual and Jacobian callbacks of IDA, and its step loop; see integrators/ida.

   beamdae's linear solver replaces that of IDA: IDA receives the residual premultiplied by the
   inverse of the Jacobian from its last setup, and the identity as Jacobian. The diagonal solver of
   IDA then only scales corrections by 2 / (1 + c / c_setup). */

#include "core.h"

/* Maximum number of steps with the same factors. IDA computes new factors only if the step changes
   by a third or Newton's iteration fails, and estimates the rate of convergence only in steps with
   two iterations. In long stretches of equal steps, the stiff directions of beams in absolute
   coordinates turn away from those of the factors, and single iterations leave errors near the
   tolerance. These excite vibrations that reduce the step: a beam that rotates at 6 rad/s took 2.5
   times as many steps. With 20, 50 and 100 steps, the numbers of steps agree within 1 %; CVODE uses
   50. */
#define MAX_STEPS_PER_FACTORIZATION 50
/* Relative difference below which two steps are equal. */
#define STEP_ROUNDING 1e-6
/* Codes of callbacks that make IDA try a shorter step, or give up. */
#define RECOVERABLE_FAILURE 1
#define UNRECOVERABLE_FAILURE (-1)
#define ONE_STEP 2 /* IDA_ONE_STEP */

typedef double *(*GetNumbers)(void *);

static Reals vector_numbers(const IdaWorkspace *run, void *vector) {
    return (Reals){((GetNumbers)run->sundials.N_VGetArrayPointer)(vector), run->y.size};
}

/* Multiply q' - v in a residual by S^-1; see integrators/ida/kinematic_scaling.py. */
static void scale_residual(const KinematicRowScaling *s, Reals y, Reals yp, Reals result) {
    ADD_WEIGHTED(result.at, s->rows.at, s->weights.at, yp.at, s->columns.at, 0, s->n);
    ADD_WEIGHTED(result.at, s->rows.at, s->weights.at, y.at, s->columns.at, s->n, 2 * s->n);
}

static void scale_jacobian(const KinematicRowScaling *s, double c, Reals nonzeros) {
    fill(part(s->factors, 0, s->n), c);
    ADD_WEIGHTED(nonzeros.at, s->entry_indices.at, s->weights.at, s->factors.at, s->columns.at, 0,
                 2 * s->n);
}

static int compute_factors(NewtonState *newton, double t, double c, Reals y, Reals yp) {
    evaluate_jacobian(&newton->form, t, newton->branch, c, y, yp, newton->nonzeros);
    scale_jacobian(&newton->kinematic, c, newton->nonzeros);
    newton->jacobians++;
    newton->has_factors = 0;
    int code;
    while ((code = factorize(&newton->linear, newton->nonzeros)) == NEW_PIVOTS)
        /* Without returning to IDA, so that steps do not depend on the pivots. */
        if (!((int (*)(void))newton->renew_address)()) return UNRECOVERABLE_FAILURE;
    newton->linear.singular = 0;
    if (code != DONE) return RECOVERABLE_FAILURE;
    newton->has_factors = 1;
    newton->c = c;
    newton->age = 0;
    return DONE;
}

/* Write the residual, premultiplied by the inverse of the last Jacobian, to `out`. Without factors,
   it is not premultiplied; `correction_fraction` is applied in both cases. */
int residual_callback(double t, void *y, void *yp, void *out, IdaWorkspace *run) {
    NewtonState *newton = &run->newton;
    const Reals at = vector_numbers(run, y), rates = vector_numbers(run, yp);
    const Reals result = vector_numbers(run, out);
    run->residual_vector = (int64_t)out;
    if (newton->has_factors && newton->age >= MAX_STEPS_PER_FACTORIZATION) {
        const int code = compute_factors(newton, t, newton->c, at, rates);
        if (code != DONE) return code;
    }
    evaluate_residual(&newton->form, t, newton->branch, at, rates, newton->raw_residual);
    scale_residual(&newton->kinematic, at, rates, newton->raw_residual);
    newton->residuals++;
    scale(result, newton->correction_fraction, newton->raw_residual);
    if (newton->has_factors) solve(&newton->linear, result);
    return DONE;
}

/* Factorize the Jacobian, and write the identity into `matrix`. The residual that IDA has just
   evaluated at the same point is replaced by the one premultiplied with the new factors. */
int jacobian_callback(double t, double c, void *y, void *yp, void *residual, void *matrix,
                      IdaWorkspace *run, void *work_1, void *work_2, void *work_3) {
    NewtonState *newton = &run->newton;
    const int code =
        compute_factors(newton, t, c, vector_numbers(run, y), vector_numbers(run, yp));
    if (code != DONE) return code;
    const Reals out = vector_numbers(run, (void *)run->residual_vector);
    scale(out, newton->correction_fraction, newton->raw_residual);
    solve(&newton->linear, out);
    const Reals diagonal = {((GetNumbers)run->sundials.SUNBandMatrix_Data)(matrix), run->y.size};
    fill(diagonal, 1.0);
    return DONE;
}

/* Latest end of the next step, after a step from `before` to `t`. If another step of the same
   length would leave a shorter last step, the remaining time is split into two equal steps: in the
   index-2 and index-3 forms, errors of multipliers are errors of velocities or positions divided by
   powers of the step. After a very short last step, multipliers were wrong by a fifth of their
   size. */
static double next_stop_time(double before, double t, double end) {
    const double step = t - before, remaining = end - t;
    if ((1.0 + STEP_ROUNDING) * step < remaining && remaining < 2.0 * step)
        return t + 0.5 * remaining;
    return end;
}

/* Count the order of the last step and the unknown with the largest error. */
static void record_order_and_error(IdaWorkspace *run) {
    const SundialsFunctions *ida = &run->sundials;
    void *memory = (void *)run->memory;
    ((int (*)(void *, void *))ida->IDAGetLastOrder)(memory, (void *)run->order_address);
    run->orders.at[run->order.at[0]]++;
    ((int (*)(void *, void *))ida->IDAGetEstLocalErrors)(memory, (void *)run->errors_vector);
    run->limiting_counts.at[locate_largest(run->errors, run->weights)]++;
}

static void store_row(IdaWorkspace *run) {
    const Reals stored = row(run->rows, run->filled++);
    const int64_t n = run->newton.form.n;
    stored.at[0] = run->t.at[0];
    copy(part(stored, 1, 1 + 2 * n), run->y);
    copy(part(stored, 1 + 2 * n, 1 + 3 * n), from(run->yp, n));
    copy(from(stored, 1 + 3 * n), from(run->has_impulses ? run->yp : run->y, 2 * n));
}

/* Take steps until the interval ends, the rows are full or IDA fails. */
int take_ida_steps(IdaWorkspace *run) {
    typedef int (*Solve)(void *, double, void *, void *, void *, int);
    const SundialsFunctions *ida = &run->sundials;
    void *memory = (void *)run->memory;
    while (run->t.at[0] < run->end) {
        if (run->filled == run->most) return FULL;
        const double before = run->t.at[0];
        const int code =
            ((Solve)ida->IDASolve)(memory, run->end, (void *)run->t_address, (void *)run->y_vector,
                                   (void *)run->yp_vector, ONE_STEP);
        if (code < 0) return code;
        if (!(run->t.at[0] > before)) return NO_ADVANCE;
        ((int (*)(void *, double))ida->IDASetStopTime)(
            memory, next_stop_time(before, run->t.at[0], run->end));
        run->newton.age++;
        record_order_and_error(run);
        store_row(run);
    }
    return DONE;
}
