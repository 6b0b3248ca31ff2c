"""Campbell diagram: natural frequencies and growth rates as functions of the rotation speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from beamdae.analysis.eigenproblems.eigensolution import DECAY
from beamdae.analysis.linear_dynamics.natural_modes import Modes, modes
from beamdae.errors import BeamdaeError, require_count, require_finite, require_sequence
from beamdae.interrupts import interruptible
from beamdae.model_functions import Model
from beamdae.parts.rotation import rotation
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasPage, HasTable, Plot, load_views

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


@read_only_data
@dataclass(frozen=True, repr=False)
class Campbell(HasTable, HasPage):
    """Modes as functions of the rotation speed; see `campbell`.

    Attributes
    ----------
    speeds
        Rotation speeds [rad/s], (s,).
    eigenvalues
        Complex eigenvalues [1/s], (s, k); each column follows one mode from speed to speed by its
        shape.
    modes
        Modes computed at each speed, (s,), including modes that are not in `eigenvalues`.
    """

    speeds: Array
    eigenvalues: Array
    modes: tuple[Modes, ...] = field(repr=False)

    def __repr__(self) -> str:
        count, speeds = self.eigenvalues.shape[1], f"{len(self.speeds)} speeds"
        first, last = float(np.min(self.speeds)), float(np.max(self.speeds))
        return f"<Campbell: {count} modes at {speeds}, {first:g} to {last:g} rad/s>"

    @property
    def frequencies(self) -> Array:
        """Frequencies in the rotating frame [Hz], (s, k)."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the model and about the modes at each speed."""
        # Warnings of the model do not depend on the speed.
        sets = [set(at_speed.warnings) for at_speed in self.modes]
        common = set.intersection(*sets) if len(sets) > 1 else set()
        first = [x for at_speed in self.modes[:1] for x in at_speed.warnings if x in common]
        return (
            *first,
            *(
                f"at {speed:g} rad/s, {sentence}"
                for speed, at_speed in zip(self.speeds, self.modes, strict=True)
                for sentence in at_speed.warnings
                if sentence not in common
            ),
        )

    def plot(self) -> Plot:
        """Plot the frequencies over the rotation speed, see `beamdae.draw_campbell`."""
        return load_views().draw_campbell(self)

    def table(self) -> pd.DataFrame:
        """Return a table with one row per speed [rad/s]: frequencies [Hz], growth rates [1/s]."""
        import pandas as pd

        columns: dict[str, Any] = {"speed [rad/s]": self.speeds}
        for k, values in enumerate(self.frequencies.T, 1):
            columns[f"mode {k} [Hz]"] = values
        for k, values in enumerate(self.eigenvalues.real.T, 1):
            columns[f"growth rate {k} [1/s]"] = values
        return pd.DataFrame(columns)

    def resonances(self, multiples: Sequence[int] = SPEED_MULTIPLES) -> pd.DataFrame:
        """Return the nonzero speeds at which frequencies are multiples of the rotation speed.

        Between successive speeds, the square of a frequency is interpolated linearly over the
        square of the speed, as centrifugal stiffening changes it (R. Southwell), or the frequency
        over the speed, as in whirling seen from the rotating frame: whichever reproduces the
        frequencies of a mode at its inner speeds better. Where a mode changes its shape, only
        closer speeds find its resonances accurately.

        Parameters
        ----------
        multiples
            Numbers of excitations per revolution, each at least 1.

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

        numbers = [
            require_count("Campbell", "multiples", k)
            for k in require_sequence("Campbell", "multiples", multiples, "a list of numbers")
        ]
        order = np.argsort(self.speeds)
        speeds, rates = self.speeds[order], 2.0 * np.pi * self.frequencies[order]
        squares = speeds * np.abs(speeds)
        rows = []
        for mode, values in enumerate(rates.T, 1):
            by_squares = _error_at_inner_points(squares, values**2, np.sqrt)
            is_squared = by_squares <= _error_at_inner_points(speeds, values, np.asarray)
            for multiple in numbers:
                if is_squared:
                    zeros = _find_zeros(squares, values**2 - multiple**2 * np.abs(squares))
                    zeros = np.copysign(np.sqrt(np.abs(zeros)), zeros)
                else:
                    zeros = _find_zeros(speeds, values - multiple * np.abs(speeds))
                rows += [
                    (speed, multiple * abs(speed) / (2.0 * np.pi), mode, multiple)
                    for speed in zeros.tolist()
                    # At rest, motions without stiffness have the frequency of an excitation: zero.
                    if speed != 0.0
                ]
        rows.sort(key=lambda row: abs(row[0]))
        names = ["speed [rad/s]", "frequency [Hz]", "mode", "multiple"]
        return pd.DataFrame(rows, columns=names)


def _find_zeros(x: Array, y: Array) -> Array:
    """Return the x at which the linear interpolation between the points (x, y) changes sign."""
    (left,) = np.nonzero((y[:-1] < 0.0) != (y[1:] < 0.0))
    shares = y[left] / (y[left] - y[left + 1])
    return x[left] + shares * np.diff(x)[left]


def _error_at_inner_points(x: Array, y: Array, restore: Callable[[Array], Array]) -> float:
    """Return the largest error of `restore(y)` at points interpolated between their neighbors."""
    spans = x[2:] - x[:-2]
    shares = (x[1:-1] - x[:-2]) / np.where(spans > 0.0, spans, 1.0)
    interpolated = (1.0 - shares) * y[:-2] + shares * y[2:]
    return float(np.max(np.abs(restore(interpolated) - restore(y[1:-1])), initial=0.0))


@interruptible
def campbell(
    model: Any,
    speeds: Sequence[float],
    n: int = 6,
    center: tuple[float, float] = (0.0, 0.0),
    damping: bool = True,
) -> Campbell:
    """Compute the Campbell diagram of a mechanism in steady rotation.

    Modes at successive speeds are matched by the modal assurance criterion. See `rotation` for the
    state and `modes` for the eigenvalues.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    speeds
        Rotation speeds [rad/s]; modes are followed in this order.
    n
        Number of modes to follow: those with the smallest |eigenvalue| at the first speed.
    center
        Center of rotation (x, y) in the reference configuration [m].
    damping
        Set False for undamped modes; see `modes`.

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
    count = require_count("campbell", "n", n)
    if isinstance(model, Model):
        model = model()
    all_modes = [
        modes(model, rotation(speed, center), count + _EXTRA_MODES, damping) for speed in values
    ]
    order = np.arange(min(count, *map(len, all_modes)))
    rows = [all_modes[0].eigenvalues[order]]
    for before, after in pairwise(all_modes):
        weights = np.where(np.array(after.kinds) == DECAY, _DECAY_WEIGHT, 1.0)
        _, order = linear_sum_assignment(-weights * before.mac(after)[order])
        rows.append(after.eigenvalues[order])
    return Campbell(np.array(values), np.array(rows), tuple(all_modes))
