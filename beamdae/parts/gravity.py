"""Gravity as a law of time: what parts state of a constant one, with laws in its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.laws import Law
from beamdae.symbolic.formulas import Formula
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local

Array = np.ndarray


@dataclass(frozen=True)
class GravityLaws:
    """Both components of gravity over time.

    The weight is the work of a load then: under a gravity that changes there is no potential.
    """

    laws: tuple[Law, Law]
    name: str = "gravity"
    # By the identity of a kernel, which is kept with what came of it.
    _made: dict[Any, tuple[ForceKernel, ForceKernel]] = field(default_factory=dict)

    def statements(
        self, forces: Callable[[Array], Sequence[ForceStatement]]
    ) -> list[ForceStatement]:
        """The forces of a part, a function of a constant gravity, under the laws."""
        none, x, y = (forces(np.array(g)) for g in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
        return [self._statement(*said) for said in zip(none, x, y, strict=True)]

    def _statement(
        self, none: ForceStatement, x: ForceStatement, y: ForceStatement
    ) -> ForceStatement:
        """One statement; its data are linear in gravity."""
        slopes = x.data - none.data, y.data - none.data
        rows = np.flatnonzero(np.any(slopes[0], axis=1) | np.any(slopes[1], axis=1))
        if not rows.size:
            return none
        key = (id(none.kernel), tuple(rows.tolist()))
        if key not in self._made:
            self._made[key] = none.kernel, self._kernel(none.kernel, rows)
        numbers = np.array([n for _, law in self._formulas for n in law], float)
        own = np.repeat(numbers[:, None], none.count, axis=1)
        data = np.concatenate([none.data, slopes[0][rows], slopes[1][rows], own])
        return ForceStatement(none.part, self._made[key][1], none.pieces, data)

    @property
    def _formulas(self) -> list[tuple[Callable[[SX], SX], tuple[float, ...]]]:
        """Each law, and its numbers if it is a formula."""
        found = [law.formula for law in self.laws]
        return [(x, tuple(x.numbers) if isinstance(x, Formula) else ()) for x in found]

    def _kernel(self, kernel: ForceKernel, rows: Array) -> ForceKernel:
        old, count = kernel.local, len(rows)
        numbers = sum(len(own) for _, own in self._formulas)
        local = Local(old.size, old.n_data + 2 * count + numbers)
        along, first = [], old.n_data + 2 * count
        for formula, own in self._formulas:
            law: Any = formula
            if isinstance(formula, Formula):
                law = Formula(formula.kind, local.data[first : first + len(own)])
            first += len(own)
            along.append(law(local.time))
        still = SX(local.data[: old.n_data])
        given = SX(still)
        for k, row in enumerate(rows.tolist()):
            slopes = (local.data[old.n_data + k], local.data[old.n_data + count + k])
            given[row] += slopes[0] * along[0] + slopes[1] * along[1]
        symbols = [old.time, old.q, old.v, old.a, old.data]
        moving = [local.time, local.q, local.v, local.a]
        free = ca.substitute(kernel.outputs, symbols, [*moving, still])
        force = ca.substitute([kernel.force], symbols, [*moving, given])[0]
        power = ca.dot(free[0] - force, local.v)
        powers = free[2] + ca.vertcat(power, 0)
        return ForceKernel(local, force, free[1], powers, reused=kernel.reused)
