/* Factorization and solution of sparse systems with known pivots and fill, for one type of numbers.

   linear.c includes this file for real and for complex numbers, with the macros

   NUMBER, ARRAY, LANE   a number, an array of numbers, and one entry of all lanes;
   NAME(x)               name of a function for this type.

   The matrix is eliminated column by column from the left with the pivots of an `EliminationPlan`
   (see linear/elimination.py), as in the refactorization of KLU (Davis & Palamadai Natarajan, ACM
   Trans. Math. Softw. 37 (2010) 36). Blocks of unknowns are eliminated first, one per lane. */

/* Factorize one block per lane without pivoting, and add its contribution to `corner`. The factors
   replace columns of the interior unknowns, then interior rows of the neighbors; pivots are
   inverted. */
static void NAME(eliminate_interior)(LANE *restrict blocks, int64_t interior, int64_t neighbors,
                                     LANE *restrict corner) {
    const int64_t size = interior + neighbors;
    for (int64_t j = 0; j < interior; j++) {
        LANE *x = blocks + j * size;
        for (int64_t k = 0; k < j; k++)
            for (int64_t i = k + 1; i < interior; i++)
                x[i] = NAME(subtract_product)(x[i], blocks[k * size + i], x[k]);
        for (int64_t i = interior; i < size; i++) {
            LANE sum = x[i];
            for (int64_t k = 0; k < j; k++)
                sum = NAME(subtract_product)(sum, blocks[k * size + i], x[k]);
            x[i] = sum;
        }
        x[j] = NAME(invert_lane)(x[j]);
        for (int64_t i = j + 1; i < size; i++) x[i] = NAME(times)(x[i], x[j]);
    }
    for (int64_t j = 0; j < neighbors; j++) {
        LANE *x = blocks + interior * size + j * interior, *y = corner + j * neighbors;
        for (int64_t k = 0; k < interior; k++)
            for (int64_t i = k + 1; i < interior; i++)
                x[i] = NAME(subtract_product)(x[i], blocks[k * size + i], x[k]);
        for (int64_t i = 0; i < neighbors; i++) {
            LANE sum = y[i];
            for (int64_t k = 0; k < interior; k++)
                sum = NAME(subtract_product)(sum, blocks[k * size + interior + i], x[k]);
            y[i] = sum;
        }
    }
}

/* Factorize the blocks, and subtract their contributions from `entries`. */
static void NAME(eliminate_blocks)(const EliminationPlan *plan, const NAME(Factors) *factors) {
    NUMBER *entries = factors->entries.at;
    LANE *corner = (LANE *)factors->corner.at;
    for (int64_t k = 0; k < plan->batches.rows; k++) {
        const Batch *batch = (const Batch *)plan->batches.at + k;
        const int64_t interior = batch->interior, neighbors = batch->neighbors;
        const uint32_t *at = plan->block_entries.at + LANES * batch->first_entry;
        LANE *blocks = (LANE *)factors->blocks.at + batch->first_entry;
        const int64_t count = interior * (interior + 2 * neighbors);
        for (int64_t i = 0; i < count; i++) blocks[i] = NAME(gather)(entries, at + LANES * i);
        memset(corner, 0, neighbors * neighbors * sizeof(LANE));
        NAME(eliminate_interior)(blocks, interior, neighbors, corner);
        at = plan->corner_entries.at + LANES * batch->first_corner;
        for (int64_t i = 0; i < neighbors * neighbors; i++)
            NAME(add_lanes)(entries, at + LANES * i, corner[i]);
    }
}

/* Eliminate the interior unknowns of a batch of blocks from a right-hand side: a constant number of
   `interior` unknowns stays in registers. */
static inline __attribute__((always_inline)) void NAME(forward_batch)(
    NUMBER *right, const uint32_t *at, LANE *block_x, const LANE *blocks, int64_t interior,
    int64_t neighbors, int64_t shared, LANE *x) {
    const int64_t size = interior + neighbors, separate = neighbors - shared;
    for (int64_t i = 0; i < interior; i++) x[i] = NAME(gather)(right, at + LANES * i);
    for (int64_t k = 0; k < interior; k++)
        for (int64_t i = k + 1; i < interior; i++)
            x[i] = NAME(subtract_product)(x[i], blocks[k * size + i], x[k]);
    for (int64_t i = 0; i < interior; i++) block_x[i] = x[i];
    for (int64_t i = 0; i < neighbors; i++) {
        LANE sum = NAME(broadcast)(0.0);
        for (int64_t k = 0; k < interior; k++)
            sum = NAME(subtract_product)(sum, blocks[k * size + interior + i], x[k]);
        const uint32_t *target = at + LANES * (interior + i);
        if (i < separate)
            NAME(add_lanes)(right, target, sum);
        else
            right[target[0]] += NAME(sum_halves)(sum);
    }
}

/* Replace the interior entries of `right` by the solution, given that of the neighbors. */
static inline __attribute__((always_inline)) void NAME(backward_batch)(
    NUMBER *right, const uint32_t *at, const LANE *block_x, const LANE *blocks, int64_t interior,
    int64_t neighbors, int64_t shared, LANE *x) {
    const int64_t size = interior + neighbors, separate = neighbors - shared;
    const LANE *upper = blocks + interior * size;
    for (int64_t i = 0; i < interior; i++) x[i] = block_x[i];
    for (int64_t j = 0; j < neighbors; j++) {
        const uint32_t *source = at + LANES * (interior + j);
        const LANE factor =
            j < separate ? NAME(gather)(right, source) : NAME(broadcast)(right[source[0]]);
        for (int64_t i = 0; i < interior; i++)
            x[i] = NAME(subtract_product)(x[i], upper[j * interior + i], factor);
    }
    for (int64_t k = interior - 1; k >= 0; k--) {
        x[k] = NAME(times)(x[k], blocks[k * size + k]);
        for (int64_t i = 0; i < k; i++)
            x[i] = NAME(subtract_product)(x[i], blocks[k * size + i], x[k]);
    }
    for (int64_t i = 0; i < interior; i++) NAME(scatter)(right, at + LANES * i, x[i]);
}

#define SUBSTITUTE(function, k)                                                                    \
    do {                                                                                           \
        const Batch *b = (const Batch *)plan->batches.at + (k);                                    \
        const uint32_t *at = plan->block_unknowns.at + LANES * b->first_unknown;                   \
        LANE x[MAX_INTERIOR], *block_x = (LANE *)factors->block_x.at + b->first_unknown;           \
        const LANE *blocks = (const LANE *)factors->blocks.at + b->first_entry;                    \
        if (b->interior == 6)                                                                      \
            function(right, at, block_x, blocks, 6, b->neighbors, b->shared, x);                   \
        else if (b->interior == 3)                                                                 \
            function(right, at, block_x, blocks, 3, b->neighbors, b->shared, x);                   \
        else                                                                                       \
            function(right, at, block_x, blocks, b->interior, b->neighbors, b->shared, x);         \
    } while (0)

/* Single unknowns */

/* Factorize the columns outside blocks; return 0 if a pivot or its reciprocal is not finite. */
static int NAME(eliminate_columns)(const EliminationPlan *plan, const NAME(Factors) *factors) {
    const uint32_t *starts = plan->starts.at, *positions = plan->positions.at;
    const uint32_t *upper_starts = plan->upper_starts.at, *upper_rows = plan->upper_rows.at;
    const uint32_t *lower_starts = plan->lower_starts.at, *lower_rows = plan->lower_rows.at;
    NUMBER *restrict x = factors->x.at, *restrict lower = factors->lower.at;
    const int64_t size = factors->x.size;
    for (int64_t j = 0; j < size; j++) x[j] = 0.0;
    for (int64_t j = 0; j < size; j++) {
        for (uint32_t e = starts[j]; e < starts[j + 1]; e++)
            x[positions[e]] = factors->entries.at[plan->sources.at[e]];
        for (uint32_t p = upper_starts[j]; p < upper_starts[j + 1]; p++) {
            const uint32_t k = upper_rows[p];
            const NUMBER factor = x[k];
            x[k] = 0.0;
            factors->upper.at[p] = factor;
            for (uint32_t q = lower_starts[k]; q < lower_starts[k + 1]; q++)
                x[lower_rows[q]] -= NAME(product)(lower[q], factor);
        }
        const NUMBER pivot = x[j];
        if (pivot == 0.0) return 0;
        const NUMBER inverse = NAME(invert)(pivot);
        if (!NAME(is_finite)(pivot) || !NAME(is_finite)(inverse)) return 0;
        factors->inverse.at[j] = inverse;
        x[j] = 0.0;
        for (uint32_t q = lower_starts[j]; q < lower_starts[j + 1]; q++) {
            const uint32_t row = lower_rows[q];
            lower[q] = NAME(product)(x[row], inverse);
            x[row] = 0.0;
        }
    }
    return 1;
}

static void NAME(substitute_triangles)(const EliminationPlan *plan, const NAME(Factors) *factors) {
    const uint32_t *upper_starts = plan->upper_starts.at, *upper_rows = plan->upper_rows.at;
    const uint32_t *lower_starts = plan->lower_starts.at, *lower_rows = plan->lower_rows.at;
    const NUMBER *restrict lower = factors->lower.at, *restrict upper = factors->upper.at;
    NUMBER *restrict x = factors->x.at;
    const int64_t size = factors->x.size;
    for (int64_t k = 0; k < size; k++) {
        const NUMBER value = x[k];
        for (uint32_t q = lower_starts[k]; q < lower_starts[k + 1]; q++)
            x[lower_rows[q]] -= NAME(product)(lower[q], value);
    }
    for (int64_t k = size - 1; k >= 0; k--) {
        const NUMBER value = NAME(product)(x[k], factors->inverse.at[k]);
        x[k] = value;
        for (uint32_t p = upper_starts[k]; p < upper_starts[k + 1]; p++)
            x[upper_rows[p]] -= NAME(product)(upper[p], value);
    }
}

/* Replace the scaled right-hand side by the solution, without refinement. */
static void NAME(solve_scaled)(const EliminationPlan *plan, const NAME(Factors) *factors,
                               ARRAY array) {
    NUMBER *right = array.at, *x_rest = factors->x.at;
    const int64_t count = plan->batches.rows, size = factors->x.size;
    right[array.size - 1] = 0.0; /* Read and written by lanes without a block. */
    for (int64_t k = 0; k < count; k++) SUBSTITUTE(NAME(forward_batch), k);
    for (int64_t k = 0; k < size; k++) x_rest[k] = right[plan->rows.at[k]];
    NAME(substitute_triangles)(plan, factors);
    for (int64_t k = 0; k < size; k++) right[plan->columns.at[k]] = x_rest[k];
    for (int64_t k = count - 1; k >= 0; k--) SUBSTITUTE(NAME(backward_batch), k);
}

/* Set `residual` to right - matrix @ x, and `terms` to the sums of the magnitudes of all terms of
   each equation; return 1 if x is accurate. */
static int NAME(update_residual)(const EliminationPlan *plan, const NAME(Factors) *factors) {
    const uint32_t *starts = plan->matrix_starts.at, *rows = plan->matrix_rows.at;
    const NUMBER *restrict matrix = factors->matrix.at, *right = factors->right.at;
    NUMBER *restrict residual = factors->residual.at;
    double *restrict terms = factors->terms.at;
    const int64_t count = factors->terms.size;
    int is_solved = 1;
    for (int64_t k = 0; k < count; k++) {
        residual[k] = right[k];
        terms[k] = NAME(modulus)(right[k]);
    }
    for (int64_t j = 0; j < count; j++) {
        const NUMBER value = factors->solution.at[j];
        const double size = NAME(modulus)(value);
        for (uint32_t e = starts[j]; e < starts[j + 1]; e++) {
            residual[rows[e]] -= NAME(product)(matrix[e], value);
            terms[rows[e]] += NAME(modulus)(matrix[e]) * size;
        }
    }
    for (int64_t k = 0; k < count; k++) /* Not a number is not accurate. */
        is_solved &= NAME(modulus)(residual[k]) <= MAX_BACKWARD_ERROR * terms[k];
    return is_solved;
}

/* Set the number of refinements; return 0 if `MAX_REFINEMENTS` are not enough. The measure is the
   backward error of Oettli & Prager, relative to the terms of each equation, for a solution to
   which all columns contribute equally. */
static int NAME(find_refinements)(const EliminationPlan *plan, const NAME(Factors) *factors) {
    const uint32_t *starts = plan->matrix_starts.at, *rows = plan->matrix_rows.at;
    const NUMBER *matrix = factors->matrix.at;
    NUMBER *x = factors->solution.at, *right = factors->right.at;
    const int64_t size = plan->scale.size;
    for (int64_t i = 0; i < size; i++) x[i] = right[i] = 0.0;
    for (int64_t j = 0; j < size; j++) {
        double largest = 0.0;
        for (uint32_t e = starts[j]; e < starts[j + 1]; e++)
            largest = largest_of(largest, NAME(modulus)(matrix[e]));
        const double exact = 1.0 / largest;
        for (uint32_t e = starts[j]; e < starts[j + 1]; e++) right[rows[e]] += matrix[e] * exact;
    }
    for (int64_t i = 0; i < size; i++) factors->residual.at[i] = right[i];
    for (int64_t count = 0; count <= MAX_REFINEMENTS; count++) {
        NAME(solve_scaled)(plan, factors, factors->residual);
        for (int64_t i = 0; i < size; i++) x[i] += factors->residual.at[i];
        if (NAME(update_residual)(plan, factors)) {
            factors->refinements.at[0] = count;
            return 1;
        }
    }
    return 0;
}

/* Factorize the matrix; return 0 if the pivots are unsuitable. Each matrix is tested: a pivot may
   vanish at any step of a motion. */
static int NAME(refactorize)(const EliminationPlan *plan, const NAME(Factors) *factors,
                             const NUMBER *nonzeros) {
    NUMBER *matrix = factors->matrix.at, *entries = factors->entries.at;
    const int64_t count = factors->matrix.size, size = factors->entries.size;
    for (int64_t e = 0; e < count; e++)
        entries[e] = matrix[e] = plan->scale.at[plan->matrix_rows.at[e]] * nonzeros[e];
    for (int64_t e = count; e < size; e++) entries[e] = 0.0;
    entries[size - 2] = 1.0; /* The last entries are a zero, a one and one that is not used. */
    NAME(eliminate_blocks)(plan, factors);
    return NAME(eliminate_columns)(plan, factors) && NAME(find_refinements)(plan, factors);
}

/* Full matrices, for which no plan is suitable: n rows of `full`, followed by the rows of the pivots,
   which are found with partial pivoting and scaled rows. */

static uint32_t *NAME(pivot_rows)(const NAME(Solver) *linear) {
    return (uint32_t *)(linear->full.at + linear->full.size);
}

static int NAME(factorize_full)(NAME(Solver) *linear, const NUMBER *nonzeros) {
    const EliminationPlan *plan = &linear->plan;
    const int64_t n = plan->scale.size;
    NUMBER *full = linear->full.at;
    double *sizes = linear->factors.terms.at;
    uint32_t *rows = NAME(pivot_rows)(linear);
    memset(full, 0, n * n * sizeof(NUMBER));
    for (int64_t i = 0; i < n; i++) rows[i] = (uint32_t)i, sizes[i] = 0.0;
    for (int64_t j = 0; j < n; j++)
        for (uint32_t e = plan->matrix_starts.at[j]; e < plan->matrix_starts.at[j + 1]; e++) {
            const uint32_t i = plan->matrix_rows.at[e];
            full[i * n + j] = nonzeros[e];
            sizes[i] = largest_of(sizes[i], NAME(modulus)(nonzeros[e]));
        }
    for (int64_t k = 0; k < n; k++) {
        int64_t best = k;
        double largest = 0.0;
        for (int64_t i = k; i < n; i++) {
            const double size = NAME(modulus)(full[rows[i] * n + k]) / sizes[rows[i]];
            if (size > largest) best = i, largest = size;
        }
        if (!(largest > 0.0) || !isfinite(largest)) return SINGULAR;
        const uint32_t row = rows[best];
        rows[best] = rows[k], rows[k] = row;
        const NUMBER inverse = NAME(invert)(full[row * n + k]);
        for (int64_t i = k + 1; i < n; i++) {
            NUMBER *target = full + rows[i] * n;
            const NUMBER factor = target[k] = NAME(product)(target[k], inverse);
            if (factor == 0.0) continue;
            for (int64_t j = k + 1; j < n; j++)
                target[j] -= NAME(product)(factor, full[row * n + j]);
        }
    }
    return DONE;
}

static void NAME(solve_full)(const NAME(Solver) *linear, NUMBER *right) {
    const int64_t n = linear->plan.scale.size;
    const uint32_t *rows = NAME(pivot_rows)(linear);
    NUMBER *x = linear->factors.solution.at;
    for (int64_t i = 0; i < n; i++) {
        const NUMBER *row = linear->full.at + rows[i] * n;
        x[i] = right[rows[i]];
        for (int64_t j = 0; j < i; j++) x[i] -= NAME(product)(row[j], x[j]);
    }
    for (int64_t i = n - 1; i >= 0; i--) {
        const NUMBER *row = linear->full.at + rows[i] * n;
        for (int64_t j = i + 1; j < n; j++) x[i] -= NAME(product)(row[j], x[j]);
        right[i] = x[i] = NAME(product)(x[i], NAME(invert)(row[i]));
    }
}

int NAME(factorize)(NAME(Solver) *linear, ARRAY nonzeros) {
    if (linear->singular == 1) return SINGULAR;
    if (linear->full.size > 0) return NAME(factorize_full)(linear, nonzeros.at);
    if (linear->plan.rows.size == 0 ||
        !NAME(refactorize)(&linear->plan, &linear->factors, nonzeros.at)) {
        linear->needs_pivots = 1;
        return NEW_PIVOTS;
    }
    linear->factorizations++;
    linear->is_untried = 0;
    return DONE;
}

void NAME(solve)(NAME(Solver) *linear, ARRAY right) {
    const EliminationPlan *plan = &linear->plan;
    const NAME(Factors) *factors = &linear->factors;
    NUMBER *solution = factors->solution.at;
    const int64_t size = plan->scale.size;
    linear->solves++;
    if (linear->full.size > 0) {
        NAME(solve_full)(linear, right.at);
        return;
    }
    for (int64_t i = 0; i < size; i++) solution[i] = plan->scale.at[i] * right.at[i];
    if (factors->refinements.at[0] > 0)
        for (int64_t i = 0; i < size; i++) factors->right.at[i] = solution[i];
    NAME(solve_scaled)(plan, factors, factors->solution);
    for (int64_t count = factors->refinements.at[0]; count > 0; count--) {
        NAME(update_residual)(plan, factors);
        NAME(solve_scaled)(plan, factors, factors->residual);
        for (int64_t i = 0; i < size; i++) solution[i] += factors->residual.at[i];
    }
    for (int64_t i = 0; i < size; i++) right.at[i] = solution[i];
}

#undef SUBSTITUTE
