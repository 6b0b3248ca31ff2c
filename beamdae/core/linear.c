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
static inline Vector real_scale_lane(double a, Vector x) { return scaled(a, x); }
static inline Vector real_times_number(double a, Vector x) { return scaled(a, x); }
static inline Vector real_add_scaled(Vector z, double a, Vector x) {
    return plus(z, scaled(a, x));
}
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
static inline ComplexVector complex_scale_lane(double a, ComplexVector x) {
    return (ComplexVector){scaled(a, x.re), scaled(a, x.im)};
}
static inline ComplexVector complex_times_number(Complex a, ComplexVector x) {
    return complex_times(x, complex_broadcast(a));
}
static inline ComplexVector complex_add_scaled(ComplexVector z, Complex a, ComplexVector x) {
    const ComplexVector p = complex_times_number(a, x);
    return (ComplexVector){plus(z.re, p.re), plus(z.im, p.im)};
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
#define real_solve_each_lane solve_lanes
typedef ComplexFactors complex_Factors;
typedef ComplexSolver complex_Solver;
#define complex_factorize factorize_complex
#define complex_solve solve_complex
#define complex_solve_each_lane solve_complex_lanes

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
