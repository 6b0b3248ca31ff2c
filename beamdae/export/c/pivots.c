/* Elimination of full matrices with row exchanges, as plans for the solvers of the core. */

#include "pivots.h"

#include <stdlib.h>
#include <string.h>

typedef double _Complex Complex;

static void eliminate(Complex *target, const Complex *pivot_row, int64_t k, int64_t n) {
    const Complex factor = target[k] / pivot_row[k];
    if (factor == 0.0) return;
    for (int64_t j = k; j < n; j++) target[j] -= multiply_complex(factor, pivot_row[j]);
}

/* Write the rows of the pivots, found with partial pivoting and scaled rows; the entries of the
   full matrix are lost. Return 0 if it is singular. */
static int find_pivots(Complex *entries, double *scale, int64_t n, uint32_t *rows) {
    for (int64_t i = 0; i < n; i++) {
        double largest = 0.0;
        for (int64_t j = 0; j < n; j++) largest = fmax(largest, cabs(entries[i * n + j]));
        scale[i] = 1.0 / largest;
        rows[i] = (uint32_t)i;
    }
    for (int64_t k = 0; k < n; k++) {
        int64_t best = k;
        double largest = 0.0;
        for (int64_t i = k; i < n; i++) {
            const double size = cabs(entries[rows[i] * n + k]) * scale[rows[i]];
            if (size > largest) best = i, largest = size;
        }
        if (!(largest > 0.0) || !isfinite(largest)) return 0;
        const uint32_t row = rows[best];
        rows[best] = rows[k], rows[k] = row;
        for (int64_t i = k + 1; i < n; i++)
            eliminate(entries + rows[i] * n, entries + row * n, k, n);
    }
    return 1;
}

static int find_rows(const EliminationPlan *plan, const void *nonzeros, int is_complex,
                     uint32_t *rows) {
    const int64_t n = plan->scale.size;
    Complex *entries = calloc(n * n, sizeof(Complex));
    double *scale = malloc(n * sizeof(double));
    int is_regular = entries && scale;
    for (int64_t j = 0; j < n && is_regular; j++)
        for (uint32_t e = plan->matrix_starts.at[j]; e < plan->matrix_starts.at[j + 1]; e++)
            entries[plan->matrix_rows.at[e] * n + j] =
                is_complex ? ((const Complex *)nonzeros)[e] : ((const double *)nonzeros)[e];
    if (is_regular) is_regular = find_pivots(entries, scale, n, rows);
    free(entries);
    free(scale);
    return is_regular;
}

/* Set the pattern of a full matrix with these rows of pivots, in columns from the left. */
static void plan_full(EliminationPlan *plan, uint32_t *numbers) {
    const uint32_t n = (uint32_t)plan->scale.size, nnz = plan->matrix_starts.at[n];
    const int64_t count = (int64_t)n * (n - 1) / 2;
    Indices *const fields[] = {&plan->rows,       &plan->columns,      &plan->positions,
                               &plan->sources,    &plan->upper_starts, &plan->lower_starts,
                               &plan->upper_rows, &plan->lower_rows};
    const int64_t sizes[] = {n, n, nnz, nnz, n + 1, n + 1, count, count};
    for (int k = 0; k < 8; k++) {
        *fields[k] = (Indices){numbers, sizes[k]};
        numbers += sizes[k];
    }
    plan->starts = plan->matrix_starts;
    uint32_t *upper = plan->upper_rows.at, *lower = plan->lower_rows.at;
    for (uint32_t j = 0; j <= n; j++) {
        plan->upper_starts.at[j] = (uint32_t)(upper - plan->upper_rows.at);
        plan->lower_starts.at[j] = (uint32_t)(lower - plan->lower_rows.at);
        if (j == n) break;
        plan->columns.at[j] = j;
        for (uint32_t i = 0; i < n; i++)
            if (i < j)
                *upper++ = i;
            else if (i > j)
                *lower++ = i;
        for (uint32_t e = 0; e < nnz; e++)
            if (plan->matrix_rows.at[e] == plan->rows.at[j]) plan->positions.at[e] = j;
    }
    for (uint32_t e = 0; e < nnz; e++) plan->sources.at[e] = e;
}

/* Let the solver eliminate the full matrix; return 0 if it is singular or memory is missing. */
static int use_full_matrix(Exchange *exchange, LinearSolver *linear, const void *nonzeros,
                           int is_complex) {
    const int64_t n = linear->plan.scale.size, nnz = linear->plan.matrix_rows.size;
    const int64_t count = n * (n - 1) / 2, width = is_complex ? 2 : 1;
    const int64_t n_indices = 2 * (n + nnz + n + 1 + count);
    double *numbers = malloc(2 * width * count * sizeof(double) + n_indices * sizeof(uint32_t));
    if (!numbers) return 0;
    free(exchange->memory);
    exchange->memory = numbers;
    uint32_t *indices = (uint32_t *)(numbers + 2 * width * count);
    if (!find_rows(&linear->plan, nonzeros, is_complex, indices)) return 0;
    plan_full(&linear->plan, indices);
    linear->factors.upper = (Reals){numbers, count};
    linear->factors.lower = (Reals){numbers + width * count, count};
    return 1;
}

/* The tables of real and complex solvers differ in the types of addresses only, so that they are
   copied byte by byte. */
void exchange_rows(Exchange *exchange, void *solver, const void *nonzeros, int is_complex) {
    LinearSolver linear;
    memcpy(&linear, solver, sizeof(linear));
    if (!exchange->solver) exchange->before = linear;
    exchange->solver = solver;
    linear.plan = exchange->before.plan;
    linear.factors = exchange->before.factors;
    linear.needs_pivots = 0;
    linear.is_untried =
        !linear.is_untried && use_full_matrix(exchange, &linear, nonzeros, is_complex);
    linear.singular = !linear.is_untried;
    memcpy(solver, &linear, sizeof(linear));
}

int release_pivots(Exchange *exchange) {
    LinearSolver linear;
    if (!exchange->solver) return 0;
    memcpy(&linear, exchange->solver, sizeof(linear));
    linear.plan = exchange->before.plan;
    linear.factors = exchange->before.factors;
    linear.is_untried = linear.singular = 0;
    memcpy(exchange->solver, &linear, sizeof(linear));
    free(exchange->memory);
    *exchange = (Exchange){0};
    return 1;
}
