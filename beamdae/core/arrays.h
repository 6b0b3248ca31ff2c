/* Arrays, and operations on whole arrays.

   Results have the same bits on all processors: multiplications and additions are not fused, and
   sums of products are accumulated in `LANES` partial sums. Vectors are therefore explicit, and the
   compiler must not vectorize by itself: gcc fuses the operations of complex products if it does. */

#ifndef BEAMDAE_ARRAYS_H
#define BEAMDAE_ARRAYS_H

#include <complex.h>
#include <math.h>
#include <stdint.h>

/* Entries of a vector; arrays of lanes hold the first entry of all lanes, then the second one. */
#define LANES 8

typedef struct { double *at; int64_t size; } Reals;
typedef struct { double *at; int64_t rows, columns; } Reals2;
typedef struct { double *at; int64_t n0, n1, n2; } Reals3;
typedef struct { double _Complex *at; int64_t size; } Complexes;
typedef struct { uint32_t *at; int64_t size; } Indices;
typedef struct { uint32_t *at; int64_t rows, columns; } Indices2;
typedef struct { int64_t *at; int64_t size; } Integers;
typedef struct { int64_t *at; int64_t rows, columns; } Integers2;
typedef struct { int32_t *at; int64_t size; } Shorts;

/* One number per lane, in as many registers as the processor requires. For the fields of a vector,
   FIELDS(DO) expands to DO(field, first lane). */
#if defined(__AVX512F__)
#define WIDTH 8
#define FIELDS(DO) DO(a, 0)
#elif defined(__AVX__)
#define WIDTH 4
#define FIELDS(DO) DO(a, 0) DO(b, 4)
#else
#define WIDTH 2
#define FIELDS(DO) DO(a, 0) DO(b, 2) DO(c, 4) DO(d, 6)
#endif
typedef double Register __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
typedef int64_t Mask __attribute__((vector_size(8 * WIDTH)));
typedef struct {
#define DECLARE(field, first) Register field;
    FIELDS(DECLARE)
} Vector;

/* Initializer of a register with the values x(lane). */
#if WIDTH == 8
#define NUMBERS(x) {x(0), x(1), x(2), x(3), x(4), x(5), x(6), x(7)}
#elif WIDTH == 4
#define NUMBERS(x) {x(0), x(1), x(2), x(3)}
#else
#define NUMBERS(x) {x(0), x(1)}
#endif

#define DEFINE(name, arguments, value)                                                             \
    static inline Vector name arguments {                                                          \
        Vector z;                                                                                  \
        FIELDS(value)                                                                              \
        return z;                                                                                  \
    }
#define PLUS(f, first) z.f = x.f + y.f;
#define MINUS(f, first) z.f = x.f - y.f;
#define TIMES(f, first) z.f = x.f * y.f;
#define SCALE(f, first) z.f = number * x.f;
#define INVERT(f, first) z.f = 1.0 / x.f;
#define NEGATE(f, first) z.f = -x.f;
#define BROADCAST(f, first) z.f = number - (Register){0.0};
DEFINE(plus, (Vector x, Vector y), PLUS)
DEFINE(minus, (Vector x, Vector y), MINUS)
DEFINE(times, (Vector x, Vector y), TIMES)
DEFINE(scaled, (double number, Vector x), SCALE)
DEFINE(inverse, (Vector x), INVERT)
DEFINE(negative, (Vector x), NEGATE)
DEFINE(broadcast, (double number), BROADCAST)

/* Set the entries of `out` to a value in terms of AT(x), for registers and for the last entries. */
#define AT(x) (*(const Entry *)((x).at + i))
#define SET(out, value)                                                                            \
    do {                                                                                           \
        int64_t i = 0;                                                                             \
        for (; i + WIDTH <= (out).size; i += WIDTH) {                                              \
            typedef Register Entry;                                                                  \
            *(Entry *)((out).at + i) = value;                                                      \
        }                                                                                          \
        for (; i < (out).size; i++) {                                                              \
            typedef double Entry;                                                                  \
            *(Entry *)((out).at + i) = value;                                                      \
        }                                                                                          \
    } while (0)

static inline Reals part(Reals x, int64_t begin, int64_t end) {
    return (Reals){x.at + begin, end - begin};
}

static inline Reals from(Reals x, int64_t begin) { return part(x, begin, x.size); }

static inline Reals row(Reals2 x, int64_t i) { return (Reals){x.at + i * x.columns, x.columns}; }

/* Consecutive rows. */
static inline Reals2 rows_of(Reals2 x, int64_t first, int64_t count) {
    return (Reals2){x.at + first * x.columns, count, x.columns};
}

static inline Reals flat(Reals2 x) { return (Reals){x.at, x.rows * x.columns}; }

static inline Reals2 slice(Reals3 x, int64_t i) {
    return (Reals2){x.at + i * x.n1 * x.n2, x.n1, x.n2};
}

static inline double largest_of(double a, double b) { return b > a ? b : a; }
static inline double smallest_of(double a, double b) { return b < a ? b : a; }

static inline void fill(Reals out, double value) { SET(out, value - (Entry){0}); }

/* Set `out`, which may be one of the vectors, to the sum of factors times vectors. */
static inline void copy(Reals out, Reals x) { SET(out, AT(x)); }

static inline void scale(Reals out, double a, Reals x) { SET(out, a * AT(x)); }

static inline void combine2(Reals out, double a, Reals x, double b, Reals y) {
    SET(out, a * AT(x) + b * AT(y));
}

static inline void combine3(Reals out, double a, Reals x, double b, Reals y, double c, Reals z) {
    SET(out, a * AT(x) + b * AT(y) + c * AT(z));
}

static inline void combine4(Reals out, double a, Reals x, double b, Reals y, double c, Reals z,
                            double d, Reals w) {
    SET(out, a * AT(x) + b * AT(y) + c * AT(z) + d * AT(w));
}

static inline void add_to(Reals out, double a, Reals x) { combine2(out, 1.0, out, a, x); }

static inline void multiply(Reals out, Reals x, Reals y) { SET(out, AT(x) * AT(y)); }

/* Set `out` to the smaller of x and a * y, entry by entry; NaN is kept. */
static inline void minimum(Reals out, Reals x, double a, Reals y) {
    for (int64_t i = 0; i < out.size; i++) {
        const double value = x.at[i], limit = a * y.at[i];
        out.at[i] = value < limit || value != value ? value : limit;
    }
}

static inline double sum_lanes(double total, Vector x) {
#define ADD_LANES(f, first) for (int k = 0; k < WIDTH; k++) total += x.f[k];
    FIELDS(ADD_LANES)
    return total;
}

/* Entries from i on as a vector. */
static inline Vector load(Reals x, int64_t i) { return *(const Vector *)(x.at + i); }

static inline double inner_product(Reals x, Reals y) {
    Vector lanes = broadcast(0.0);
    double total = 0.0;
    int64_t i = 0;
    for (; i + LANES <= x.size; i += LANES) lanes = plus(lanes, times(load(x, i), load(y, i)));
    for (; i < x.size; i++) total += x.at[i] * y.at[i];
    return sum_lanes(total, lanes);
}

/* Square root of the sum of squares of weighted entries. */
static inline double euclidean_norm(Reals x, Reals weights) {
    Vector lanes = broadcast(0.0);
    double total = 0.0;
    int64_t i = 0;
    for (; i + LANES <= x.size; i += LANES) {
        const Vector value = times(load(x, i), load(weights, i));
        lanes = plus(lanes, times(value, value));
    }
    for (; i < x.size; i++) {
        const double value = x.at[i] * weights.at[i];
        total += value * value;
    }
    return sqrt(sum_lanes(total, lanes));
}

/* Entries of x where the mask is set, else of y. */
static inline Register choose(Mask mask, Register x, Register y) {
    return (Register)((mask & (Mask)x) | (~mask & (Mask)y));
}

#ifndef CMPLX
#define CMPLX(x, y) __builtin_complex((double)(x), (double)(y))
#endif

/* Without the treatment of infinite factors that the standard requires of `*`. */
static inline double _Complex multiply_complex(double _Complex x, double _Complex y) {
    const double a = creal(x), b = cimag(x), c = creal(y), d = cimag(y);
    return CMPLX(a * c - b * d, a * d + b * c);
}

/* The larger of two sizes; NaN is kept. */
static inline double join_largest(double total, double size) {
    return size > total || size != size ? size : total;
}

/* Largest magnitude of weighted entries; NaN if one of them is NaN. */
static inline double max_norm(Reals x, Reals weights) {
    Vector lanes = broadcast(0.0);
    double total = 0.0;
    int64_t i = 0;
    for (; i + LANES <= x.size; i += LANES) {
        const Vector value = times(load(x, i), load(weights, i));
#define JOIN(f, first)                                                                             \
    const Register f = choose(value.f < -value.f, -value.f, value.f);                              \
    lanes.f = choose((f > lanes.f) | (f != f), f, lanes.f);
        FIELDS(JOIN)
    }
    for (; i < x.size; i++) total = join_largest(total, fabs(x.at[i] * weights.at[i]));
#define JOIN_LANES(f, first) for (int k = 0; k < WIDTH; k++) total = join_largest(total, lanes.f[k]);
    FIELDS(JOIN_LANES)
    return total;
}

static inline int64_t locate_largest(Reals x, Reals weights) {
    int64_t at = 0;
    double largest = -1.0;
    for (int64_t i = 0; i < x.size; i++) {
        const double size = fabs(x.at[i] * weights.at[i]);
        if (size > largest)
            at = i, largest = size;
        else if (size != size)
            return i;
    }
    return at;
}

/* Entries of tables: out[at] = vector[of], for entries begin:end of `at` and `of`. */
#define PICK(out, targets, vector, of, begin, end)                                                 \
    for (int64_t k_ = (begin); k_ < (end); k_++) (out)[(targets)[k_]] = (vector)[(of)[k_]]
#define ADD(out, targets, vector, of, begin, end)                                                  \
    for (int64_t k_ = (begin); k_ < (end); k_++) (out)[(targets)[k_]] += (vector)[(of)[k_]]
#define ADD_WEIGHTED(out, targets, weights, vector, of, begin, end)                                \
    for (int64_t k_ = (begin); k_ < (end); k_++)                                                   \
        (out)[(targets)[k_]] += (weights)[k_] * (vector)[(of)[k_]]
/* As ADD_WEIGHTED, after setting the entries of `out` to zero. */
#define GATHER(out, targets, weights, vector, of, begin, end)                                      \
    do {                                                                                           \
        for (int64_t k_ = (begin); k_ < (end); k_++) (out)[(targets)[k_]] = 0.0;                   \
        ADD_WEIGHTED(out, targets, weights, vector, of, begin, end);                               \
    } while (0)

#endif
