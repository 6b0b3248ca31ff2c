/* Elimination with the type NUMBER; linear.c includes this file for real and complex numbers. */

static int OF(eliminate)(Factors *f) {
    const Pattern *at = f->pattern;
    const NUMBER *nonzeros = (const NUMBER *)f->nonzeros;
    NUMBER *x = (NUMBER *)f->x, *upper = (NUMBER *)f->upper, *lower = (NUMBER *)f->lower;
    NUMBER *inverses = (NUMBER *)f->inverse;
    memset(x, 0, at->size * sizeof(NUMBER));
    for (Index j = 0; j < at->size; j++) {
        for (Index e = at->starts[j]; e < at->starts[j + 1]; e++)
            x[at->positions[e]] = nonzeros[at->sources[e]];
        for (Index p = at->upper_starts[j]; p < at->upper_starts[j + 1]; p++) {
            const Index k = at->upper_rows[p];
            const NUMBER factor = x[k];
            memset(&x[k], 0, sizeof(NUMBER));
            upper[p] = factor;
            for (Index q = at->lower_starts[k]; q < at->lower_starts[k + 1]; q++) {
                NUMBER *entry = &x[at->lower_rows[q]];
                *entry = OF(subtract_product)(*entry, lower[q], factor);
            }
        }
        const NUMBER inverse = OF(invert)(x[j]);
        const double size = OF(magnitude)(inverse);
        if (!isfinite(size) || size == 0.0) return 0;
        inverses[j] = inverse;
        memset(&x[j], 0, sizeof(NUMBER));
        for (Index q = at->lower_starts[j]; q < at->lower_starts[j + 1]; q++) {
            NUMBER *entry = &x[at->lower_rows[q]];
            lower[q] = OF(multiply)(*entry, inverse);
            memset(entry, 0, sizeof(NUMBER));
        }
    }
    return 1;
}

static void OF(substitute)(Factors *f, NUMBER *right) {
    const Pattern *at = f->pattern;
    const Index size = at->size;
    const NUMBER *upper = (const NUMBER *)f->upper, *lower = (const NUMBER *)f->lower;
    const NUMBER *inverses = (const NUMBER *)f->inverse;
    NUMBER *x = (NUMBER *)f->x;
    for (Index k = 0; k < size; k++) x[k] = right[at->order[k]];
    for (Index k = 0; k < size; k++) {
        const NUMBER value = x[k];
        for (Index q = at->lower_starts[k]; q < at->lower_starts[k + 1]; q++) {
            NUMBER *entry = &x[at->lower_rows[q]];
            *entry = OF(subtract_product)(*entry, lower[q], value);
        }
    }
    for (Index k = size; k-- > 0;) {
        const NUMBER value = OF(multiply)(x[k], inverses[k]);
        x[k] = value;
        for (Index p = at->upper_starts[k]; p < at->upper_starts[k + 1]; p++) {
            NUMBER *entry = &x[at->upper_rows[p]];
            *entry = OF(subtract_product)(*entry, upper[p], value);
        }
    }
    for (Index k = 0; k < size; k++) right[at->order[k]] = x[k];
}

/* Elimination of the full matrix with partial pivoting and scaled rows. */
static int OF(eliminate_dense)(Factors *f) {
    const Pattern *at = f->pattern;
    const size_t size = at->size;
    const NUMBER *nonzeros = (const NUMBER *)f->nonzeros;
    if (!f->dense) f->dense = malloc(size * size * sizeof(NUMBER));
    if (!f->pivots) f->pivots = malloc(size * sizeof(Index));
    if (!f->dense || !f->pivots) return 0;
    NUMBER *a = (NUMBER *)f->dense;
    double *scale = f->terms;
    memset(a, 0, size * size * sizeof(NUMBER));
    for (size_t j = 0; j < size; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            a[at->matrix_rows[e] * size + j] = nonzeros[e];
    for (size_t i = 0; i < size; i++) {
        scale[i] = 0.0;
        for (size_t j = 0; j < size; j++)
            scale[i] = fmax(scale[i], OF(magnitude)(a[i * size + j]));
        scale[i] = 1.0 / scale[i];
        if (!isfinite(scale[i]) || scale[i] == 0.0) return 0;
    }
    for (size_t k = 0; k < size; k++) {
        size_t best = k;
        double largest = OF(magnitude)(a[k * size + k]) * scale[k];
        for (size_t i = k + 1; i < size; i++) {
            const double candidate = OF(magnitude)(a[i * size + k]) * scale[i];
            if (candidate > largest) best = i, largest = candidate;
        }
        f->pivots[k] = (Index)best;
        if (best != k) {
            for (size_t j = 0; j < size; j++) {
                const NUMBER swap = a[k * size + j];
                a[k * size + j] = a[best * size + j];
                a[best * size + j] = swap;
            }
            scale[best] = scale[k];
        }
        const NUMBER inverse = OF(invert)(a[k * size + k]);
        const double magnitude = OF(magnitude)(inverse);
        if (!isfinite(magnitude) || magnitude == 0.0) return 0;
        for (size_t i = k + 1; i < size; i++) {
            const NUMBER factor = OF(multiply)(a[i * size + k], inverse);
            a[i * size + k] = factor;
            if (OF(magnitude)(factor) == 0.0) continue;
            for (size_t j = k + 1; j < size; j++)
                a[i * size + j] = OF(subtract_product)(a[i * size + j], factor, a[k * size + j]);
        }
    }
    return 1;
}

static void OF(substitute_dense)(Factors *f, NUMBER *right) {
    const size_t size = f->pattern->size;
    const NUMBER *a = (const NUMBER *)f->dense;
    for (size_t k = 0; k < size; k++) {
        const NUMBER swap = right[k];
        right[k] = right[f->pivots[k]];
        right[f->pivots[k]] = swap;
    }
    for (size_t i = 1; i < size; i++)
        for (size_t j = 0; j < i; j++)
            right[i] = OF(subtract_product)(right[i], a[i * size + j], right[j]);
    for (size_t i = size; i-- > 0;) {
        for (size_t j = i + 1; j < size; j++)
            right[i] = OF(subtract_product)(right[i], a[i * size + j], right[j]);
        right[i] = OF(divide)(right[i], a[i * size + i]);
    }
}

static void OF(substitute_any)(Factors *f, NUMBER *right) {
    if (f->is_dense)
        OF(substitute_dense)(f, right);
    else
        OF(substitute)(f, right);
}

/* Set `residual` to right - matrix x; return 1 if x is accurate (Oettli & Prager). */
static int OF(update_residual)(Factors *f, const NUMBER *x, const NUMBER *right) {
    const Pattern *at = f->pattern;
    const NUMBER *nonzeros = (const NUMBER *)f->nonzeros;
    NUMBER *residual = (NUMBER *)f->residual;
    for (Index i = 0; i < at->size; i++) {
        residual[i] = right[i];
        f->terms[i] = OF(magnitude)(right[i]);
    }
    for (Index j = 0; j < at->size; j++)
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++) {
            const Index i = at->matrix_rows[e];
            residual[i] = OF(subtract_product)(residual[i], nonzeros[e], x[j]);
            f->terms[i] += OF(magnitude)(OF(multiply)(nonzeros[e], x[j]));
        }
    int is_accurate = 1;
    for (Index i = 0; i < at->size; i++)
        is_accurate &= OF(magnitude)(residual[i]) <= MAX_BACKWARD_ERROR * f->terms[i];
    return is_accurate;
}

/* Set the number of refinements for a solution to which all columns contribute equally. */
static int OF(set_refinements)(Factors *f) {
    const Pattern *at = f->pattern;
    const NUMBER *nonzeros = (const NUMBER *)f->nonzeros;
    NUMBER *x = (NUMBER *)f->solution, *right = (NUMBER *)f->right;
    NUMBER *residual = (NUMBER *)f->residual;
    memset(x, 0, at->size * sizeof(NUMBER));
    memset(right, 0, at->size * sizeof(NUMBER));
    for (Index j = 0; j < at->size; j++) {
        double largest = 0.0;
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++)
            largest = fmax(largest, OF(magnitude)(nonzeros[e]));
        for (Index e = at->matrix_starts[j]; e < at->matrix_starts[j + 1]; e++) {
            NUMBER *entry = &right[at->matrix_rows[e]];
            *entry = OF(add)(*entry, OF(scale)(nonzeros[e], largest));
        }
    }
    memcpy(residual, right, at->size * sizeof(NUMBER));
    for (f->refinements = 0; f->refinements <= MAX_REFINEMENTS; f->refinements++) {
        OF(substitute_any)(f, residual);
        for (Index i = 0; i < at->size; i++) x[i] = OF(add)(x[i], residual[i]);
        if (OF(update_residual)(f, x, right)) return 1;
    }
    return 0;
}

static int OF(factorize)(Factors *f) {
    f->is_dense = 0;
    if (OF(eliminate)(f) && OF(set_refinements)(f)) return 1;
    f->pivot_searches++;
    f->is_dense = 1;
    return OF(eliminate_dense)(f) && OF(set_refinements)(f);
}

static void OF(solve)(Factors *f, double *numbers) {
    const Index size = f->pattern->size;
    NUMBER *right = (NUMBER *)numbers, *residual = (NUMBER *)f->residual;
    if (f->refinements > 0) memcpy(f->right, right, size * sizeof(NUMBER));
    OF(substitute_any)(f, right);
    for (int k = 0; k < f->refinements; k++) {
        OF(update_residual)(f, right, (NUMBER *)f->right);
        OF(substitute_any)(f, residual);
        for (Index i = 0; i < size; i++) right[i] = OF(add)(right[i], residual[i]);
    }
}
