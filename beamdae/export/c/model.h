/* Exported model, defined in model.c.

   An instance is a block of 64-bit words: a table, followed by its arrays. */

#ifndef BEAMDAE_MODEL_H
#define BEAMDAE_MODEL_H

#include "arrays.h"

/* Writes the outputs of `WIDTH` copies; numbers of a copy are `lanes` apart. */
typedef void (*Kernel)(const double *shared, const double *local, double *out, int64_t lanes);

/* Function of the type `Kernel` of all copies in a batch. */
#define BATCH(name, kernel, copies)                                                                \
    static void name(const double *shared, const double *local, double *out, int64_t lanes) {      \
        for (int k = 0; k < copies; k += WIDTH) kernel(shared, local + k, out + k, lanes);         \
    }

/* Parts of kernels. */
#define LOAD(row) (*(const Register *)(local + (row) * lanes))
#define STORE(row, value) *(Register *)(out + (row) * lanes) = (value)
#define ALL(number) ((number) - (Register){0.0})

/* Last row k < count - 1 of a table with axis[k * lanes] <= x, or 0. */
int64_t find_row(const double *axis, int64_t lanes, int64_t count, double x);

static inline Register find_rows(const double *axis, int64_t lanes, int64_t count, Register x) {
#define FIND_ROW(i) find_row(axis + i, lanes, count, x[i])
    return (Register)NUMBERS(FIND_ROW);
}

static inline Register pick_rows(const double *rows, int64_t lanes, Register k) {
#define PICK_ROW(i) rows[(int64_t)k[i] * lanes + i]
    return (Register)NUMBERS(PICK_ROW);
}

/* Initial values of words; words that contain addresses of constants, of other words and of
   kernels; and words that contain numbers which depend on the values. */
typedef struct { int64_t at, count; const void *words; } Segment;
typedef struct { int64_t at; const uint32_t *array; } Constant;
typedef struct { int64_t at, to; } Link;
typedef struct { int64_t at; Kernel kernel; } Code;
typedef struct { int64_t at, number; } Number;

/* Values are the inputs, followed by the parameters. `n_state` is the number of words before those
   of the sums. */
typedef struct {
    uint32_t n_inputs, n_values, n_outputs;
    int64_t n_words, n_state;
    double step;
    int64_t n_segments, n_constants, n_links, n_codes, n_numbers;
    const Segment *segments;
    const Constant *constants;
    const Link *links;
    const Code *codes;
    const Number *numbers;
    /* From the values, followed by a direction; results are `LANES` apart. */
    Kernel write_numbers, write_direction;
    const char *const *value_names;
} Model;

extern const Model model;
/* GUID or instantiation token of the model description. */
extern const char model_token[];

#endif
