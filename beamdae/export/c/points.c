/* Steps of kernels that are sums over points. */

#include "points.h"

static void mix_row(Register *target, const Register *row, Register weight, int adds, Mix x) {
    if (adds)
        for (uint32_t k = 0; k < x.length; k++) target[k * x.stride] += weight * row[k];
    else
        for (uint32_t k = 0; k < x.length; k++) target[k * x.stride] = weight * row[k];
}

/* `WEIGHT` is that of entry k. */
#define MIX(WEIGHT)                                                                                \
    for (uint32_t i = 0, k = 0; i < x.tiles * x.tile; i++)                                         \
        for (uint32_t e = 0; e < x.entries; e++, k++)                                              \
            mix_row(target + i * x.row_stride, source + columns[i / x.tile * x.entries + e],       \
                    WEIGHT, x.adds || e > 0, x)

void mix(Register *target, const Register *source, const uint32_t *columns, const double *weights,
         Mix x) {
    MIX(ALL(weights[k]));
}

void mix_numbers(Register *target, const Register *source, const uint32_t *columns,
                 const uint32_t *indices, Mix x, const Register *numbers) {
    MIX(numbers[indices[k]]);
}

void spread(Register *target, const Register *source, const uint32_t *places,
            const double *weights, uint32_t runs, uint32_t entries, uint32_t count) {
    for (uint32_t i = 0; i < runs; i++, places += entries + 1, weights += entries * count)
        for (uint32_t k = 0; k < count; k++) {
            Register sum = {0.0};
            for (uint32_t e = 0; e < entries; e++)
                sum += weights[k * entries + e] * source[places[e + 1]];
            target[places[0] + k] = sum;
        }
}

void load_rows(Register *target, const uint32_t *rows, uint32_t count, const double *local,
               int64_t lanes) {
    for (uint32_t k = 0; k < count; k++) target[k] = LOAD(rows[k]);
}

void store_rows(const Register *source, const uint32_t *rows, uint32_t count, double *out,
                int64_t lanes) {
    for (uint32_t k = 0; k < count; k++) STORE(rows[k], source[rows[count + k]]);
}

void set_rows(Register *target, uint32_t count, double value) {
    for (uint32_t k = 0; k < count; k++) target[k] = ALL(value);
}
