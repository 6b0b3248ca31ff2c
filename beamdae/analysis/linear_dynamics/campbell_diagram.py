"""Campbell diagram: natural frequencies and growth rates as functions of the rotation speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from beamdae import deferred
from beamdae.analysis.eigenproblems.eigensolution import DECAY
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compute_modes
from beamdae.errors import (
    BeamdaeError,
    require_count,
    require_finite,
    require_sequence,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.model_functions import Model
from beamdae.model_parameters import conversion_factor
from beamdae.parts.rotation import rotation
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasPage, HasTable, Plot

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Excitations per revolution that are compared with the frequencies by default.
SPEED_MULTIPLES = (1, 2, 3, 4)
# Number of additional modes computed at each speed, so that no mode is lost where frequencies
# cross.
_EXTRA_MODES = 4
# Weight of decaying modes in the assignment: if a vibration splits into a growing and a decaying
# mode, the diagram follows the growing mode.
_DECAY_WEIGHT = 0.5
# Modes are computed at half the interval between two speeds if a mode at one speed has a smaller
# MAC with each mode at the other one, up to this number of times.
_MIN_MAC = 0.5
_MAX_HALVINGS = 5
# Relative error of the speeds of resonances.
_SPEED_TOLERANCE = 1e-11
# A larger deviation of the frequency, relative to that of the excitation, is a change from one mode
# to another.
_MAX_DEVIATION = 1e-3
# Modes with a smaller one at two speeds have the frequency of the excitation at each speed.
_EQUAL = 1e-9


class _Stop(NamedTuple):
    """Speed through which modes are followed.

    Attributes
    ----------
    speed
        Rotation speed [rad/s].
    modes, order
        Modes at this speed, and the indices (k,) of the followed modes.
    lost
        For each mode (k,), whether its shape differs too much from that at the stop before.
    """

    speed: float
    modes: Modes
    order: Array
    lost: Array


@read_only_data
@dataclass(frozen=True, repr=False)
class Campbell(HasTable, HasPage):
    """Modes as functions of the rotation speed; see `campbell`.

    Attributes
    ----------
    speeds
        Rotation speeds [rad/s], (s,), ascending.
    eigenvalues
        Complex eigenvalues [1/s], (s, k); each column follows one mode from speed to speed by its
        shape.
    modes
        Modes computed at each speed, (s,), including modes that are not in `eigenvalues`.
    center
        Center of rotation (x, y) in the reference configuration [m].
    damping
        False for undamped modes.
    multiples
        Numbers of excitations per revolution (engine orders) whose resonances are shown.
    speed_unit
        Unit of the speeds in pictures and pages, such as "rpm".
    """

    speeds: Array
    eigenvalues: Array
    modes: tuple[Modes, ...] = field(repr=False)
    center: tuple[float, float] = (0.0, 0.0)
    damping: bool = True
    multiples: tuple[int, ...] = SPEED_MULTIPLES
    _stops: tuple[_Stop, ...] = field(default=(), repr=False)
    speed_unit: str = "rad/s"

    def __repr__(self) -> str:
        count, speeds = self.eigenvalues.shape[1], f"{len(self.speeds)} speeds"
        first, last = float(np.min(self.speeds)), float(np.max(self.speeds))
        return f"<Campbell: {count} modes at {speeds}, {first:g} to {last:g} rad/s>"

    @property
    def frequencies(self) -> Array:
        """Frequencies in the rotating frame [Hz], (s, k)."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def speed_factor(self) -> float:
        """Number of rad/s in a `speed_unit`."""
        return float(conversion_factor(self.speed_unit, "rad/s") or 1.0)

    @property
    def _fastest(self) -> int:
        return int(np.argmax(np.abs(self.speeds)))

    @property
    def errors(self) -> Any:
        """Errors of the eigenvalues at the fastest rotation, see `Modes.errors`."""
        return self.modes[self._fastest].errors

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the model and the modes at the fastest rotation; modes not followed."""
        sentences = self.modes[self._fastest].warnings
        built = self.modes[0]._linearization.equations.build_warnings
        unit, factor = self.speed_unit, self.speed_factor
        place = f"at {self.speeds[self._fastest] / factor:g} {unit}, "
        lost = [
            f"mode {k + 1} was not followed from {before.speed / factor:g} to "
            f"{after.speed / factor:g} {unit}, where its shape changes, and its resonances there "
            "are not listed; add speeds"
            for before, after in pairwise(self._stops)
            for k in np.flatnonzero(after.lost).tolist()
        ]
        return (*(x if x in built else place + x for x in sentences), *lost)

    def plot(self) -> Plot:
        """Plot natural frequencies and multiples of the rotation speed over the rotation speed.

        Circles mark the resonances where they are equal, see `resonances`. The picture ends above
        the first mode beyond the multiples; a note names modes of higher frequencies.
        """
        return deferred.module("report.result_displays").draw_result(self)

    def table(self) -> pd.DataFrame:
        """Return a table with one row per speed [rad/s]: frequencies [Hz], growth rates [1/s]."""
        import pandas as pd

        columns: dict[str, Any] = {"speed [rad/s]": self.speeds}
        for k, values in enumerate(self.frequencies.T, 1):
            columns[f"mode {k} [Hz]"] = values
        for k, values in enumerate(self.eigenvalues.real.T, 1):
            columns[f"growth rate {k} [1/s]"] = values
        return pd.DataFrame(columns)

    def resonances(self, multiples: Sequence[int] | None = None) -> pd.DataFrame:
        """Return the nonzero speeds at which frequencies are multiples of the rotation speed.

        Modes are computed at further speeds until the resonances are accurate to a relative error
        below 1e-6. Resonances where a frequency passes a multiple of the speed and returns
        between two successive speeds of the diagram are not found. Where a mode was not followed,
        its resonances are not listed; see `warnings`.

        Parameters
        ----------
        multiples
            Numbers of excitations per revolution, each at least 1. Defaults to those of the
            diagram.

        Returns
        -------
        pandas.DataFrame
            Columns "speed [rad/s]", "frequency [Hz]", "mode" (from 1, as in `table`) and
            "multiple", in ascending order of the magnitude of the speed.

        Raises
        ------
        BeamdaeError
            If `multiples` contains anything but whole numbers of at least 1.
        """
        import pandas as pd

        diagram = self
        if multiples is not None:
            diagram = replace(self, multiples=_require_multiples("Campbell", multiples))
        names = ["speed [rad/s]", "frequency [Hz]", "mode", "multiple"]
        return pd.DataFrame(list(diagram._resonances), columns=names)

    @cached_property
    def _resonances(self) -> tuple[tuple[float, float, int, int], ...]:
        """Rows of `resonances`."""
        known = {x.speed: x.modes for x in self._stops}
        equations, count = self.modes[0].equations, max(map(len, self.modes))

        def solve(speed: float) -> Modes:
            if speed not in known:
                about = rotation(speed, self.center)
                known[speed] = compute_modes(equations, about, count, self.damping)
            return known[speed]

        rows = [
            (speed, multiple * abs(speed) / (2.0 * np.pi), mode + 1, multiple)
            for before, after in pairwise(self._stops)
            for mode in np.flatnonzero(~after.lost).tolist()
            for multiple in self.multiples
            for speed in _find_resonances(solve, (before, after), mode, multiple)
        ]
        return tuple(sorted(rows, key=lambda row: abs(row[0])))


def _find_resonances(
    solve: Callable[[float], Modes], stops: tuple[_Stop, _Stop], mode: int, multiple: int
) -> Iterator[float]:
    """Yield the speeds between two stops at which a frequency is a multiple of the speed.

    The mode is followed by its shape.
    """

    def difference(speed: float) -> float:
        modes = solve(speed)
        mac = np.sum([x.modes.mac(modes)[x.order[mode]] for x in stops], axis=0)
        return float(modes.eigenvalues[int(np.argmax(mac))].imag) - multiple * abs(speed)

    # At rest, whirls in both directions have the same frequency, and any shape.
    first, last = (x.speed for x in stops)
    speeds = np.unique(np.clip([first, 0.0, last], first, last))
    for pair in pairwise(speeds.tolist()):
        values, excitations = np.array([difference(x) for x in pair]), multiple * np.abs(pair)
        if np.prod(values) >= 0.0 or np.all(np.abs(values) <= _EQUAL * excitations):
            continue
        speed = scipy.optimize.brentq(difference, *pair, rtol=_SPEED_TOLERANCE)
        # At rest, motions without stiffness have the frequency of an excitation: zero.
        if abs(difference(speed)) < _MAX_DEVIATION * multiple * abs(speed):
            yield float(speed)


@interruptible
def campbell(
    model: Any,
    speeds: Sequence[float],
    n: int = 6,
    center: tuple[float, float] = (0.0, 0.0),
    damping: bool = True,
    multiples: Sequence[int] = SPEED_MULTIPLES,
) -> Campbell:
    """Compute the Campbell diagram of a mechanism in steady rotation.

    Modes at successive speeds are matched by the modal assurance criterion. See `rotation` for the
    state and `modes` for the eigenvalues.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    speeds
        Rotation speeds [rad/s], in any order; modes are followed in ascending order.
    n
        Number of modes to follow: those with the smallest |eigenvalue| at the lowest speed.
    center
        Center of rotation (x, y) in the reference configuration [m].
    damping
        Set False for undamped modes; see `modes`.
    multiples
        Numbers of excitations per revolution (engine orders), which pictures, pages and
        `Campbell.resonances` show; each at least 1.

    Returns
    -------
    Campbell
        Eigenvalues (s, k) of at most `n` modes at each of the s speeds.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, there is no steady rotation at one of the speeds, or the modes
        cannot be computed (see `modes`).
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        For each warning that `modes` issues about the fastest rotation, and for modes that were not
        followed.

    Examples
    --------
    A mass on an isotropic bearing: in the rotating frame, the whirl frequency of 10 rad/s splits
    into 10 - speed and 10 + speed.

    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> rotor = mech.add(bd.RigidBody("rotor", 2.0, 0.1, center=(0.0, 0.0)))
    >>> ends = mech.ground.at(0.0, 0.0), rotor.at(0.0, 0.0)
    >>> bearing = mech.add(bd.Bushing("bearing", *ends, kx=200.0, ky=200.0, ktheta=0.0))
    >>> diagram = bd.campbell(mech, speeds=[0.0, 3.0], n=3)
    >>> [round(float(rate), 6) for rate in sorted(diagram.eigenvalues[-1].imag)]
    [0.0, 7.0, 13.0]
    """
    values = [
        require_finite("campbell", "speeds", speed)
        for speed in require_sequence("campbell", "speeds", speeds, "a list of speeds [rad/s]")
    ]
    if not values:
        raise BeamdaeError("campbell: speeds must contain at least one value [rad/s], got none.")
    values = np.unique(values).tolist()
    count = require_count("campbell", "n", n)
    numbers = _require_multiples("campbell", multiples)
    if isinstance(model, Model):
        model = model()

    # Errors change little with the speed.
    fastest = max(values, key=abs)

    def solve(speed: float) -> Modes:
        about, total = rotation(speed, center), count + _EXTRA_MODES
        assessed = count * (speed == fastest)
        return compute_modes(model, about, total, damping, assessed=assessed, has_accuracy=False)

    all_modes = [solve(speed) for speed in values]
    order = np.arange(min(count, *map(len, all_modes)))
    stops = [_Stop(values[0], all_modes[0], order, np.zeros(len(order), bool))]
    rows = [all_modes[0].eigenvalues[order]]
    for speed, after in zip(values[1:], all_modes[1:], strict=True):
        stops += _follow(solve, stops[-1], speed, after)
        rows.append(after.eigenvalues[stops[-1].order])
    place = rotation(0.0, center).center
    diagram = Campbell(
        np.array(values), np.array(rows), tuple(all_modes), place, damping, numbers, tuple(stops)
    )
    if not warnings_are_ignored():
        built = diagram.modes[0]._linearization.equations.build_warnings
        warn_of_result(diagram.warnings, built)
    return diagram


def _require_multiples(caller: str, multiples: Any) -> tuple[int, ...]:
    values = require_sequence(caller, "multiples", multiples, "a list of numbers")
    return tuple(require_count(caller, "multiples", k) for k in values)


def _follow(
    solve: Callable[[float], Modes],
    start: _Stop,
    speed: float,
    after: Modes,
    halvings: int = _MAX_HALVINGS,
) -> list[_Stop]:
    """Follow modes to a speed, at which the modes are `after`; return the stops after `start`.

    If shapes differ much, the modes are followed through the speed in the middle.
    """
    mac = start.modes.mac(after)[start.order]
    decayed, decays = (np.array(x.kinds) == DECAY for x in (start.modes, after))
    weights = np.where(decays & ~decayed[start.order, None], _DECAY_WEIGHT, 1.0)
    rows, matches = scipy.optimize.linear_sum_assignment(-weights * mac)
    lost = mac[rows, matches] < _MIN_MAC
    if halvings and lost.any():
        middle = 0.5 * (start.speed + speed)
        at_middle = solve(middle)
        if len(at_middle) >= len(start.order):
            stops = _follow(solve, start, middle, at_middle, halvings - 1)
            return [*stops, *_follow(solve, stops[-1], speed, after, halvings - 1)]
    return [_Stop(speed, after, matches, lost)]
