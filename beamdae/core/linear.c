/* Linear systems: instances of elimination.h for real and complex numbers, and the elimination of
   symmetric matrices in a fixed order. */

#include "core.h"

#include <string.h>

/* A solution is accurate if its backward error does not exceed this value. */
#define MAX_BACKWARD_ERROR 1e-10
/* Pivots that require more steps of iterative refinement are rejected. */
#define MAX_REFINEMENTS 2
/* Bound on the interior unknowns of a block, see linear/lane_blocks.py. */
#define MAX_INTERIOR 16

/* Row of `EliminationPlan.batches`. */
typedef struct {
    int64_t interior, neighbors, shared, first_unknown, first_entry, first_corner;
} Batch;

typedef struct { Vector re, im; } ComplexVector;
typedef double _Complex Complex;

/* One number per lane at the indices `at`, of arrays whose numbers have `parts` parts. */
static inline Register pick_register(const double *x, const uint32_t *at, int parts) {
#define NUMBER_OF(k) x[parts * at[k]]
    return (Register)NUMBERS(NUMBER_OF);
}
static inline Vector pick_lanes(const double *x, const uint32_t *at, int parts) {
    Vector z;
#define PICK_LANES(f, first) z.f = pick_register(x, at + first, parts);
    FIELDS(PICK_LANES)
    return z;
}
static inline void put_lanes(double *x, const uint32_t *at, int parts, Vector value) {
#define PUT_LANES(f, first)                                                                        \
    for (int l = 0; l < WIDTH; l++) x[parts * at[first + l]] = value.f[l];
    FIELDS(PUT_LANES)
}
static inline void add_each_lane(double *x, const uint32_t *at, int parts, Vector value) {
#define ADD_EACH(f, first)                                                                         \
    for (int l = 0; l < WIDTH; l++) x[parts * at[first + l]] += value.f[l];
    FIELDS(ADD_EACH)
}
/* Sum of all lanes, by halves. */
static inline double sum_by_halves(Vector vector) {
    const double *x = (const double *)&vector;
    const double a = x[0] + x[4], b = x[1] + x[5], c = x[2] + x[6], d = x[3] + x[7];
    return (a + c) + (b + d);
}

static inline Vector real_gather(const double *x, const uint32_t *at) {
    return pick_lanes(x, at, 1);
}
static inline void real_scatter(double *x, const uint32_t *at, Vector value) {
    put_lanes(x, at, 1, value);
}
static inline void real_add_lanes(double *x, const uint32_t *at, Vector value) {
    add_each_lane(x, at, 1, value);
}
static inline double real_sum_halves(Vector x) { return sum_by_halves(x); }
static inline Vector real_times(Vector x, Vector y) { return times(x, y); }
static inline Vector real_subtract_product(Vector z, Vector x, Vector y) {
    return minus(z, times(x, y));
}
static inline Vector real_broadcast(double x) { return broadcast(x); }
static inline Vector real_invert_lane(Vector x) { return inverse(x); }
static inline double real_product(double x, double y) { return x * y; }
static inline double real_invert(double x) { return 1.0 / x; }
static inline double real_modulus(double x) { return fabs(x); }
static inline int real_is_finite(double x) { return isfinite(x); }

static inline ComplexVector complex_gather(const Complex *x, const uint32_t *at) {
    const double *re = (const double *)x;
    return (ComplexVector){pick_lanes(re, at, 2), pick_lanes(re + 1, at, 2)};
}
static inline void complex_scatter(Complex *x, const uint32_t *at, ComplexVector value) {
    put_lanes((double *)x, at, 2, value.re);
    put_lanes((double *)x + 1, at, 2, value.im);
}
static inline void complex_add_lanes(Complex *x, const uint32_t *at, ComplexVector value) {
    add_each_lane((double *)x, at, 2, value.re);
    add_each_lane((double *)x + 1, at, 2, value.im);
}
static inline Complex complex_sum_halves(ComplexVector x) {
    return CMPLX(sum_by_halves(x.re), sum_by_halves(x.im));
}
static inline ComplexVector complex_times(ComplexVector x, ComplexVector y) {
    return (ComplexVector){minus(times(x.re, y.re), times(x.im, y.im)),
                           plus(times(x.re, y.im), times(x.im, y.re))};
}
static inline ComplexVector complex_subtract_product(ComplexVector z, ComplexVector x,
                                                     ComplexVector y) {
    const ComplexVector p = complex_times(x, y);
    return (ComplexVector){minus(z.re, p.re), minus(z.im, p.im)};
}
static inline ComplexVector complex_broadcast(Complex x) {
    return (ComplexVector){broadcast(creal(x)), broadcast(cimag(x))};
}
static inline ComplexVector complex_invert_lane(ComplexVector x) {
    const Vector reciprocal = inverse(plus(times(x.re, x.re), times(x.im, x.im)));
    return (ComplexVector){times(x.re, reciprocal), times(negative(x.im), reciprocal)};
}
static inline Complex complex_product(Complex x, Complex y) { return multiply_complex(x, y); }
/* Smith's division, which does not overflow. */
static inline Complex complex_invert(Complex x) {
    const double re = creal(x), im = cimag(x);
    if (fabs(re) >= fabs(im)) {
        const double ratio = im / re, denominator = re + im * ratio;
        return CMPLX(1.0 / denominator, -ratio / denominator);
    }
    const double ratio = re / im, denominator = re * ratio + im;
    return CMPLX(ratio / denominator, -1.0 / denominator);
}
/* 1 to 1.42 times the modulus, but much cheaper to compute. */
static inline double complex_modulus(Complex x) { return fabs(creal(x)) + fabs(cimag(x)); }
static inline int complex_is_finite(Complex x) {
    return isfinite(creal(x)) && isfinite(cimag(x));
}

typedef Factors real_Factors;
typedef LinearSolver real_Solver;
#define real_factorize factorize
#define real_solve solve
typedef ComplexFactors complex_Factors;
typedef ComplexSolver complex_Solver;
#define complex_factorize factorize_complex
#define complex_solve solve_complex

#define NUMBER double
#define ARRAY Reals
#define LANE Vector
#define NAME(x) real_##x
#include "elimination.h"
#undef NUMBER
#undef ARRAY
#undef LANE
#undef NAME

#define NUMBER Complex
#define ARRAY Complexes
#define LANE ComplexVector
#define NAME(x) complex_##x
#include "elimination.h"

/* Replace the right-hand side of each lane by the solution, without refinement. */
static void substitute_lanes(const LinearSolver *linear, Vector *right, Vector *x) {
    const EliminationPlan *plan = &linear->plan;
    const uint32_t *upper_starts = plan->upper_starts.at, *upper_rows = plan->upper_rows.at;
    const uint32_t *lower_starts = plan->lower_starts.at, *lower_rows = plan->lower_rows.at;
    const double *lower = linear->factors.lower.at, *upper = linear->factors.upper.at;
    const int64_t size = plan->rows.size;
    for (int64_t k = 0; k < size; k++) x[k] = right[plan->rows.at[k]];
    for (int64_t k = 0; k < size; k++)
        for (uint32_t q = lower_starts[k]; q < lower_starts[k + 1]; q++)
            x[lower_rows[q]] = minus(x[lower_rows[q]], scaled(lower[q], x[k]));
    for (int64_t k = size - 1; k >= 0; k--) {
        x[k] = scaled(linear->factors.inverse.at[k], x[k]);
        for (uint32_t p = upper_starts[k]; p < upper_starts[k + 1]; p++)
            x[upper_rows[p]] = minus(x[upper_rows[p]], scaled(upper[p], x[k]));
    }
    for (int64_t k = 0; k < size; k++) right[plan->columns.at[k]] = x[k];
}

/* As `solve`, for at most `LANES` rows and a plan without blocks. */
static void solve_lanes(LinearSolver *linear, Reals2 rows, Vector *lanes) {
    const EliminationPlan *plan = &linear->plan;
    const uint32_t *starts = plan->matrix_starts.at, *matrix_rows = plan->matrix_rows.at;
    const double *matrix = linear->factors.matrix.at, *scale = plan->scale.at;
    const int64_t size = plan->scale.size;
    Vector *right = lanes, *x = lanes + size, *residual = lanes + 2 * size;
    linear->solves += rows.rows;
    for (int64_t i = 0; i < size; i++) {
        double numbers[LANES] = {0.0};
        for (int64_t l = 0; l < rows.rows; l++) numbers[l] = scale[i] * row(rows, l).at[i];
        right[i] = x[i] = *(const Vector *)numbers;
    }
    substitute_lanes(linear, x, lanes + 3 * size);
    for (int64_t count = linear->factors.refinements.at[0]; count > 0; count--) {
        for (int64_t i = 0; i < size; i++) residual[i] = right[i];
        for (int64_t j = 0; j < size; j++)
            for (uint32_t e = starts[j]; e < starts[j + 1]; e++) {
                Vector *to = residual + matrix_rows[e];
                *to = minus(*to, scaled(matrix[e], x[j]));
            }
        substitute_lanes(linear, residual, lanes + 3 * size);
        for (int64_t i = 0; i < size; i++) x[i] = plus(x[i], residual[i]);
    }
    for (int64_t i = 0; i < size; i++)
        for (int64_t l = 0; l < rows.rows; l++) row(rows, l).at[i] = ((const double *)(x + i))[l];
}

void solve_rows(LinearSolver *linear, Reals2 right, Reals lanes) {
    const int in_lanes = linear->plan.batches.rows == 0 && linear->full.size == 0;
    int64_t k = 0;
    for (; in_lanes && k + 1 < right.rows; k += LANES) {
        const int64_t rest = right.rows - k;
        solve_lanes(linear, rows_of(right, k, rest < LANES ? rest : LANES), (Vector *)lanes.at);
    }
    for (; k < right.rows; k++) solve(linear, row(right, k));
}
