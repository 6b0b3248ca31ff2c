"""Time-dependent gravity: weights of parts under an acceleration that follows time laws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.laws import Law
from beamdae.symbolic.formula import FormulaExpression
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local

Array = np.ndarray


def _evaluate_laws(local: Local, *laws: Callable[[SX], SX]) -> list[SX]:
    return [law(local.time) for law in laws]


@dataclass(frozen=True)
class GravityLaws:
    """Time laws of the components of gravity.

    The weight is a load, because time-dependent gravity has no potential.

    Attributes
    ----------
    laws
        Laws of the components (gx, gy) [m/s^2].
    name
        Name of gravity among the loads.
    """

    laws: tuple[Law, Law]
    name: str = "gravity"
    # Keyed by the id of the original kernel and the rows that depend on gravity. The original
    # kernel is stored too, so that Python does not reuse its id.
    _kernels: dict[Any, tuple[ForceKernel, ForceKernel]] = field(default_factory=dict)

    def __deepcopy__(self, memo: Any) -> GravityLaws:
        """Return a copy without kernels, whose ids are those of other kernels in a copy."""
        return GravityLaws(deepcopy(self.laws, memo), self.name)

    def statements(
        self, forces: Callable[[Array], Sequence[ForceStatement]]
    ) -> list[ForceStatement]:
        """Return the forces of a part under time-dependent gravity.

        Parameters
        ----------
        forces
            Function that returns the forces of the part under a constant gravity, an array of shape
            (2,) [m/s^2]. The data of the forces must be affine functions of gravity.
        """
        weightless, unit_x, unit_y = (
            forces(np.array(gravity)) for gravity in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        )
        weights = map(self._weigh, weightless, unit_x, unit_y)
        return [*weightless, *(x for x in weights if x is not None)]

    def _weigh(
        self, weightless: ForceStatement, unit_x: ForceStatement, unit_y: ForceStatement
    ) -> ForceStatement | None:
        """Return the weight, from statements without gravity and under unit gravity."""
        slopes = unit_x.data - weightless.data, unit_y.data - weightless.data
        rows = np.flatnonzero(np.any(slopes[0], axis=1) | np.any(slopes[1], axis=1))
        if not rows.size:
            return None
        key = (id(weightless.kernel), tuple(rows.tolist()))
        if key not in self._kernels:
            self._kernels[key] = weightless.kernel, self._kernel(weightless.kernel, rows)
        law_data = np.repeat(self._expression[1][:, None], weightless.count, axis=1)
        data = np.concatenate([weightless.data, slopes[0][rows], slopes[1][rows], law_data])
        return ForceStatement(weightless.part, self._kernels[key][1], weightless.pieces, data)

    @property
    def _expression(self) -> tuple[FormulaExpression, Array]:
        """Expression of the values of the laws, and the numbers in it."""
        return FormulaExpression.of(_evaluate_laws, [law.formula for law in self.laws])

    def _kernel(self, kernel: ForceKernel, rows: Array) -> ForceKernel:
        """Return the kernel of the weight under the laws, in proportion to which forces change.

        Only `rows` of the data depend on gravity. The data of the new kernel are the data without
        gravity, the derivatives of `rows` with respect to gx and gy, and the numbers of the laws.
        """
        old, n_rows = kernel.local, len(rows)
        first, (expression, numbers) = old.n_data + 2 * n_rows, self._expression
        local = Local(old.size, first + len(numbers))
        gravity = expression(local, local.data[first:])
        change = SX.zeros(old.n_data)
        for k, row in enumerate(rows.tolist()):
            slope_x, slope_y = local.data[old.n_data + k], local.data[old.n_data + n_rows + k]
            change[row] = slope_x * gravity[0] + slope_y * gravity[1]
        by_data = ca.jtimes(kernel.force, old.data, change)
        symbols = [old.time, old.q, old.v, old.a, old.data]
        values = [local.time, local.q, local.v, local.a, local.data[: old.n_data]]
        (weight,) = ca.substitute([by_data], symbols, values)
        # Not `reused`, although the original kernel may be: models share it by its instructions.
        return ForceKernel(local, weight, powers=ca.vertcat(-ca.dot(weight, local.v), 0))
