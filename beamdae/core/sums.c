/* Sums of kernels, and the forms of the equations of motion that consist of them. */

#include "core.h"

#include <string.h>

/* Outputs (component, lane) of the copies of a kernel from their inputs (component, lane). */
typedef void (*Kernel)(const double *shared, const double *local, double *out, int64_t lanes);

/* Row of `Sum.batches`: start of the inputs, number of lanes, and ends of the entries of tables. */
typedef struct {
    int64_t start, lanes, pick, gather, add, weighted, pick_tile;
} Batch;

/* Up to `TILE_ROWS` rows of lanes in a batch: position of the first number, number of rows, and
   index of the first number of each lane in a vector. */
#define TILE_ROWS 4
typedef struct {
    uint32_t start, height, lanes[LANES];
} Tile;

/* Indices of shared numbers; see symbolic/local_symbols.py. */
enum { TIME, BRANCH, C_Q, C_V, C_A, C_L, C_H, C_R };

typedef double Run __attribute__((vector_size(8 * TILE_ROWS), aligned(8), may_alias));

#ifdef __clang__
#define SHUFFLE(x, y, ...) __builtin_shufflevector(x, y, __VA_ARGS__)
#else
typedef int64_t RunMask __attribute__((vector_size(8 * TILE_ROWS)));
#define SHUFFLE(x, y, ...) __builtin_shuffle(x, y, (RunMask){__VA_ARGS__})
#endif

static inline void transpose(Run x[TILE_ROWS]) {
    const Run a = SHUFFLE(x[0], x[1], 0, 4, 2, 6), b = SHUFFLE(x[0], x[1], 1, 5, 3, 7);
    const Run c = SHUFFLE(x[2], x[3], 0, 4, 2, 6), d = SHUFFLE(x[2], x[3], 1, 5, 3, 7);
    x[0] = SHUFFLE(a, c, 0, 1, 4, 5), x[1] = SHUFFLE(b, d, 0, 1, 4, 5);
    x[2] = SHUFFLE(a, c, 2, 3, 6, 7), x[3] = SHUFFLE(b, d, 2, 3, 6, 7);
}

/* Set row i, `stride` numbers apart, to vector[index + i] for the index of each lane. All
   `TILE_ROWS` numbers of a lane can be read. */
static inline void pick_tile(double *out, int64_t stride, const double *x, const Tile *tile) {
    for (int half = 0; half < LANES; half += TILE_ROWS) {
        Run rows[TILE_ROWS];
        for (int l = 0; l < TILE_ROWS; l++) rows[l] = *(const Run *)(x + tile->lanes[half + l]);
        transpose(rows);
        for (uint32_t i = 0; i < tile->height; i++)
            *(Run *)(out + tile->start + half + i * stride) = rows[i];
    }
}

void evaluate_with_data(Sum *total, Reals inputs, Reals x, Reals result) {
    double *local = inputs.at, *out = total->out.at;
    const Tile *pick_tiles = (const Tile *)total->pick_tiles.at;
    Batch last = {0};
    fill(result, 0.0);
    for (int64_t k = 0; k < total->batches.rows; k++) {
        const Batch batch = ((const Batch *)total->batches.at)[k];
        for (int64_t i = last.pick_tile; i < batch.pick_tile; i++)
            pick_tile(local + batch.start, batch.lanes, x.at, pick_tiles + i);
        PICK(local, total->pick_targets.at, x.at, total->pick_sources.at, last.pick, batch.pick);
        GATHER(local, total->gather_targets.at, total->gather_weights.at, x.at,
               total->gather_sources.at, last.gather, batch.gather);
        ((Kernel)total->kernels.at[k])(total->shared.at, local + batch.start, out, batch.lanes);
        ADD(result.at, total->add_targets.at, out, total->add_sources.at, last.add, batch.add);
        ADD_WEIGHTED(result.at, total->weighted_targets.at, total->weights.at, out,
                     total->weighted_sources.at, last.weighted, batch.weighted);
        last = batch;
    }
    memcpy(out, total->shared.at, total->shared.size * sizeof(double));
    out[total->shared.size] = 1.0;
    ADD(result.at, total->add_targets.at, out, total->add_sources.at, last.add,
        total->add_targets.size);
    ADD_WEIGHTED(result.at, total->weighted_targets.at, total->weights.at, out,
                 total->weighted_sources.at, last.weighted, total->weighted_targets.size);
}

void evaluate_sum(Sum *total, Reals x, Reals result) {
    evaluate_with_data(total, total->local, x, result);
}

void set_time(Sum *total, double t, double branch) {
    total->shared.at[TIME] = t;
    total->shared.at[BRANCH] = branch;
}

void set_matrix_factors(Sum *total, double c_q, double c_v, double c_a, double c_l, double c_h,
                        double c_r) {
    double *shared = total->shared.at;
    shared[C_Q] = c_q, shared[C_V] = c_v, shared[C_A] = c_a;
    shared[C_L] = c_l, shared[C_H] = c_h, shared[C_R] = c_r;
}

int run_evaluation(Evaluation *evaluation) {
    evaluate_sum(&evaluation->total, evaluation->x, evaluation->result);
    return DONE;
}

/* Energies and powers of each row, then norms of F + G^T lam, G^T lam and F at a = 0, and of g and
   g_dot; see equations/measures.py. */
int evaluate_balance(BalanceBuffers *run) {
    enum { N_SCALARS = 6, N_FORCE_NORMS = 3, N_GAP_NORMS = 2 };
    const int64_t n = run->n, m = run->m;
    for (int64_t i = 0; i < run->n_rows; i++) {
        const Reals result = row(run->results, i);
        copy(run->total.shared, row(run->times, i));
        evaluate_sum(&run->total, row(run->states, i), run->value);
        copy(part(result, 0, N_SCALARS), run->value);
        Reals forces = from(run->value, N_SCALARS), gaps = from(forces, N_FORCE_NORMS * n);
        double *norms = result.at + N_SCALARS;
        for (int k = 0; k < N_FORCE_NORMS; k++)
            *norms++ = max_norm(part(forces, k * n, (k + 1) * n), run->is_force);
        for (int k = 0; k < N_GAP_NORMS; k++)
            *norms++ = max_norm(part(gaps, k * m, (k + 1) * m), run->ones);
    }
    return DONE;
}

/* Equations of one implicit step; see equations/formulations/step_equations.py. */

Reals evaluate_step_position(StepBuffers *form, const StepPrediction *at, Reals x) {
    const int64_t n = form->n, m = form->m;
    const Reals q = part(form->motion, 0, n);
    if (form->stabilized) {
        copy(part(form->motion, 3 * n + m, 4 * n + m), at->before);
        copy(from(form->motion, 4 * n + m), from(x, n + m));
        evaluate_sum(&form->anchor, form->motion, q);
        combine3(q, 1.0, at->q, 1.0, x, -1.0, q);
    } else
        combine2(q, 1.0, at->q, 1.0, x);
    return q;
}

static void set_motion(StepBuffers *form, const StepPrediction *at, Reals x, double lam_factor) {
    const int64_t n = form->n, m = form->m;
    const double *c = at->coefficients.at;
    evaluate_step_position(form, at, x);
    combine2(part(form->motion, n, 2 * n), 1.0, at->v, c[0], x);
    combine2(part(form->motion, 2 * n, 3 * n), 1.0, at->a, c[1], x);
    scale(part(form->motion, 3 * n, 3 * n + m), lam_factor, from(x, n));
}

void evaluate_step_residual(StepBuffers *form, double t, double branch, const StepPrediction *at,
                            Reals x, Reals result) {
    const int64_t n = form->n, m = form->m;
    const double *c = at->coefficients.at;
    set_time(&form->anchor, t, branch);
    set_time(&form->residual, t, branch);
    set_motion(form, at, x, 1.0 / c[2]);
    evaluate_sum(&form->residual, form->motion, result);
    scale(part(result, 0, n), c[2], result);
    for (int64_t k = 0; k < form->velocity_rows.size; k++)
        result.at[form->velocity_rows.at[k]] /= c[0];
    if (form->stabilized) {
        const Reals velocities = part(result, n + m, n + 2 * m);
        scale(velocities, 1.0 / c[0], velocities);
        fill(from(result, n + 2 * m), 0.0);
    }
}

void evaluate_step_matrix(StepBuffers *form, double t, double branch, const StepPrediction *at,
                          Reals x, Reals result) {
    const double *c = at->coefficients.at;
    set_time(&form->anchor, t, branch);
    set_time(&form->matrix, t, branch);
    set_matrix_factors(&form->matrix, c[2], c[2] * c[0], c[2] * c[1], 1.0, 1.0 / c[0],
                       1.0 / c[2]);
    set_motion(form, at, x, 1.0);
    evaluate_sum(&form->matrix, form->motion, result);
}

/* First-order forms R(t, y, y') = 0; see equations/formulations/first_order.py. */

static void set_inputs(FirstOrderBuffers *form, Sum *total, double t, double branch, Reals y,
                       Reals yp) {
    copy(part(form->x, 0, form->size), y);
    copy(from(form->x, form->size), yp);
    set_time(total, t, branch);
}

void evaluate_residual(FirstOrderBuffers *form, double t, double branch, Reals y, Reals yp,
                       Reals result) {
    const int64_t n = form->n;
    set_inputs(form, &form->residual, t, branch, y, yp);
    evaluate_sum(&form->residual, form->x, result);
    combine3(part(result, 0, n), 1.0, result, 1.0, yp, -1.0, from(y, n));
}

void evaluate_jacobian(FirstOrderBuffers *form, double t, double branch, double c, Reals y,
                       Reals yp, Reals result) {
    set_inputs(form, &form->jacobian, t, branch, y, yp);
    set_matrix_factors(&form->jacobian, 1.0, 1.0, c, c, 1.0, 1.0);
    evaluate_sum(&form->jacobian, form->x, result);
}

/* Non-zeros of dR/dy, then of dR/dy'. */
void evaluate_jacobian_parts(FirstOrderBuffers *form, double t, double branch, Reals y, Reals yp,
                             Reals result) {
    evaluate_jacobian(form, t, branch, 1.0, y, yp, result);
}

/* Unknowns that remain without velocities that q' = v defines. */
void reduce_unknowns(const KinematicReduction *at, int64_t n, Reals full, Reals reduced) {
    const int64_t count = at->corrected.size;
    copy(part(reduced, 0, n), full);
    PICK(reduced.at, at->remaining_velocities.at, full.at, at->corrected_velocities.at, 0, count);
    copy(from(reduced, n + count), from(full, 2 * n));
}
