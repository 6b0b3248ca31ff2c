/* Tables on which the loops of beamdae work, and the functions that Python calls.

   A table holds one object, in words of 64 bits: integers, numbers, and for an array its address
   and its shape. `tables.py` reads the structures in this file and fills tables from Python objects
   with attributes of the same names, such as `Workspace`. Attributes that an object lacks are zero; a
   field `base` holds attributes of the same object. */

#ifndef BEAMDAE_CORE_H
#define BEAMDAE_CORE_H

#include "arrays.h"

/* Return codes; negative codes are failures. DIVERGED and TOO_SMALL belong to different loops. */
enum {
    DONE = 0,       /* The interval is complete. */
    FULL = 1,       /* There is no room for more rows of results. */
    NEW_PIVOTS = 2, /* A matrix needs other pivots. */
    CORRECTED = 3,  /* Statics: another correction is needed. */
    FIRST_STEP = 10, /* Alpha requests the starting values of an interval. */
    NO_ADVANCE = 11, /* A step of IDA does not advance time. */
    NOT_CONVERGED = -1,   /* Newton's iteration */
    NOT_FINITE = -2,      /* the residual */
    SINGULAR = -3,        /* No pivots suit a matrix. */
    ERROR_TOO_LARGE = -4, /* The error test failed. */
    TOO_SMALL = -5,       /* the step */
    STEP_NOT_CHANGED = -6, /* Alpha: singular equations of the jerk. */
    DIVERGED = -7 /* Newton's method of statics */
};

/* Linear systems */

typedef struct {
    Reals scale;
    Indices matrix_starts, matrix_rows;
    Integers2 batches;
    Indices block_unknowns, block_entries, corner_entries;
    Indices rows, columns, starts, positions, sources;
    Indices upper_starts, upper_rows, lower_starts, lower_rows;
} EliminationPlan;

typedef struct {
    Reals matrix, entries, blocks, corner, block_x, upper, lower, inverse, x;
    Reals solution, right, residual, terms;
    Integers refinements;
} Factors;

typedef struct {
    Complexes matrix, entries, blocks, corner, block_x, upper, lower, inverse, x;
    Complexes solution, right, residual;
    Reals terms;
    Integers refinements;
} ComplexFactors;

typedef struct {
    EliminationPlan plan;
    Factors factors;
    int64_t needs_pivots, is_untried, singular, factorizations, solves;
    Reals full; /* Not empty if the full matrix is eliminated instead, see elimination.h. */
} LinearSolver;

typedef struct {
    EliminationPlan plan;
    ComplexFactors factors;
    int64_t needs_pivots, is_untried, singular, factorizations, solves;
    Complexes full;
} ComplexSolver;

int factorize(LinearSolver *linear, Reals nonzeros);
int factorize_complex(ComplexSolver *linear, Complexes nonzeros);
void solve(LinearSolver *linear, Reals right);
void solve_complex(ComplexSolver *linear, Complexes right);
/* One right-hand side a row; `lanes` is a work array of 4 LANES (size) numbers. */
void solve_rows(LinearSolver *linear, Reals2 right, Reals lanes);

/* Sums of kernels */

typedef struct {
    Reals shared, local, out;
    Integers kernels;
    Integers2 batches;
    Indices pick_targets, pick_sources, gather_targets, gather_sources;
    Reals gather_weights;
    Indices add_targets, add_sources, weighted_targets, weighted_sources;
    Reals weights;
    Indices2 pick_tiles;
} Sum;

void evaluate_sum(Sum *total, Reals x, Reals result);
/* With `local` in place of the inputs of the copies in `total`. */
void evaluate_with_data(Sum *total, Reals local, Reals x, Reals result);
void set_time(Sum *total, double t, double branch);
void set_matrix_factors(Sum *total, double c_q, double c_v, double c_a, double c_l, double c_h,
                        double c_r);

typedef struct {
    Sum total;
    Reals x, result;
} Evaluation;

int run_evaluation(Evaluation *evaluation);

/* Energies, powers and norms `results` of `n_rows` rows (t, branch) and (q, v, a, lam). `value` is
   the sum at one row; norms have the weights `is_force` (0 for first-order states) and `ones`. */
typedef struct {
    Sum total;
    int64_t n, m;
    Reals2 times, states, results;
    Reals value, is_force, ones;
    int64_t n_rows;
} BalanceBuffers;

int evaluate_balance(BalanceBuffers *run);

/* Forms of the equations */

/* Equations of a step of generalized-alpha. `motion` contains their inputs (q, v, a, lam), followed
   by (q_n, eta) if `stabilized`; `velocity_rows` are those in which g_dot / c_v replaces g. */
typedef struct {
    int64_t n, m, stabilized;
    Reals motion;
    Integers velocity_rows;
    Sum residual, anchor, matrix;
} StepBuffers;

typedef struct {
    Reals q, v, a, before, coefficients;
} StepPrediction;

/* First-order form with `n` coordinates and `size` unknowns; x is (y, y'). */
typedef struct {
    int64_t n, size;
    Reals x;
    Sum residual, jacobian;
} FirstOrderBuffers;

typedef struct {
    Indices corrected, defined, corrected_velocities, defined_velocities, remaining_velocities;
    Indices force_starts, force_rows, law_starts, law_columns;
} KinematicReduction;

Reals evaluate_step_position(StepBuffers *form, const StepPrediction *at, Reals x);
void evaluate_step_residual(StepBuffers *form, double t, double branch, const StepPrediction *at,
                            Reals x, Reals result);
void evaluate_step_matrix(StepBuffers *form, double t, double branch, const StepPrediction *at,
                          Reals x, Reals result);
void evaluate_residual(FirstOrderBuffers *form, double t, double branch, Reals y, Reals yp,
                       Reals result);
void evaluate_jacobian(FirstOrderBuffers *form, double t, double branch, double c, Reals y,
                       Reals yp, Reals result);
void evaluate_jacobian_parts(FirstOrderBuffers *form, double t, double branch, Reals y, Reals yp,
                             Reals result);
void reduce_unknowns(const KinematicReduction *at, int64_t n, Reals full, Reals reduced);

/* Steps */

double clip_step(double step, double remaining);
void lower_weights(Reals weights, double tolerance, Reals values);

/* Motion at `q` and `v`. `motion` evaluates F and the constraints at three levels, `saddle` the
   matrix [[M + stiffness K, G^T + dF/dlam], [G, 0]], both at `inputs` = (q, v, a, lam). */
typedef struct {
    int64_t n, m, has_friction;
    double t, branch;
    Reals q, v, lam; /* forces of friction are those of `lam` */
    Integers states; /* first-order states */
    Sum motion, saddle;
    LinearSolver linear;
    Reals inputs, levels, nonzeros;
    Reals solution; /* accelerations, then multipliers */
} MotionBuffers;

/* Evaluate (F, g, g', g'') of `total` at (q, v, a, lam), zeros if they are empty, in `levels`. */
void evaluate_motion(MotionBuffers *x, Sum *total, double t, Reals q, Reals v, Reals a, Reals lam);
/* Also factorize the saddle-point matrix. */
int factorize_saddle(MotionBuffers *x, Reals v, Reals lam, double stiffness);
/* Solve [[M, G^T], [G, 0]] (x, mu) = (0, -right) with the last factors, in `solution`. */
void solve_constraints(MotionBuffers *x, Reals right);
/* Time derivative of g'' at constant accelerations a, a difference over +-interval, in `rate`. */
void evaluate_constraint_rate(MotionBuffers *x, Reals a, double interval, Reals rate);
/* Accelerations and multipliers with the stiffness, and the forces `change` (empty for none). */
int solve_accelerations(MotionBuffers *x, double stiffness, Reals change);
/* The same, and consistent rates of states, after a jump of held inputs. */
int solve_jump(MotionBuffers *x);

/* State after a step of length h; a is the algorithmic acceleration. */
typedef struct {
    Reals q, v, ddq, a, lam;
    double h;
} Motion;

typedef struct {
    StepBuffers form;
    LinearSolver linear;
    double alpha_m, alpha_f, gamma, beta, defect; /* see `family.AlphaParameters` */
    Motion current, accepted_motion; /* with the length of the next step; after the last step */
    StepPrediction prediction;
    /* Predicted a, values at the start of the step, unknowns, first iterate of those besides the
       increments, and correction of the unknowns. */
    Reals a_predicted, ddq_n, a_n, lam_n, x, first_multipliers, change, nonzeros;
    /* Reciprocal scales of coordinates; 1 for multipliers that are tested, otherwise 0. */
    Reals weights, reaction_weights;
    Reals2 rows; /* (t, q, v, ddq, lam) of the steps taken, `filled` of them */
    /* Newton tolerance relative to beta h^2 times the largest scaled acceleration, lower bound of
       `correction_limit`, local error tolerance, and bounds of adaptive steps. */
    double newton_tolerance, min_correction_limit, tolerance, max_step, min_step;
    Integers states; /* first-order states */
    int64_t fixed_iterations; /* of Newton in every fixed step; 0 for as many as necessary */
    /* 0 if the starting values of an interval have just been set; 1 after a jump of inputs. */
    int64_t has_started, has_jumped, filled;
    double step_ratio; /* to the previous step, 0 in the first one */
    int64_t most;      /* rows to fill */
    /* Newton tolerance of scaled positions in this step, factor that compares corrections of
       reactions with it, and last rate of convergence. */
    double correction_limit, reaction_factor, rate, t, branch, start_time, end;
    int64_t step_count, total_steps; /* of equal steps */
    /* Next step to try, and the largest one that only the end of the interval has shortened. */
    double next_step, unclipped_step;
    int64_t steps_checked;   /* since growth was last considered */
    double max_error, error; /* of these steps and of the last one, relative to the tolerance */
    int64_t residuals, jacobians, failures, rejections;
    /* Adaptive steps */
    MotionBuffers jerk; /* normal to the constraints: it corrects velocities if the step changes */
    Reals constraint_rate;
    int64_t corrects_velocities;
    Reals velocity_weights; /* reciprocal scales of velocities, 0 if they are not tested */
    Reals multiplier_weights; /* see `MultiplierTolerances` */
    double multiplier_tolerance, shortest_tested_step;
    Reals lam_before; /* at the start of the step before */
} AlphaWorkspace;

int take_fixed_steps(AlphaWorkspace *run);
int take_adaptive_steps(AlphaWorkspace *run);

/* See `radau/coefficients.py`. */
typedef struct {
    Reals nodes;
    Reals2 to_stages, from_stages, rates, rate_blocks, polynomial;
    Reals embedded, start, uniform, eigenvalues;
} Tableau;

/* Step size control with the errors e_n of the last two steps, relative to the tolerance:
   h_{n+1} = 0.9 h_n e_n^(-1/4) min(1, (h_n / h_{n-1}) (e_{n-1} / e_n)^(1/4)), within bounds and
   reduced after many Newton iterations; Gustafsson, ACM Trans. Math. Softw. 20 (1994) 496. */
typedef struct {
    double longest, smallest, next_step, last_step, last_error;
    int64_t is_retry; /* 1 if the previous attempt at this step was rejected */
} StepSizeState;

typedef struct {
    Tableau tableau;
    LinearSolver real_solver;
    ComplexSolver complex_solver;
    KinematicReduction reduction;
    StepSizeState step_size;
    Reals y, yp;
    Reals2 last_w, w, stages, rates;
    Reals real_change, complex_real, complex_imaginary, right, real_nonzeros;
    Complexes complex_change, complex_right, complex_nonzeros;
    Reals2 extrapolation;
    Reals velocities;
    /* Parts of the reduced matrices at the last factorization, derivatives of forces by resultants
       and of resultants by q and by v; see `KinematicReduction`. */
    Reals jacobian;
} Stages;

typedef struct {
    Stages base;
    FirstOrderBuffers form;
    Reals2 stage_residuals;
    Integers entry_rows, entry_columns; /* of the non-zeros of these matrices */
    /* Error estimate, difference between the embedded solution and the step, work arrays. */
    Reals error, difference, vector, product, constraint_errors;
    /* Weights of (q, v) in the error test of this step, of v in that of long steps, of multipliers,
       which fall as these grow, and of (q, v) in Newton's iteration. */
    Reals test_weights, tested_velocity_weights, multiplier_weights, iteration_weights;
    /* Weights of v in long steps, and of (step * v) in short steps, from rounding errors of q. */
    Reals velocity_weights, velocity_rounding_weights;
    Reals2 rows; /* (t, q, v, a, lam) of the stages */
    /* Rounding errors of q relative to those near the origin, largest weighted correction of an
       iteration that stagnates, errors of laws that end it, and the error test of multipliers. */
    double rounding_ratio, stagnation_limit, law_tolerance, multiplier_tolerance;
    double shortest_tested_step;
    int64_t filled, most;               /* rows, and steps to take */
    double t, branch, end, factors_step; /* step of the factors, 0 without factors */
    int64_t iterations;                 /* in the last step, with their last rate of convergence */
    double rate;
    /* The code is that of the last rejected attempt at this or the previous step. */
    int64_t residuals, jacobians, failures, rejections, failure_code;
} RadauWorkspace;

int take_radau_steps(RadauWorkspace *run);
void predict_stages(Stages *run, double h);
void set_stages(Stages *run, double h);
/* Set the non-zeros of both matrices to parts of a reduced matrix, and factorize them. */
int factorize_stages(Stages *run, double h, Reals jacobian);
void subtract_corrections(Stages *run, double h);
/* Evaluate and factorize both matrices at the second stage, which lies between the other two. */
int factorize_matrices(RadauWorkspace *run, double h);
/* Largest modulus of the first weighted entries; NaN if one of them is NaN. */
double max_modulus(Complexes x, Reals weights);
/* Subtract the corrections from W that belong to the residuals of the stages; rows q' = v must hold
   already. */
void correct_stages(RadauWorkspace *run, double h);

/* Rows q' - v + P G^T mu, `n` of them, become S^-1 (q' - v) + P G^T mu; none if the form does not
   correct positions. Weighted entries are added to the assembled rows. */
typedef struct {
    int64_t n;
    /* Of the entries of q', then of v: 0 to n - 1, twice; columns in (q', v), 0 to 2 n - 1; and
       indices in the non-zeros of the Jacobian. */
    Integers rows, columns, entry_indices;
    /* S^-1 - 1 for q', 1 - S^-1 for v; and factors in dR/dy + c dR/dy': c and 1. */
    Reals weights, factors;
} KinematicRowScaling;

typedef struct {
    FirstOrderBuffers form;
    LinearSolver linear;
    Reals raw_residual, nonzeros; /* residual before premultiplication */
    KinematicRowScaling kinematic;
    double correction_fraction, branch; /* of each correction that is applied, see `ida/stepper` */
    int64_t has_factors;
    double c; /* of dR/dy + c dR/dy' in the factors, which are `age` steps old */
    /* The address is that of a function that sets new pivots and returns 1 on success. */
    int64_t age, renew_address, residuals, jacobians;
} NewtonState;

typedef struct {
    int64_t IDASolve, IDASetStopTime, IDAGetLastOrder, IDAGetEstLocalErrors;
    int64_t N_VGetArrayPointer, SUNBandMatrix_Data;
} SundialsFunctions;

typedef struct {
    NewtonState newton;
    SundialsFunctions sundials;
    int64_t has_impulses;
    Reals2 rows; /* (t, q, v, a, lam) */
    /* Number of steps of each order, and of steps in which each unknown had the largest error. */
    Integers orders, limiting_counts;
    Reals weights, t, y, yp; /* error weights; arrays in which IDA returns its results */
    Shorts order;
    Reals errors;
    int64_t t_address, order_address, y_vector, yp_vector, errors_vector, memory;
    int64_t residual_vector;
    double end;
    int64_t filled, most;
} IdaWorkspace;

int take_ida_steps(IdaWorkspace *run);
/* Callbacks of IDA; their last or seventh argument is the table. */
int residual_callback(double t, void *y, void *yp, void *out, IdaWorkspace *run);
int jacobian_callback(double t, double c, void *y, void *yp, void *residual, void *matrix,
                      IdaWorkspace *run, void *work_1, void *work_2, void *work_3);

/* Analyses */

typedef struct {
    int64_t count, is_solved;
    double size, last, earlier, share, bound;
} Corrections;

int judge_correction(Corrections *run);

/* One of the parts C, U and L of the static equations. `tangent` evaluates non-zeros of the
   bordered matrix. */
typedef struct {
    Sum residual, tangent;
    Reals forces, nonzeros;
} LoadPart;

typedef struct {
    LoadPart common, unloaded, loaded; /* C, U and L */
    LinearSolver linear;               /* of the bordered matrix */
    /* Non-zeros of the bordered matrix; in natural sizes; products of the sizes of their rows and
       columns; and sizes of the unknowns, then 1, (n + m + 1,). */
    Reals nonzeros, scaled, products, sizes;
    Reals inputs;                   /* (q, 0, lam), with the zeros of velocities and accelerations */
    Reals forces, by_factor;        /* F and F_mu, (n + m,) */
    Reals row;                      /* last row, (n + m + 1,) */
    Indices row_targets, counting;  /* nonzeros[row_targets] = row; and 0, 1, 2, ... */
    Reals right;                    /* right-hand side, then the solution, (n + m + 1,) */
    Reals remainder;                /* multiples of g that the forces add to lam, (m,) */
    /* Constants of the tangent, nonzeros[added_targets] += added: springs that hold coordinates in
       the tangent alone, and the compliances -1. */
    Indices added_targets;
    Reals added;
    Reals weights;                  /* inverse natural sizes that measure corrections, (n + m,) */
    Corrections corrections;
    int64_t column_start;           /* of the last column, F_mu, in `nonzeros` */
    int64_t joint_count;            /* multipliers with g = 0; for the others, g - lam = 0 */
    double deviation;               /* value of the control minus its target */
    double mu, center, scale;       /* the load factor of U and L is (mu - center) * scale */
    int64_t task;
    int64_t is_linear;              /* 1 if derivatives of the control are the same everywhere */
    /* 1 if forces and tangent have been evaluated at `inputs` and `mu`; 1 if the last factors are
       those of the last tangent that was evaluated and `row`, with F_mu as column. */
    int64_t has_forces, has_tangent, has_factors;
} StaticWorkspace;

/* Tasks of `perform_task`: forces; tangent; and correct the point by Newton's method until it is a
   solution or, if the control is not linear, once. */
enum { EVALUATE_FORCES, EVALUATE_TANGENT, CORRECT };

int perform_task(StaticWorkspace *run);

typedef struct {
    Reals3 by_motion, by_corrections, velocity, reaction, blocks;
    Reals2 factors;
} StepTables;

/* Loop over the steps of a run, `forward` or `backward`; see analysis/sensitivities. */
typedef struct {
    int64_t n, m;
    double branch; /* a time inside the interval */
    /* Times of the steps, nodes of the stages, states (q, v, a, lam) at the start and all stages */
    Reals times, nodes;
    Reals2 states;
    StepTables tables;
    /* Matrix of a stage, its parts, and a block of M; non-zeros of M or of its transpose, positions
       of the entries of its blocks, and 0, 1, ... */
    Sum matrix;
    Reals parts, block;
    LinearSolver linear;
    Reals nonzeros;
    Indices2 targets;
    Indices entries;
    /* Inputs of the sums: `n_inputs` of the residual, with multipliers after accelerations. */
    Reals inputs;
    int64_t n_inputs, acceleration_at;
    /* Rows of the residual that are solved, their scales, coordinates with unknown velocities */
    Indices rows;
    Reals scales;
    Indices corrected;
    Reals2 right; /* right-hand sides or solutions, all stages, one direction a row */
    Reals lanes;  /* see `solve_rows` */
    /* z by direction, (4 k, n), or derivatives of the objective with respect to z, (4, n);
       corrections (u_q, w), (2 s, n), and the result of a step by direction, (k (3 s + 1), n), or
       derivatives with respect to them. */
    Reals2 motion, corrections, after;
    /* Directional derivative of the residual of a stage with the inputs (x, dx), or gradient of
       weights . residual with the inputs (x, weights). */
    Sum change;
    Reals result;
    /* Forward: further inputs by direction, derivatives of the time of all steps, and partial
       derivatives of the residual with respect to time at the stages. */
    Reals2 data;
    Reals shifts;
    /* Results, derivatives of (q, v, a, lam) at the stages, one direction a row, or none;
       backward: derivatives of the objective with respect to (q, v, lam) at the stages. */
    Reals2 time_rates, stages;
    Reals numbers;      /* backward: derivatives with respect to p, summed over the steps */
    int64_t step, last; /* index of the step, and of that at which the loop ends */
} LinearSteps;

int forward(LinearSteps *run);
int backward(LinearSteps *run);

#endif
