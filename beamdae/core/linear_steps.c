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
            const Reals4 shares = run->tables.blocks;
            scale(block, entry4(shares, k, i, j, 0), run->parts);
            for (int64_t part = 1; part < shares.n3; part++)
                add_to(block, entry4(shares, k, i, j, part), from(run->parts, part * size));
            const uint32_t *targets = run->targets.at + (s * i + j) * run->targets.columns;
            PICK(run->nonzeros.at, targets, block.at, run->entries.at, 0, size);
        }
    }
    return factorize(&run->linear, run->nonzeros);
}

static void differentiate_step(LinearSteps *run, int64_t k) {
    const int64_t n = run->n, s = run->nodes.size, step = run->step;
    const int64_t unknowns = run->rows.size, first = n + run->corrected.size;
    const StepTables *tables = &run->tables;
    const Reals changes = from(run->inputs, run->n_inputs), next_a = row(run->before, 3);
    Reals z[4];
    for (int b = 0; b < 4; b++) z[b] = row(run->motion, 4 * k + b);
    for (int64_t i = 0; i < s; i++) {
        set_state(run, s * step + 1 + i, 1.0);
        for (int64_t j = 0; j < 2; j++) {
            const Reals change = part(changes, j * n, (j + 1) * n);
            combine2(change, entry4(tables->predict, step, i, j, 0), z[0],
                     entry4(tables->predict, step, i, j, 1), z[1]);
            combine3(change, 1.0, change, entry4(tables->predict, step, i, j, 2), z[2],
                     entry4(tables->predict, step, i, j, 3), z[3]);
        }
        copy(row(run->positions, i), changes);
        copy(row(run->velocities, i), from(changes, n));
        set_time(&run->change, stage_time(run, i), run->branch);
        evaluate_with_data(&run->change, row(run->data, k), run->inputs, run->result);
        if (run->shifts.at[k] != 0.0)
            add_to(run->result, run->shifts.at[k], row(run->time_rates, s * step + i));
        const Reals right = part(run->right, i * unknowns, (i + 1) * unknowns);
        for (int64_t e = 0; e < unknowns; e++)
            right.at[e] = run->scales.at[e] * run->result.at[run->rows.at[e]];
    }
    solve(&run->linear, run->right);
    const double *after = row(tables->after, step).at;
    combine4(next_a, after[0], z[0], after[1], z[1], after[2], z[2], after[3], z[3]);
    add_to(next_a, after[4], from(run->right, (s - 1) * unknowns));
    /* Accelerations serve as work array for the corrections of velocities. */
    for (int64_t i = 0; i < s; i++) {
        const Reals correction = row(run->accelerations, i);
        fill(correction, 0.0);
        for (int64_t j = 0; j < s; j++)
            add_to(correction, entry3(tables->velocity, step, i, j),
                   from(run->right, j * unknowns));
        const double *x = run->right.at + i * unknowns + n;
        PICK(correction.at, run->corrected.at, x, run->entries.at, 0, run->corrected.size);
    }
    for (int64_t i = 0; i < s; i++) {
        const Reals result = row(run->stages, (s * step + i) * run->shifts.size + k);
        combine2(part(result, 0, n), 1.0, row(run->positions, i), -1.0,
                 from(run->right, i * unknowns));
        combine2(part(result, n, 2 * n), 1.0, row(run->velocities, i), -1.0,
                 row(run->accelerations, i));
        fill(from(result, 2 * n), 0.0);
        for (int64_t j = 0; j < s; j++) {
            add_to(part(result, 2 * n, 3 * n), -entry3(tables->acceleration, step, i, j),
                   row(run->accelerations, j));
            add_to(from(result, 3 * n), -entry3(tables->reaction, step, i, j),
                   from(run->right, j * unknowns + first));
        }
    }
    const Reals last = row(run->stages, (s * step + s - 1) * run->shifts.size + k);
    for (int b = 0; b < 3; b++) copy(z[b], from(last, b * n));
    copy(z[3], next_a);
}

/* Differentiate steps along all directions; return DONE, NEW_PIVOTS or SINGULAR. */
int forward(LinearSteps *run) {
    while (run->step < run->last) {
        const int code = factorize_step(run);
        if (code != DONE) return code;
        for (int64_t k = 0; k < run->shifts.size; k++) differentiate_step(run, k);
        run->step++;
    }
    return DONE;
}

static void transpose_step(LinearSteps *run) {
    const int64_t n = run->n, m = run->m, s = run->nodes.size, step = run->step;
    const int64_t unknowns = run->rows.size, corrected = run->corrected.size;
    const int64_t first = n + corrected, n_inputs = run->n_inputs;
    const Reals weights = from(run->inputs, n_inputs), gradient = run->result;
    const StepTables *tables = &run->tables;
    const double *after = row(tables->after, step).at;
    Reals z[4];
    for (int b = 0; b < 4; b++) z[b] = row(run->motion, b);
    for (int64_t i = 0; i < s; i++) {
        const Reals seed = row(run->stages, s * step + i);
        copy(row(run->positions, i), seed);
        copy(row(run->velocities, i), from(seed, n));
        copy(row(run->reactions, i), from(seed, 2 * n));
    }
    add_to(row(run->positions, s - 1), 1.0, z[0]);
    add_to(row(run->velocities, s - 1), 1.0, z[1]);
    for (int64_t i = 0; i < s; i++) {
        const Reals correction = row(run->accelerations, i);
        combine2(correction, -1.0, row(run->velocities, i),
                 -entry3(tables->acceleration, step, s - 1, i), z[2]);
        const Reals x = part(run->right, i * unknowns, (i + 1) * unknowns);
        scale(part(x, 0, n), -1.0, row(run->positions, i));
        fill(from(x, n), 0.0);
        PICK(x.at + n, run->entries.at, correction.at, run->corrected.at, 0, corrected);
        for (int64_t j = 0; j < corrected; j++) correction.at[run->corrected.at[j]] = 0.0;
        for (int64_t j = 0; j < s; j++)
            add_to(part(x, first, first + m), -entry3(tables->reaction, step, j, i),
                   row(run->reactions, j));
    }
    const int64_t last = (s - 1) * unknowns;
    add_to(part(run->right, last, last + n), after[4], z[3]);
    for (int64_t i = 0; i < s; i++)
        for (int64_t j = 0; j < s; j++)
            add_to(part(run->right, i * unknowns, i * unknowns + n),
                   entry3(tables->velocity, step, j, i), row(run->accelerations, j));
    solve(&run->linear, run->right);
    for (int b = 0; b < 4; b++) scale(row(run->before, b), after[b], z[3]);
    for (int64_t i = 0; i < s; i++) {
        const double *x = run->right.at + i * unknowns;
        fill(weights, 0.0);
        GATHER(weights.at, run->rows.at, run->scales.at, x, run->entries.at, 0, unknowns);
        set_state(run, s * step + 1 + i, 1.0);
        set_time(&run->change, stage_time(run, i), run->branch);
        evaluate_sum(&run->change, run->inputs, gradient);
        add_to(run->numbers, 1.0, from(gradient, n_inputs));
        const Reals q = row(run->positions, i), v = row(run->velocities, i);
        add_to(q, 1.0, gradient);
        add_to(v, 1.0, from(gradient, n));
        for (int b = 0; b < 4; b++)
            combine3(row(run->before, b), 1.0, row(run->before, b),
                     entry4(tables->predict, step, i, 0, b), q,
                     entry4(tables->predict, step, i, 1, b), v);
    }
    for (int b = 0; b < 4; b++) copy(z[b], row(run->before, b));
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
