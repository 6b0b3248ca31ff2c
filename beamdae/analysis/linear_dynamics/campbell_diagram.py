"""Campbell diagrams: how the modes of what turns change with its speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from beamdae.analysis.linear_dynamics.natural_modes import DECAY, Modes, modes
from beamdae.analysis.linear_dynamics.steady_rotation import rotation
from beamdae.errors import BeamdaeError, require_count, require_finite, require_sequence
from beamdae.model_functions import Model

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_MORE = 4


@dataclass(frozen=True, repr=False)
class Campbell:
    """Modes over the speed of rotation.

    Attributes
    ----------
    speeds
        (s,) [rad/s].
    eigenvalues
        (s, k) complex [1/s]: each column is one mode, followed from speed to speed by its shape.
    modes
        The modes at each speed, lowest first, some more than are followed.
    """

    speeds: Array
    eigenvalues: Array
    modes: tuple[Modes, ...] = field(repr=False)

    def __repr__(self) -> str:
        followed, speeds = self.eigenvalues.shape[1], f"{len(self.speeds)} speeds"
        first, last = float(np.min(self.speeds)), float(np.max(self.speeds))
        return f"<Campbell: {followed} modes at {speeds}, {first:g} to {last:g} rad/s>"

    @property
    def frequencies(self) -> Array:
        """(s, k) [Hz], as who turns as well sees them."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the results have to be read with, by speed."""
        return tuple(
            f"at {speed:g} rad/s {sentence}"
            for speed, found in zip(self.speeds, self.modes, strict=True)
            for sentence in found.warnings
        )

    def table(self) -> pd.DataFrame:
        """A row a speed: frequencies of the modes, and their growth rates."""
        import pandas as pd

        columns: dict[str, Any] = {"speed [rad/s]": self.speeds}
        for k, values in enumerate(self.frequencies.T, 1):
            columns[f"mode {k} [Hz]"] = values
        for k, values in enumerate(self.eigenvalues.real.T, 1):
            columns[f"growth rate {k} [1/s]"] = values
        return pd.DataFrame(columns)


def campbell(
    model: Any,
    speeds: Sequence[float],
    n: int = 6,
    center: tuple[float, float] = (0.0, 0.0),
    damping: bool = True,
) -> Campbell:
    """Modes of a mechanism that turns steadily, over its speed; see `rotation` and `modes`.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    speeds
        Angular speeds [rad/s], in the order modes are followed through.
    n
        How many modes.
    center
        The point of the drawing everything turns about [m].
    damping
        See `modes`.

    Raises
    ------
    BeamdaeError
        If there is no steady rotation at one of the speeds.
    """
    given = require_sequence("campbell", "speeds", speeds, "a list of speeds [rad/s]")
    values = [require_finite("campbell", "speeds", speed) for speed in given]
    if not values:
        raise BeamdaeError("campbell: speeds must hold at least one speed [rad/s].")
    wanted = require_count("campbell", "n", n)
    if isinstance(model, Model):
        model = model()
    # With a few more than are asked for none is lost where modes cross.
    found = [modes(model, rotation(speed, center), wanted + _MORE, damping) for speed in values]
    order = np.arange(min(wanted, *map(len, found)))
    rows = [found[0].eigenvalues[order]]
    for before, after in pairwise(found):
        # Those most alike; of a vibration that parts into growth and decay the growth.
        preferred = np.where(np.array(after.kinds) == DECAY, 0.5, 1.0)
        _, order = linear_sum_assignment(-preferred * before.mac(after)[order])
        rows.append(after.eigenvalues[order])
    return Campbell(np.array(values), np.array(rows), tuple(found))
