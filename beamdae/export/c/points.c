/* Steps of kernels that are sums over points. */

#include "points.h"

static void mix_row(double *target, const double *source, const Index *columns,
                    const double *weights, Mix x) {
    for (Index e = 0; e < x.entries; e++) {
        const double *row = source + columns[e], weight = weights[e];
        if (e == 0 && !x.adds)
            for (Index k = 0; k < x.length; k++) target[k * x.stride] = weight * row[k];
        else
            for (Index k = 0; k < x.length; k++) target[k * x.stride] += weight * row[k];
    }
}

void mix(double *target, const double *source, const Index *columns, const double *weights, Mix x) {
    for (Index i = 0; i < x.tiles * x.tile; i++)
        mix_row(target + i * x.row_stride, source, columns + i / x.tile * x.entries,
                weights + i * x.entries, x);
}

void mix_numbers(double *target, const double *source, const Index *columns, const Index *indices,
                 Mix x, const double *numbers) {
    const int adds = x.adds;
    const Index entries = x.entries;
    x.entries = 1;
    for (Index i = 0; i < x.tiles * x.tile; i++)
        for (Index e = 0; e < entries; e++) {
            x.adds = adds || e > 0;
            mix_row(target + i * x.row_stride, source, columns + i / x.tile * entries + e,
                    numbers + indices[i * entries + e], x);
        }
}

void spread(double *target, const double *source, const Index *places, const double *weights,
            Index runs, Index entries, Index count) {
    for (Index i = 0; i < runs; i++, places += entries + 1, weights += entries * count)
        for (Index k = 0; k < count; k++) {
            double sum = 0.0;
            for (Index e = 0; e < entries; e++)
                sum += weights[k * entries + e] * source[places[e + 1]];
            target[places[0] + k] = sum;
        }
}

void load(double *target, const Index *rows, Index count, const double *local) {
    for (Index k = 0; k < count; k++) target[k] = local[rows[k]];
}

void store(const double *source, const Index *rows, Index count, double *out) {
    for (Index k = 0; k < count; k++) out[rows[k]] = source[rows[count + k]];
}

void set(double *target, Index count, double value) {
    for (Index k = 0; k < count; k++) target[k] = value;
}
