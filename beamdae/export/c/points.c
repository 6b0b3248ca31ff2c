/* Steps of kernels that are sums over points. */

#include "points.h"

static void mix_row(double *target, const double *source, const uint32_t *columns,
                    const double *weights, Mix x) {
    for (uint32_t e = 0; e < x.entries; e++) {
        const double *row = source + columns[e], weight = weights[e];
        if (e == 0 && !x.adds)
            for (uint32_t k = 0; k < x.length; k++) target[k * x.stride] = weight * row[k];
        else
            for (uint32_t k = 0; k < x.length; k++) target[k * x.stride] += weight * row[k];
    }
}

void mix(double *target, const double *source, const uint32_t *columns, const double *weights, Mix x) {
    for (uint32_t i = 0; i < x.tiles * x.tile; i++)
        mix_row(target + i * x.row_stride, source, columns + i / x.tile * x.entries,
                weights + i * x.entries, x);
}

void mix_numbers(double *target, const double *source, const uint32_t *columns, const uint32_t *indices,
                 Mix x, const double *numbers) {
    const int adds = x.adds;
    const uint32_t entries = x.entries;
    x.entries = 1;
    for (uint32_t i = 0; i < x.tiles * x.tile; i++)
        for (uint32_t e = 0; e < entries; e++) {
            x.adds = adds || e > 0;
            mix_row(target + i * x.row_stride, source, columns + i / x.tile * entries + e,
                    numbers + indices[i * entries + e], x);
        }
}

void spread(double *target, const double *source, const uint32_t *places, const double *weights,
            uint32_t runs, uint32_t entries, uint32_t count) {
    for (uint32_t i = 0; i < runs; i++, places += entries + 1, weights += entries * count)
        for (uint32_t k = 0; k < count; k++) {
            double sum = 0.0;
            for (uint32_t e = 0; e < entries; e++)
                sum += weights[k * entries + e] * source[places[e + 1]];
            target[places[0] + k] = sum;
        }
}

void load(double *target, const uint32_t *rows, uint32_t count, const double *local,
          int64_t lanes) {
    for (uint32_t k = 0; k < count; k++) target[k] = local[rows[k] * lanes];
}

void store(const double *source, const uint32_t *rows, uint32_t count, double *out, int64_t lanes) {
    for (uint32_t k = 0; k < count; k++) out[rows[k] * lanes] = source[rows[count + k]];
}

void set(double *target, uint32_t count, double value) {
    for (uint32_t k = 0; k < count; k++) target[k] = value;
}
