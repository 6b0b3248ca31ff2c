"""Strains, stresses and section forces from the values of `Kinematics.section_forces`.

`fiber_strain`, `fiber_stress`, `section_forces` and `identity` build `FormulaExpression`s, like
`LargestStress`; see `symbolic.formula`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.symbolic.formula import Formula
from beamdae.symbolic.statements import SX, Local

# Components of a strain vector (eps11, 2 eps12, kappa11) and of (EA, GA, EI).
AXIAL = 0
SHEAR = 1
BENDING = 2
STRAIN_SIZE = 3

# Numbers of a section in `LargestStress`.
_N_FIBER_NUMBERS = 5
# Number that changes no stress [Pa] and no sum of ratios of stresses, one of which is 1.
_NEGLIGIBLE = 1e-200


def slice_column(numbers: Any, first: int, count: int) -> Any:
    """Return `count` numbers from index `first` on as a column vector."""
    return ca.vertcat(*(numbers[first + k] for k in range(count)))


def fiber_strain(local: Local, forces: Callable[[Local], SX], numbers: Callable[[], Any]) -> SX:
    """Return the longitudinal strain of a fiber by the elastic forces.

    `numbers()` returns (lever [m], EA [N], EI [N m^2]).
    """
    return strain_by_forces(forces(local)[:STRAIN_SIZE], *(numbers()[k] for k in range(3)))


def fiber_stress(local: Local, forces: Callable[[Local], SX], numbers: Callable[[], Any]) -> SX:
    """Return the stress [Pa] of a fiber; `numbers()` as in `fiber_strain`, then E [Pa]."""
    total = _conjugate_forces(forces(local))
    return numbers()[3] * strain_by_forces(total, *(numbers()[k] for k in range(3)))


def strain_by_forces(forces: Any, lever: Any, EA: Any, EI: Any) -> Any:
    """Return the strain at a lever [m] by (N, Q, M)."""
    return forces[AXIAL] / EA + lever * forces[BENDING] / EI


def _conjugate_forces(values: SX) -> SX:
    return values[:STRAIN_SIZE] + values[STRAIN_SIZE : 2 * STRAIN_SIZE]


@dataclass(frozen=True)
class LargestStress:
    """Largest stress magnitude of the outer fibers of several sections, and a smooth bound.

    Attributes
    ----------
    places
        First and last row, exclusive, of the coordinates of each section in `Local.q`.
    exponent
        Exponent p of the bound (sum of |stress|^p)^(1/p) over the sections; None without it.
    """

    places: tuple[tuple[int, int], ...]
    exponent: float | None

    def __call__(self, local: Local, *functions: Any) -> SX:
        """Return the largest magnitude, and the bound [Pa].

        `functions` are, for each section, the `Formula` of the section forces, and one without
        arguments that returns (lever of the left fiber [m], lever of the right fiber [m], EA [N],
        EI [N m^2], E [Pa]).
        """
        kernels: dict[Any, ca.Function] = {}
        stresses = []
        sections = zip(self.places, functions[::2], functions[1::2], strict=True)
        for (first, last), forces, numbers in sections:
            key = forces.kind, last - first, forces.numbers.numel()
            if key not in kernels:
                kernels[key] = _fiber_magnitude_function(*key)
            here = slice(first, last)
            values = slice_column(numbers(), 0, _N_FIBER_NUMBERS)
            stresses.append(kernels[key](local.q[here], local.v[here], forces.numbers, values))
        largest = SX(0)
        for stress in stresses:
            largest = ca.fmax(largest, stress)
        if self.exponent is None:
            return largest
        # Without loads, all stresses are zero, and so are the bound and its derivatives.
        scale = ca.fmax(largest, _NEGLIGIBLE)
        total = sum((stress / scale) ** self.exponent for stress in stresses)
        return ca.vertcat(largest, largest * (total + _NEGLIGIBLE) ** (1.0 / self.exponent))


def _fiber_magnitude_function(kind: Callable[..., SX], size: int, count: int) -> ca.Function:
    """Return the largest stress magnitude of two fibers as a function of (q, v, data, numbers)."""
    local = Local(size)
    data, numbers = SX.sym("data", count), SX.sym("numbers", _N_FIBER_NUMBERS)
    forces, section = Formula(kind, data), ca.vertsplit(numbers[2:])

    def magnitude_of(lever: SX) -> SX:
        return ca.fabs(fiber_stress(local, forces, lambda: (lever, *section)))

    magnitude = ca.fmax(magnitude_of(numbers[0]), magnitude_of(numbers[1]))
    return ca.Function("magnitude", [local.q, local.v, data, numbers], [magnitude])


def section_forces(local: Local, forces: Callable[[Local], SX]) -> SX:
    """Return (N, Q, M) on the axis, in the axes of the section."""
    values = forces(local)
    return _conjugate_forces(values) + ca.vertcat(values[-1], 0, 0)


def identity(local: Local, values: Callable[[Local], SX]) -> SX:
    """Return the values unchanged, for quantities that require no further formula."""
    return values(local)
