"""Warnings about control loops that grow exponentially until the end of a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Intervals of the second half of a run in which changes of values are compared. The largest changes
# in equal windows are the envelope of a vibration.
_INTERVALS = 256
# Numbers of windows: many for fast growth, few for slow vibrations.
_WINDOW_COUNTS = (8, 4)
# Growth of the envelope in the second half of a run. Values that increase with the third power of
# time, such as integrals of positions at constant acceleration, grow by a factor of 4, or of 14
# from 0.4 of the run on.
_MIN_GROWTH = 30.0
# Bounds of the exponents of growth from window to window, relative to their mean. They are 1 if the
# growth is exponential, and 0.7 to 1.35 for powers of time from 0.4 of the run on.
_LEAST_EXPONENT, _LARGEST_EXPONENT = 0.75, 1.33
# Changes below this fraction of the largest value are rounding errors.
_ROUNDING = 1e-9


def growing_loop_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if a value that a controller holds, or a state, grows exponentially.

    An unstable loop reaches the end of a run if it grows slowly or the run is short. Values that
    increase like ramps, steps and powers of time have no warning.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    rows = _describe_rows(equations)
    if not rows or not trajectory.end > trajectory.start:
        return
    middle = 0.5 * (trajectory.start + trajectory.end)
    times = np.linspace(middle, trajectory.end, _INTERVALS + 1)
    growth = _exponential_growth(trajectory.at(times)[1].q[:, list(rows)])
    k = int(np.argmax(growth))
    if growth[k] > 0.0:
        name, remedy = list(rows.values())[k]
        yield (
            f"{name} grows exponentially, by a factor of {growth[k]:.2g} in the second half of the "
            f"run, so its loop seems to be unstable; check the signs and sizes of its {remedy}."
        )


def _describe_rows(equations: EquationsOfMotion) -> dict[int, tuple[str, str]]:
    """Return name and remedy of the coordinates that controllers hold, and of other states."""
    controllers = {term.controller.name for term in equations.controllers}
    rows = {
        k: (part.name, "gains")
        for part in equations.parts
        if part.is_state and part.name not in controllers
        for k in range(part.rows.start, part.rows.stop)
    }
    for term in equations.controllers:
        for k, drive in enumerate(term.controller.drives):
            name = f"{term.controller.name}: {drive.name}"
            rows[term.rows.start + k] = name, "gains, and every="
    return rows


def _exponential_growth(values: Array) -> Array:
    """Return the growth factor of each column of values (k, size); 0 if not exponential."""
    changes = np.abs(np.diff(values, axis=0))
    rounding = _ROUNDING * np.abs(values).max(axis=0)
    factors = np.zeros(values.shape[1])
    for count in _WINDOW_COUNTS:
        envelope = changes.reshape(count, -1, values.shape[1]).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            exponents = np.diff(np.log(envelope), axis=0)
            mean = exponents.mean(axis=0)
            relative = exponents / mean
            growth = np.exp(count * mean)
        is_uniform = (relative > _LEAST_EXPONENT) & (relative < _LARGEST_EXPONENT)
        is_growing = (growth > _MIN_GROWTH) & is_uniform.all(axis=0)
        is_growing &= (envelope > rounding).all(axis=0)
        factors = np.maximum(factors, np.where(is_growing, growth, 0.0))
    return factors
