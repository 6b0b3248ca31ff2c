/* Static equations with a load factor and one control equation; see analysis/statics.

       [[F_x, column], [row, corner]] solution = right

   with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
   change, U and L those that are particular to the unloaded and to the loaded mechanism. */

#include "core.h"

#define MAX_ITERATIONS 12
/* Corrections below this size, in natural sizes, are rounding errors of solutions. If corrections
   stop decreasing, they are rounding errors up to the second size. */
#define TOLERANCE 1e-10
#define ROUNDING 1e-7
/* Convergence is quadratic if the last but one correction is below the first number: the next one
   is then predicted, and need not be made if it is below the second one. */
#define QUADRATIC 1e-3
#define NEGLIGIBLE 1e-15
/* Largest correction of one iteration, in natural sizes: farther, the linearization says nothing.
   It grows while the equations are linear: the next correction then has the predicted size. */
#define MAX_CORRECTION 0.5
#define CORRECTION_GROWTH 10.0
#define MAX_PREDICTION_ERROR 0.3
/* Forces and tangent */

static void evaluate_forces(StaticWorkspace *run) {
    if (run->has_forces) return;
    LoadPart *common = &run->common, *unloaded = &run->unloaded, *loaded = &run->loaded;
    const int64_t n = run->inputs.size - run->forces.size, joints = run->joint_count;
    evaluate_sum(&common->residual, run->inputs, common->forces);
    evaluate_sum(&unloaded->residual, run->inputs, unloaded->forces);
    evaluate_sum(&loaded->residual, run->inputs, loaded->forces);
    /* Increments, so that entries without loads are independent of mu to the last digit. */
    combine2(run->by_factor, run->scale, loaded->forces, -run->scale, unloaded->forces);
    combine3(run->forces, 1.0, common->forces, 1.0, unloaded->forces, run->mu - run->center,
             run->by_factor);
    add_to(from(run->forces, n + joints), -1.0, from(run->inputs, 2 * n + joints));
    run->has_forces = 1;
}

static void evaluate_tangent(StaticWorkspace *run) {
    if (run->has_tangent) return;
    LoadPart *common = &run->common, *unloaded = &run->unloaded, *loaded = &run->loaded;
    const double mu = (run->mu - run->center) * run->scale;
    evaluate_sum(&common->tangent, run->inputs, common->nonzeros);
    evaluate_sum(&unloaded->tangent, run->inputs, unloaded->nonzeros);
    evaluate_sum(&loaded->tangent, run->inputs, loaded->nonzeros);
    combine3(run->nonzeros, 1.0, common->nonzeros, 1.0 - mu, unloaded->nonzeros, mu,
             loaded->nonzeros);
    ADD(run->nonzeros.at, run->added_targets.at, run->added.at, run->counting.at, 0,
        run->added.size);
    run->has_tangent = 1;
    run->has_factors = 0;
}

/* Let axial and shear forces depend on the multipliers alone, until the strains follow them.
   Strains of other points are much larger than those of equilibria. */
static void determine_resultants(StaticWorkspace *run) {
    const int64_t m = run->remainder.size;
    const Reals multipliers = from(run->inputs, run->inputs.size - m);
    const Reals constraints = from(run->forces, run->forces.size - m);
    for (int64_t k = 0; k < m; k++)
        multipliers.at[k] -= run->remainder.at[k] * constraints.at[k];
    run->has_forces = run->has_tangent = run->has_factors = 0;
    evaluate_forces(run);
}

/* Newton's method */

/* Solve with F_mu and `row` as border. */
static int solve_newton(StaticWorkspace *run) {
    const int64_t size = run->forces.size, first = run->column_start;
    if (!run->has_factors) {
        PICK(run->nonzeros.at, run->row_targets.at, run->row.at, run->counting.at, 0, size + 1);
        copy(part(run->nonzeros, first, first + size), run->by_factor);
        multiply(run->scaled, run->nonzeros, run->products);
        const int code = factorize(&run->linear, run->scaled);
        if (code != DONE) return code;
        run->has_factors = 1;
    }
    multiply(run->right, run->right, run->sizes);
    solve(&run->linear, run->right);
    multiply(run->right, run->right, run->sizes);
    return DONE;
}

/* Return 1 if a point is a solution after a correction. */
static int is_negligible(double size, double last) {
    if (last <= QUADRATIC && size * size * size <= NEGLIGIBLE * (last * last)) return 1;
    return size <= TOLERANCE || (size <= ROUNDING && size > 0.5 * last);
}

/* Add a correction, and set its share; return DONE if the point is a solution after it, CORRECTED
   if another one is needed, or the code of a failure. */
int judge_correction(Corrections *run) {
    const double share = run->share, size = run->size, last = run->last;
    run->count++;
    run->share = 1.0;
    if (!isfinite(size)) return NOT_FINITE;
    if (run->is_solved < 0 ? is_negligible(size, last) : run->is_solved) return DONE;
    if (run->count > 3 && size > 2.0 * largest_of(last, run->earlier)) return DIVERGED;
    if (share < 1.0) {
        const double error = fabs(size - (1.0 - share) * last);
        const int is_linear = error <= MAX_PREDICTION_ERROR * share * last;
        run->bound = is_linear ? run->bound * CORRECTION_GROWTH : MAX_CORRECTION;
    }
    if (size > run->bound) run->share = run->bound / size;
    run->last = size;
    run->earlier = last;
    return run->count < MAX_ITERATIONS ? CORRECTED : NOT_CONVERGED;
}

/* Correct a point by Newton's method until it is a solution, or once if the control is not linear.
   At a solution, the right-hand side is the derivatives by the control before the last
   correction. */
static int correct(StaticWorkspace *run) {
    const int64_t size = run->forces.size, n = run->inputs.size - size;
    const Reals right = run->right, q = part(run->inputs, 0, n), lam = from(run->inputs, 2 * n);
    int code = CORRECTED;
    while (code == CORRECTED) {
        if (!run->has_forces) {
            evaluate_forces(run);
            determine_resultants(run);
        }
        evaluate_tangent(run);
        scale(part(right, 0, size), -1.0, run->forces);
        right.at[size] = -run->deviation;
        const int solver_code = solve_newton(run);
        if (solver_code != DONE) return solver_code;
        run->corrections.size = max_norm(part(right, 0, size), run->weights);
        code = judge_correction(&run->corrections);
        const double share = run->corrections.share;
        add_to(q, share, right);
        add_to(lam, share, from(right, n));
        run->mu += share * right.at[size];
        run->deviation += share * inner_product(run->row, right);
        run->has_forces = run->has_tangent = 0;
        if (!run->is_linear) break;
    }
    if (code != DONE) return code;
    fill(right, 0.0);
    right.at[size] = 1.0;
    return solve_newton(run);
}

int perform_task(StaticWorkspace *run) {
    if (run->task == CORRECT) return correct(run);
    if (run->task == EVALUATE_FORCES) evaluate_forces(run);
    if (run->task == EVALUATE_TANGENT) evaluate_tangent(run);
    return DONE;
}
