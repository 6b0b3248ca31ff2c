/* Times of steps of an exported model; usage: benchmark STEPS. */

#define _POSIX_C_SOURCE 199309L

#include "model.h"
#include "stepper.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Time limit of the measurement [s]. */
#define MAX_DURATION 30.0
/* Iterations of the steps to which the timed steps are compared; they converge to rounding. */
#define REFERENCE_ITERATIONS 6
/* Change of inputs, relative to the larger of their value and 1: without effect on the motion. */
#define INPUT_CHANGE 1e-12
/* Outputs with a smaller range, in SI units, are zero. */
#define MIN_RANGE 1e-9

#if defined(_WIN32)
#include <windows.h>
static double now(void) {
    LARGE_INTEGER count, frequency;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&frequency);
    return (double)count.QuadPart / (double)frequency.QuadPart;
}
/* The processor time of Windows has a resolution of 16 ms. */
static double processor_time(void) { return now(); }
#else
static double read_clock(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
static double now(void) { return read_clock(CLOCK_MONOTONIC); }
static double processor_time(void) { return read_clock(CLOCK_THREAD_CPUTIME_ID); }
#endif

static int compare(const void *one, const void *other) {
    const double x = *(const double *)one, y = *(const double *)other;
    return (x > y) - (x < y);
}

static int fail(const char *message) {
    printf("%s\n", message);
    return 1;
}

int main(int count, char **arguments) {
    const long steps = count > 1 ? strtol(arguments[1], NULL, 10) : 100000;
    Instance *timed = instance_create(), *exact = instance_create();
    double *times = malloc(sizeof(double) * (size_t)(steps > 0 ? steps : 1));
    double *low = malloc(sizeof(double) * (3 * (size_t)model.n_outputs + model.n_inputs + 1));
    double *high = low ? low + model.n_outputs : NULL, *errors = high ? high + model.n_outputs : NULL;
    if (!timed || !exact || !times || !low || steps < 1) return fail("out of memory");
    instance_fix_iterations(exact, REFERENCE_ITERATIONS);
    for (Index k = 0; k < model.n_outputs; k++) low[k] = INFINITY, high[k] = -INFINITY, errors[k] = 0;
    if (instance_initialize(timed) || instance_initialize(exact))
        return fail(instance_message(timed));
    double *values = errors + model.n_outputs;
    for (Index i = 0; i < model.n_inputs; i++) values[i] = instance_value(timed, i);
    long done = 0, k = 0;
    int is_compared = 1;
    double work = 0.0; /* largest processor time of a step */
    const double began = now();
    for (; done < steps && now() - began < MAX_DURATION; done++, k++) {
        const double end = (double)(k + 1) * model.step;
        if (k > 0 && end > model.duration) { /* again from the start */
            instance_reset(timed);
            instance_initialize(timed);
            instance_reset(exact);
            instance_initialize(exact);
            k = -1, done--;
            continue;
        }
        /* Importing tools change inputs at communication points. */
        for (Index i = 0; i < model.n_inputs; i++) {
            const double value = values[i];
            const double change = INPUT_CHANGE * (double)(k % 2) * fmax(fabs(value), 1.0);
            instance_set_value(timed, i, value + change);
            instance_set_value(exact, i, value + change);
        }
        const double start = now();
        const double used = processor_time(); /* within the time of the clock */
        if (instance_advance(timed, end)) return fail(instance_message(timed));
        const double *outputs = instance_outputs(timed);
        work = fmax(work, processor_time() - used);
        times[done] = now() - start;
        /* A fixed number of iterations may diverge where the timed steps converge. */
        if (is_compared && instance_advance(exact, end)) is_compared = 0;
        if (!is_compared) continue;
        const double *right = instance_outputs(exact);
        for (Index i = 0; i < model.n_outputs; i++) {
            low[i] = fmin(low[i], right[i]);
            high[i] = fmax(high[i], right[i]);
            errors[i] = fmax(errors[i], fabs(outputs[i] - right[i]));
        }
    }
    double error = 0.0;
    for (Index i = 0; i < model.n_outputs; i++)
        if (high[i] - low[i] > MIN_RANGE) error = fmax(error, errors[i] / (high[i] - low[i]));
    qsort(times, (size_t)done, sizeof(double), compare);
    char text[32];
    snprintf(text, sizeof(text), is_compared ? "%.3e" : "NaN", error);
    printf("{\"median\": %.3e, \"percentile\": %.3e, \"worst\": %.3e, \"processor\": %.3e, \"steps\": %ld, "
           "\"error\": %s, \"row_exchanges\": %lu}\n",
           times[done / 2], times[(long)(0.999 * (double)(done - 1))], times[done - 1], work, done, text,
           instance_pivot_searches(timed));
    instance_free(timed);
    instance_free(exact);
    free(times);
    free(low);
    return 0;
}
