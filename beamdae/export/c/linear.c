/* Sparse linear equations: the same elimination for real and for complex numbers.

   Complex numbers are pairs, because not all C compilers know complex types. */

#include "linear.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Accuracy of solutions; see beamdae.linear.elimination. */
#define MAX_BACKWARD_ERROR 1e-10
#define MAX_REFINEMENTS 2

typedef double Real;
typedef struct {
    double re, im;
} Complex;

static Real add_real(Real a, Real b) { return a + b; }
static Real multiply_real(Real a, Real b) { return a * b; }
static Real subtract_product_real(Real a, Real b, Real c) { return a - b * c; }
static Real invert_real(Real a) { return 1.0 / a; }
static Real divide_real(Real a, Real b) { return a / b; }
static Real scale_real(Real a, double divisor) { return a / divisor; }
static double magnitude_real(Real a) { return fabs(a); }

static Complex add_complex(Complex a, Complex b) {
    const Complex sum = {a.re + b.re, a.im + b.im};
    return sum;
}
static Complex multiply_complex(Complex a, Complex b) {
    const Complex product = {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
    return product;
}
static Complex subtract_product_complex(Complex a, Complex b, Complex c) {
    const Complex result = {a.re - (b.re * c.re - b.im * c.im), a.im - (b.re * c.im + b.im * c.re)};
    return result;
}
/* Smith's formula: the squares of the parts may overflow. */
static Complex invert_complex(Complex a) {
    if (fabs(a.re) >= fabs(a.im)) {
        const double ratio = a.im / a.re, inverse = 1.0 / (a.re + a.im * ratio);
        const Complex result = {inverse, -ratio * inverse};
        return result;
    }
    const double ratio = a.re / a.im, inverse = 1.0 / (a.re * ratio + a.im);
    const Complex result = {ratio * inverse, -inverse};
    return result;
}
static Complex divide_complex(Complex a, Complex b) {
    return multiply_complex(a, invert_complex(b));
}
static Complex scale_complex(Complex a, double divisor) {
    const Complex result = {a.re / divisor, a.im / divisor};
    return result;
}
static double magnitude_complex(Complex a) { return fabs(a.re) + fabs(a.im); }

#define NUMBER Real
#define OF(function) function##_real
#include "elimination.h"
#undef NUMBER
#undef OF

#define NUMBER Complex
#define OF(function) function##_complex
#include "elimination.h"

int factorize(Factors *f) { return f->is_complex ? factorize_complex(f) : factorize_real(f); }

void solve(Factors *f, double *right) {
    if (f->is_complex)
        solve_complex(f, right);
    else
        solve_real(f, right);
}
