/* Derivatives of the steps of a run, forward and backward; see
   analysis/sensitivities/linear_steps.py. */

#include "core.h"

/* Write a state to the inputs, with multipliers times a factor. */
static void set_state(LinearSteps *run, int64_t k, double factor) {
    const int64_t n = run->n, a = run->acceleration_at, lam = a + n;
    const Reals state = row(run->states, k);
    copy(part(run->inputs, 0, 2 * n), state);
    copy(part(run->inputs, a, a + n), from(state, 2 * n));
    scale(part(run->inputs, lam, lam + state.size - 3 * n), factor, from(state, 3 * n));
}

static double stage_time(const LinearSteps *run, int64_t i) {
    const double start = run->times.at[run->step], end = run->times.at[run->step + 1];
    return i == run->nodes.size - 1 ? end : start + run->nodes.at[i] * (end - start);
}

/* Factorize M, or its transpose, of the current step. */
static int factorize_step(LinearSteps *run) {
    const int64_t s = run->nodes.size, size = run->block.size, k = run->step;
    const double *c = row(run->tables.factors, k).at;
    const Reals block = run->block;
    for (int64_t i = 0; i < s; i++) {
        set_state(run, s * k + 1 + i, c[6]);
        set_time(&run->matrix, stage_time(run, i), run->branch);
        set_matrix_factors(&run->matrix, c[0], c[1], c[2], c[3], c[4], c[5]);
        evaluate_sum(&run->matrix, run->inputs, run->parts);
        for (int64_t j = 0; j < s; j++) {
            const Reals shares = row(slice(run->tables.blocks, k), s * i + j);
            scale(block, shares.at[0], run->parts);
            for (int64_t part = 1; part < shares.size; part++)
                add_to(block, shares.at[part], from(run->parts, part * size));
            const uint32_t *targets = run->targets.at + (s * i + j) * run->targets.columns;
            PICK(run->nonzeros.at, targets, block.at, run->entries.at, 0, size);
        }
    }
    return factorize(&run->linear, run->nonzeros);
}

/* Add a matrix, or its transpose, times rows to the rows of `out`. */
static void add_product(Reals2 out, Reals2 matrix, int transposed, Reals2 x) {
    for (int64_t i = 0; i < matrix.rows; i++)
        for (int64_t j = 0; j < matrix.columns; j++) {
            const double entry = matrix.at[i * matrix.columns + j];
            if (entry != 0.0)
                add_to(row(out, transposed ? j : i), entry, row(x, transposed ? i : j));
        }
}

/* Predict the stages along direction k, and set its right-hand side. */
static void predict_direction(LinearSteps *run, int64_t k) {
    const int64_t n = run->n, s = run->nodes.size, step = run->step, unknowns = run->rows.size;
    const Reals2 after = rows_of(run->after, k * (3 * s + 1), 3 * s + 1);
    fill(flat(after), 0.0);
    add_product(after, slice(run->tables.by_motion, step), 0, rows_of(run->motion, 4 * k, 4));
    for (int64_t i = 0; i < s; i++) {
        set_state(run, s * step + 1 + i, 1.0);
        copy(part(run->inputs, run->n_inputs, run->n_inputs + 2 * n),
             flat(rows_of(after, 3 * i, 2)));
        set_time(&run->change, stage_time(run, i), run->branch);
        evaluate_with_data(&run->change, row(run->data, k), run->inputs, run->result);
        if (run->shifts.at[k] != 0.0)
            add_to(run->result, run->shifts.at[k], row(run->time_rates, s * step + i));
        const Reals right = part(row(run->right, k), i * unknowns, (i + 1) * unknowns);
        for (int64_t e = 0; e < unknowns; e++)
            right.at[e] = run->scales.at[e] * run->result.at[run->rows.at[e]];
    }
}

/* Correct the stages along direction k by the solution of its equations. */
static void correct_direction(LinearSteps *run, int64_t k) {
    const int64_t n = run->n, s = run->nodes.size, step = run->step;
    const int64_t unknowns = run->rows.size, first = n + run->corrected.size;
    const Reals2 u = rows_of(run->corrections, 0, s), w = rows_of(run->corrections, s, s);
    const Reals2 after = rows_of(run->after, k * (3 * s + 1), 3 * s + 1);
    const Reals2 reaction = slice(run->tables.reaction, step);
    const Reals solution = row(run->right, k);
    for (int64_t i = 0; i < s; i++) copy(row(u, i), from(solution, i * unknowns));
    fill(flat(w), 0.0);
    add_product(w, slice(run->tables.velocity, step), 0, u);
    for (int64_t i = 0; i < s; i++) {
        const double *x = solution.at + i * unknowns + n;
        PICK(row(w, i).at, run->corrected.at, x, run->entries.at, 0, run->corrected.size);
    }
    add_product(after, slice(run->tables.by_corrections, step), 0, run->corrections);
    for (int64_t i = 0; i < s && run->stages.rows > 0; i++) {
        const Reals result = row(run->stages, (s * step + i) * run->shifts.size + k);
        copy(part(result, 0, 3 * n), flat(rows_of(after, 3 * i, 3)));
        fill(from(result, 3 * n), 0.0);
        for (int64_t j = 0; j < s; j++)
            add_to(from(result, 3 * n), row(reaction, i).at[j],
                   from(solution, j * unknowns + first));
    }
    copy(flat(rows_of(run->motion, 4 * k, 4)), flat(rows_of(after, 3 * s - 3, 4)));
}

/* Differentiate steps along all directions; return DONE, NEW_PIVOTS or SINGULAR. */
int forward(LinearSteps *run) {
    while (run->step < run->last) {
        const int code = factorize_step(run);
        if (code != DONE) return code;
        for (int64_t k = 0; k < run->shifts.size; k++) predict_direction(run, k);
        solve_rows(&run->linear, run->right, run->lanes);
        for (int64_t k = 0; k < run->shifts.size; k++) correct_direction(run, k);
        run->step++;
    }
    return DONE;
}

static void transpose_step(LinearSteps *run) {
    const int64_t n = run->n, s = run->nodes.size, step = run->step, n_inputs = run->n_inputs;
    const int64_t unknowns = run->rows.size, corrected = run->corrected.size;
    const Reals2 u = rows_of(run->corrections, 0, s), w = rows_of(run->corrections, s, s);
    const Reals2 reaction = slice(run->tables.reaction, step);
    const Reals weights = from(run->inputs, n_inputs), gradient = run->result;
    const Reals right = row(run->right, 0);
    fill(flat(run->after), 0.0);
    for (int64_t i = 0; i < s; i++)
        copy(flat(rows_of(run->after, 3 * i, 2)), row(run->stages, s * step + i));
    add_to(flat(rows_of(run->after, 3 * s - 3, 4)), 1.0, flat(run->motion));
    fill(flat(run->corrections), 0.0);
    add_product(run->corrections, slice(run->tables.by_corrections, step), 1, run->after);
    for (int64_t i = 0; i < s; i++) {
        const Reals x = part(right, i * unknowns, (i + 1) * unknowns);
        const Reals lam = part(x, n + corrected, n + corrected + run->m), rates = row(w, i);
        fill(from(x, n), 0.0);
        PICK(x.at + n, run->entries.at, rates.at, run->corrected.at, 0, corrected);
        for (int64_t j = 0; j < corrected; j++) rates.at[run->corrected.at[j]] = 0.0;
        for (int64_t j = 0; j < s; j++)
            add_to(lam, row(reaction, j).at[i], from(row(run->stages, s * step + j), 2 * n));
    }
    add_product(u, slice(run->tables.velocity, step), 1, w);
    for (int64_t i = 0; i < s; i++)
        copy(part(right, i * unknowns, i * unknowns + n), row(u, i));
    solve(&run->linear, right);
    for (int64_t i = 0; i < s; i++) {
        const double *x = right.at + i * unknowns;
        fill(weights, 0.0);
        GATHER(weights.at, run->rows.at, run->scales.at, x, run->entries.at, 0, unknowns);
        set_state(run, s * step + 1 + i, 1.0);
        set_time(&run->change, stage_time(run, i), run->branch);
        evaluate_sum(&run->change, run->inputs, gradient);
        add_to(run->numbers, 1.0, from(gradient, n_inputs));
        add_to(flat(rows_of(run->after, 3 * i, 2)), 1.0, gradient);
    }
    fill(flat(run->motion), 0.0);
    add_product(run->motion, slice(run->tables.by_motion, step), 1, run->after);
}

/* Transpose steps, the last one first; return DONE, NEW_PIVOTS or SINGULAR. */
int backward(LinearSteps *run) {
    while (run->step > run->last) {
        run->step--;
        const int code = factorize_step(run);
        if (code != DONE) {
            run->step++;
            return code;
        }
        transpose_step(run);
    }
    return DONE;
}
