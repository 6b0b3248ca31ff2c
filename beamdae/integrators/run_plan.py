"""The way of a run: its smooth intervals, its consistent start, and how far things move on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.natural_frequencies import Mode, fastest_modes
from beamdae.equations.singular_laws import require_no_pole
from beamdae.equations.starts.consistent_start import Starter
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.compiled_run import Matrix
from beamdae.integrators.limits import require_few

Array = np.ndarray

# Breakpoints that differ from each other or from an end by less, relative to the times of the run,
# are the same time rounded twice.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Route:
    """The smooth intervals (start, end) [s] of a run, its consistent start, and its amplitudes.

    Attributes
    ----------
    fastest_modes
        The fastest natural mode of each body at the start, found when first asked for.
    amplitudes
        How far the parts move, where a scout has seen it.
    matrices
        Those that were factorized on the way, by method: pivots of a scout serve the run after it.
    """

    starter: Starter
    intervals: tuple[tuple[float, float], ...]
    state: State
    fastest_modes: Callable[[], tuple[Mode, ...]]
    amplitudes: Amplitudes | None = None
    matrices: dict[str, Matrix] = field(default_factory=dict, compare=False)

    def matrix(self, method: str, pattern: sp.csc_array) -> Matrix:
        """A matrix of a method, to be factorized as the one of its scout was."""
        self.matrices[method] = found = Matrix.of(pattern, like=self.matrices.get(method))
        return found

    @property
    def equations(self) -> EquationsOfMotion:
        """What is integrated."""
        return self.starter.equations

    @property
    def time(self) -> Array:
        """(t, branch) of the start."""
        return np.array([self.intervals[0][0], branch_of(*self.intervals[0])])

    @property
    def scales(self) -> Array:
        """Natural size of each coordinate [m or rad]: of its motion, or else of its mechanism."""
        if self.amplitudes is not None:
            return self.amplitudes.scales
        given = self.equations.scales
        return self.equations.position_scales if given is None else given

    @property
    def duration(self) -> float:
        """Length of the run [s]."""
        return self.intervals[-1][1] - self.intervals[0][0]

    def longest_step(self, part: str, max_step: float | None) -> float:
        """Longest step [s], `max_step` if that is set: no step passes over what the laws do.

        A twentieth of the run, and a quarter of the time scale of the laws.

        Raises
        ------
        BeamdaeError
            Naming the integrator `part`, if a run of such steps would not end.
        """
        if max_step is not None:
            require_few(part, "max_step", max_step, self.duration)
            return max_step
        scale, share = self.equations.time_scale, self.duration / 20.0
        if scale is None:
            return share
        why = "the longest step, a quarter of the time scale of the laws,"
        require_few(part, why, scale / 4.0, self.duration)
        return min(share, scale / 4.0)


def plan(equations: EquationsOfMotion, times: Array) -> Route:
    """The intervals between the breakpoints inside the run, and its consistent start.

    Raises
    ------
    BeamdaeError
        If the model has no consistent start, or a law becomes infinite.
    """
    start, end = float(times[0]), float(times[-1])
    intervals = tuple(pairwise((start, *ends_of(equations.breakpoints, start, end))))
    require_no_pole(equations.laws, intervals)
    starter = Starter(equations)
    starter.require_inertia()
    first = np.array([start, branch_of(*intervals[0])])
    state = starter.state(first, equations.q0, equations.v0)
    # A scout and the run after it ask for the same ones.
    return Route(starter, intervals, state, cache(partial(fastest_modes, starter, first, state)))


def ends_of(breakpoints: Sequence[float], start: float, end: float) -> tuple[float, ...]:
    """Where the smooth intervals of a run end [s]."""
    apart = _ROUNDING * max(abs(start), abs(end))
    inner: list[float] = []
    for b in breakpoints:
        if b - (inner or [start])[-1] > apart and end - b > apart:
            inner.append(b)
    return (*inner, end)


def branch_of(start: float, end: float) -> float:
    """A time [s] inside an interval, by which laws choose their piece."""
    return 0.5 * (start + end)
