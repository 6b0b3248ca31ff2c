"""Modes of the linearized equations: l^2 M x + l D x + K x + H mu = 0, J x + l V x - C mu = 0.

Symmetric undamped problems are solved for squared frequencies, all others as quadratic eigenvalue
problems.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations, quadratic_forms
from beamdae.analysis.eigenproblems.slow_motions import (
    MasslessError,
    solve_damped,
    solve_undamped,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.errors import BeamdaeError
from beamdae.linear.blas_threads import single_threaded

Array = np.ndarray

# Kinds of modes.
RIGID, VIBRATION, DECAY, UNSTABLE = "free motion", "vibration", "decay", "unstable"
# Real parts below this fraction of the eigenvalue are rounding errors.
_GROWTH_TOLERANCE = 1e-9
# Sizes that differ by less than this fraction are equal but for rounding.
EQUAL_SIZE_TOLERANCE = 1e-6


class EigenSolution(NamedTuple):
    """Eigenvalues and mode shapes, in ascending order of |eigenvalue|.

    Attributes
    ----------
    values
        Eigenvalues [1/s], (k,). Each conjugate pair is represented by the eigenvalue with positive
        imaginary part. For symmetric undamped problems, a growing and a decaying mode of the same
        shape are represented by the growing one.
    shapes
        Mode shapes, (n, k), with x^H M x = 1.
    """

    values: Array
    shapes: Array


@single_threaded
def solve_eigenproblem(
    lin: LinearizedEquations, count: int | None, damped: bool = True
) -> EigenSolution:
    """Return the modes with the smallest |eigenvalue|: at most `count`, or all if it is None.

    If `damped` is False, the symmetric parts of M and K are used, and damping is ignored.
    """
    e = lin.equations
    if len(e.states) and not damped:
        raise BeamdaeError(
            "modes: undamped modes are not supported with states such as "
            f"{e.q_names[e.states[0]]}; use damping=True, or remove the states."
        )
    if not damped or lin.is_conservative:
        squares, shapes = solve_undamped(lin, count)
        return _normalize(lin, np.sqrt(-squares + 0j), shapes.astype(complex), count)
    return _normalize(lin, *solve_damped(lin, count), count)


def _normalize(
    lin: LinearizedEquations, values: Array, shapes: Array, count: int | None
) -> EigenSolution:
    """Return the modes with the smallest |eigenvalue|, sorted and scaled to x^H M x = 1.

    The phase of each shape is chosen so that the shape is as real as possible.
    """
    mass = lin.tangent.mass
    order = np.argsort(np.abs(values), kind="stable")[:count]
    values, shapes = values[order], shapes[:, order]
    size = np.sqrt(np.abs(quadratic_forms(mass, shapes)))
    phase = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", shapes, mass @ shapes)))
    shapes = shapes * phase / np.where(size > 0.0, size, 1.0)
    # The sign is chosen so that the first of the largest coordinates is positive: those of
    # symmetric shapes and of joints are equal up to rounding.
    if shapes.size:
        relative = shapes.real / lin.equations.position_scales[:, None]
        largest = relative[locate_largest(relative), np.arange(shapes.shape[1])]
        shapes = shapes * np.where(largest < 0.0, -1.0, 1.0)
    return EigenSolution(values, shapes)


def locate_largest(columns: Array) -> Array:
    """Return the row of the largest absolute value of each column, (k,) for (n, k).

    It is the first of those that are equal up to rounding.
    """
    sizes = np.abs(columns)
    is_largest = sizes >= (1.0 - EQUAL_SIZE_TOLERANCE) * np.max(sizes, axis=0)
    return np.argmax(is_largest, axis=0)


def classify_modes(values: Array) -> tuple[str, ...]:
    """Return the kind of the mode of each eigenvalue."""
    kinds = np.where(values.imag > 0.0, VIBRATION, DECAY)
    kinds = np.where(values.real > _GROWTH_TOLERANCE * np.abs(values), UNSTABLE, kinds)
    return tuple(np.where(values == 0.0, RIGID, kinds).tolist())


class FrequencyRange(NamedTuple):
    """Range of the undamped natural frequencies about a state.

    Attributes
    ----------
    lowest, highest
        Lowest and highest natural frequency [Hz]; None if nothing vibrates.
    damping_ratio
        Damping ratio of the mode with the highest frequency [-]; 0 if nothing vibrates.
    growth
        Clause on the fastest growth from the start, or "".
    massless
        Name of a coordinate without inertia, because of which nothing else is known; or "".
    """

    lowest: float | None = None
    highest: float | None = None
    damping_ratio: float = 0.0
    growth: str = ""
    massless: str = ""


def compute_frequency_range(e: EquationsOfMotion, time: Array, state: State) -> FrequencyRange:
    """Return the range of undamped natural frequencies about a consistent state.

    Constraints must be independent. First-order states are constant and do not count as free
    motions. The computing time grows with the cube of the number of coordinates.
    """
    tangent = compute_tangent(e, time, state)
    try:
        squares, shapes = solve_undamped(LinearizedEquations(e, tangent), None)
    except MasslessError as error:
        return FrequencyRange(massless=error.coordinate)
    rates, growth = np.sqrt(squares[squares > 0.0]), ""
    if np.any(squares < 0.0):
        rate = np.sqrt(np.max(-squares))
        growth = f"a motion grows from the start at a rate of {rate:.3g} 1/s"
    if not len(rates):
        return FrequencyRange(growth=growth)
    fastest = shapes[:, -1]
    ratio = float(fastest @ (tangent.damping @ fastest) / (2.0 * rates[-1]))
    lowest, highest = (rates[[0, -1]] / (2.0 * np.pi)).tolist()
    return FrequencyRange(lowest, highest, ratio, growth)
