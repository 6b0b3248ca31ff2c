"""Control of equilibrium paths by an observed position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.analysis.continuation.engine import Row
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.results.columns import remove_unit
from beamdae.results.equilibrium import static_headers

Array = np.ndarray


@dataclass(frozen=True)
class PrescribedColumn:
    """Control by an observed column that is a function of positions.

    Attributes
    ----------
    equations
        Equations with the observable.
    observable, column
        Observable, and index of its column.
    time
        (t, branch).
    """

    equations: EquationsOfMotion
    observable: Observable
    column: int
    time: Array

    @classmethod
    def from_name(cls, equations: EquationsOfMotion, name: str, time: Array) -> PrescribedColumn:
        """Return the control for the column `name`, which may include the unit.

        Raises
        ------
        BeamdaeError
            If there is no such column, or it depends on velocities or reactions.
        """
        positions: dict[str, tuple[Observable, int]] = {}
        without_rates = set(static_headers(equations))
        for observable in equations.observables:
            for k, header in enumerate(observable.headers):
                if header in without_rates and observable.rows.stop == observable.rows.start:
                    positions[header] = positions[remove_unit(header)] = (observable, k)
        if name not in positions:
            names = ", ".join(x for x in positions if not x.endswith("]")) or "none"
            raise BeamdaeError(
                "equilibrium: to must name an observed position, got "
                f"{short_repr(name)}{suggest(name, positions)}; observe this position, or name an "
                f"observed one (observed: {names})."
            )
        switching = equations.configurations
        inactive = frozenset() if switching is None else switching.initially_inactive
        return cls(equations.without_loads_of(inactive), *positions[name], time)

    @cached_property
    def _position_derivative(self):  # type: ignore[no-untyped-def]
        return self.observable.function.derivative(1)

    def __call__(self, x: Array, p: float) -> Row:
        """Return the column, in its unit, at x = (q, ...) as a control of the curve engine."""
        o, gradient = self.observable, np.zeros(len(x) + 1)
        local = np.asarray(o.operator @ x[: self.equations.n])[None]
        numbers, no_reactions = self.equations.p[o.data], np.zeros((1, 0))
        arguments = self.time[None], local, np.zeros_like(local), numbers, no_reactions
        rows = self._position_derivative(*arguments).reshape(-1, len(o.columns))
        gradient[: self.equations.n] = o.operator.T @ rows[:, self.column]
        return Row(float(o.function(*arguments)[0, self.column]), gradient)
