"""Force elements: forces that depend on a deformation between two attachments.

A deformation is a column of elongations, displacements or angles. Forces are positive if they
oppose an increase of the deformation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, convert_fields
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.forces.formula_checks import (
    as_vector,
    evaluate_formula,
    require_column,
    require_continuous_formula,
    require_function,
)
from beamdae.parts.forces.loads import ForceFormula, PointForce
from beamdae.parts.part import PlacedPoint
from beamdae.parts.tables import Table
from beamdae.symbolic.force_kernel import CompliantForm, mix_law
from beamdae.symbolic.formula import (
    Formula,
    constant_formula,
)
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ForceKernel,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

# Deformations, relative to the typical size, at which a user's energy and law are compared.
_SAMPLE_DEFORMATIONS = (-0.31, -0.03, 0.04, 0.37)
# Largest difference between the gradient of the energy and the law, relative to the largest force.
_ENERGY_TOLERANCE = 1e-6
# Differences below this value are rounding errors [N] or [N m].
_MIN_FORCE_DIFFERENCE = 1e-12


class ElementResponse(NamedTuple):
    """Forces of an element and their contributions to the energy balance.

    Attributes
    ----------
    force
        Force for each entry of the deformation.
    energy
        Potential [J].
    power
        Power [W] supplied to the mechanism by forces that are neither elastic nor damping.
    dissipated
        Dissipated power [W].
    """

    force: SX
    energy: SX
    power: SX
    dissipated: SX


@dataclass(frozen=True)
class LinearLaw:
    """Linear law; `numbers` are stiffnesses, damping coefficients and preloads of all entries.

    Attributes
    ----------
    rows
        Number of entries of the deformation.
    """

    rows: int

    def split(self, numbers: Any) -> list[SX]:
        """Return the columns of stiffnesses, damping coefficients and preloads."""
        entries = [numbers[k] for k in range(3 * self.rows)]
        return [ca.vertcat(*entries[k * self.rows : (k + 1) * self.rows]) for k in range(3)]

    def __call__(self, x: SX, rate: SX, numbers: Any) -> ElementResponse:
        """Return the response to a deformation and its rate."""
        stiffness, damping, preload = self.split(numbers)
        force = stiffness * x + damping * rate + preload
        energy = ca.dot(0.5 * stiffness * x + preload, x)
        return ElementResponse(force, energy, SX(0), ca.dot(damping * rate, rate))


@dataclass(frozen=True)
class UserLaw:
    """User-written law: the value at zero rate is a static force, the remainder is damping.

    Without `energy`, the static force is treated as a load in the energy balance.

    Attributes
    ----------
    part
        Name of the part, for messages.
    rows
        Number of entries of the deformation.
    law
        Function (deformation, rate) -> force.
    energy
        Function (deformation) -> potential [J] of the static force.
    """

    part: str
    rows: int
    law: Callable[..., Any]
    energy: Callable[..., Any] | None

    def force(self, x: SX, rate: SX) -> SX:
        """Return the force as a column.

        Raises
        ------
        BeamdaeError
            If the call of the law fails or does not return one number per entry.
        """
        arguments: tuple[Any, ...]
        arguments = (x, rate) if self.rows == 1 else (as_vector(x), as_vector(rate))
        if isinstance(self.law, Table):
            # A table of the deformation alone.
            arguments = arguments[: len(self.law.axes)]
        value = evaluate_formula(self.part, "law", self.law, *arguments)
        return require_column(self.part, "law", value, self.rows)

    def stored_energy(self, x: SX) -> SX:
        """Return the potential [J], or zero if `energy` is None.

        Raises
        ------
        BeamdaeError
            If the call of `energy` fails or does not return one number.
        """
        if self.energy is None:
            return SX(0)
        argument = x if self.rows == 1 else as_vector(x)
        value = evaluate_formula(self.part, "energy", self.energy, argument)
        return require_column(self.part, "energy", value, 1)

    def __call__(self, x: SX, rate: SX, numbers: Any) -> ElementResponse:
        """Return the response to a deformation and its rate."""
        force, static_force = self.force(x, rate), self.force(x, SX.zeros(self.rows))
        power = -ca.dot(static_force, rate) if self.energy is None else SX(0)
        dissipated = ca.dot(force - static_force, rate)
        return ElementResponse(force, self.stored_energy(x), power, dissipated)

    def require_valid(self, size: float) -> None:
        """Raise BeamdaeError unless law and energy are valid formulas that agree with each other.

        Parameters
        ----------
        size
            Typical size of the deformation [m] or [rad].
        """
        x, rate = SX.sym("x", self.rows), SX.sym("rate", self.rows)
        require_function(self.part, "law", self.law)
        require_continuous_formula(self.part, "law", self.force(x, rate), (x, rate))
        if self.energy is None:
            return
        require_function(self.part, "energy", self.energy)
        energy = self.stored_energy(x)
        require_continuous_formula(self.part, "energy", energy, (x,))
        static_force = self.force(x, SX.zeros(self.rows))
        gradient = ca.densify(ca.gradient(energy, x))
        compare = ca.Function("compare", [x], [gradient, ca.densify(static_force)])
        for sample in _SAMPLE_DEFORMATIONS:
            slope, force = (np.array(y).ravel() for y in compare(sample * size))
            is_finite = np.isfinite(slope) & np.isfinite(force)
            difference = np.where(is_finite, np.abs(slope - force), 0.0)
            largest_force = np.max(np.abs(force[is_finite]), initial=0.0)
            worst = int(np.argmax(difference))
            limit = _ENERGY_TOLERANCE * largest_force + _MIN_FORCE_DIFFERENCE
            if difference[worst] > limit:
                values = "values" if self.rows == 1 else f"values of entry {worst + 1}"
                raise BeamdaeError(
                    f"{self.part}: the derivative of energy must equal law at zero "
                    f"rate, but at a deformation of {sample * size:.3g} the {values} are "
                    f"{float(slope[worst]):.6g} and {float(force[worst]):.6g}."
                )


@dataclass(frozen=True)
class _ElementFormula:
    """Formula of the force between two points.

    Attributes
    ----------
    deformation
        Function (first point, second point, numbers) -> deformation.
    law
        Function (deformation, rate, numbers) -> response.
    rows
        Number of columns of the observed force.
    """

    deformation: Callable[..., SX]
    law: Callable[..., ElementResponse]
    rows: int

    def __call__(
        self,
        local: Local,
        points: Sequence[PlacedPoint],
        law_numbers: Formula,
        deformation_numbers: Formula,
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        x = self.deformation(*points, deformation_numbers())
        response = self.law(x, local.dot(x), law_numbers())
        kernel = ForceKernel(
            local,
            ca.jtimes(x, local.q, response.force, True),
            energies=ca.vertcat(0, response.energy, 0),
            powers=ca.vertcat(response.power, response.dissipated),
            compliant=self._compliant_form(local, x, law_numbers, deformation_numbers),
            mix=partial(mix_law, local, x, response.force, response.force.numel()),
        )
        values: dict[str, SX] = {}
        for name, column in (("deformation", x), ("force", response.force)):
            # Deformations of springs without a free length are vectors.
            entries = column if column.numel() == self.rows else ca.norm_2(column)
            values |= {f"{name}{k}": entries[k] for k in range(self.rows)}
        return kernel, values

    def _compliant_form(
        self, local: Local, x: SX, law_numbers: Formula, deformation_numbers: Formula
    ) -> CompliantForm | None:
        if not isinstance(self.law, LinearLaw):
            return None
        rows, (stiffness, *_) = self.law.rows, self.law.split(law_numbers())
        own = Local(local.size, local.n_data, rows)
        forces = ca.substitute(
            ca.sqrt(stiffness) * x, ca.vertcat(local.q, local.data), ca.vertcat(own.q, own.data)
        )
        first = local.n_data - deformation_numbers().numel() - 3 * rows
        split = partial(_split_numbers, first, rows)
        operators = np.eye(local.size)[None]
        return CompliantForm(ConstraintKernel(own, forces, True), operators, split)


def _split_numbers(
    first: int, rows: int, data: np.ndarray, idle: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    """Return the arrays of `CompliantForm.split` for the numbers of a linear law at `first`."""
    rest, points = data.copy(), data.copy()
    stiffness, damping = (rest[first + k * rows :][:rows] for k in (0, 1))
    # Other stiffnesses have no root, and springs stay in the rest.
    is_elastic = stiffness > 0.0
    if idle is not None:
        is_elastic &= ~idle[:, 0].T
    times = np.divide(damping, stiffness, out=np.zeros_like(damping), where=is_elastic)
    points[first:][:rows][~is_elastic] = 0.0
    stiffness[is_elastic], damping[is_elastic] = 0.0, 0.0
    times = times.T[:, None]
    return rest, points.T[:, None], times, np.zeros_like(times)


@dataclass(frozen=True, eq=False)
class ForceElement(PointForce):
    """Force between two attachments that depends on a deformation and its rate.

    A subclass defines the deformation and the law.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The two attachments.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, or neither can move.
    """

    acts_between_attachments = True
    name: str
    a: Attachment
    b: Attachment

    _force_columns: ClassVar[tuple[Variable, ...]]
    # Names of the stiffnesses, damping coefficients and preloads.
    _coefficients: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        convert_fields(self)
        require_attachment(self.name, "first attachment", self.a)
        require_attachment(self.name, "second attachment", self.b)
        if not self.a.size + self.b.size:
            raise BeamdaeError(
                f"{self.name}: neither {self.a} nor {self.b} can move; attach one of them to a "
                "body."
            )

    def _require_law(self, size: float) -> None:
        """Require a valid law of this size of deformations without coefficients, or none."""
        owner: Any = self
        if owner.law is None:
            if owner.energy is not None:
                raise BeamdaeError(f"{self.name}: energy requires law=; pass both or neither.")
        elif any(getattr(self, name) for name in self._coefficients):
            *first, last = self._coefficients
            raise BeamdaeError(
                f"{self.name}: give either a law or {', '.join(first)} and {last}, not both."
            )
        else:
            rows = len(self._force_columns)
            UserLaw(self.name, rows, owner.law, owner.energy).require_valid(size)

    @property
    def _deformation(self) -> Callable[..., SX]:
        """Module-level function (placement of a, placement of b, numbers) -> deformation."""
        raise NotImplementedError

    @property
    def _deformation_numbers(self) -> tuple[float, ...]:
        raise NotImplementedError

    @property
    def _law(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        owner: Any = self
        rows = len(self._force_columns)
        if owner.law is not None:
            return UserLaw(self.name, rows, owner.law, owner.energy), ()
        numbers = tuple(float(getattr(self, name)) for name in self._coefficients)
        # Without preloads, if the element has none.
        return LinearLaw(rows), (*numbers, *[0.0] * (3 * rows - len(numbers)))

    @property
    def points(self) -> dict[str, Attachment]:
        """Both points, by the names "a" and "b"."""
        return {"a": self.a, "b": self.b}

    @property
    def _formula(self) -> ForceFormula:
        return _ElementFormula(self._deformation, self._law[0], len(self._force_columns))

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return constant_formula(*self._law[1]), constant_formula(*self._deformation_numbers)

    @property
    def _is_shared(self) -> bool:
        return self.is_elastic

    @property
    def is_elastic(self) -> bool:
        """True unless the force is a function of the user."""
        return not isinstance(self._law[0], UserLaw)

    @rebuilt_for_mesh
    def _observe_columns(self, what: str, columns: tuple[Variable, ...]) -> Quantity:
        """Return the "deformation" or the "force" as a quantity."""
        return self._observe_values({f"{what}{k}": x for k, x in enumerate(columns)})

    @property
    def force(self) -> Quantity:
        """Forces [N] and moments [N m], positive if they oppose an increase of the deformation."""
        return self._observe_columns("force", self._force_columns)
