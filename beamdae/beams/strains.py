"""Elastic work, strains and section forces, shared by all beam formulations.

`InterpolatedStrains` is a kind of a `Formula`. `fiber_strain`, `fiber_stress`, `section_forces` and
`identity` build `FormulaExpression`s, like `LargestStress`; see `symbolic.formula`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.sections import Section, VaryingSection
from beamdae.symbolic.formula import Formula
from beamdae.symbolic.statements import SX, Local

Array = np.ndarray

# Components of a strain vector (eps11, 2 eps12, kappa11) and of (EA, GA, EI).
AXIAL = 0
SHEAR = 1
BENDING = 2
STRAIN_SIZE = 3

# Numbers of a section in `LargestStress`.
_N_FIBER_NUMBERS = 4
# Number that changes no stress [Pa] and no sum of ratios of stresses, one of which is 1.
_NEGLIGIBLE = 1e-200


def slice_column(numbers: Any, first: int, count: int) -> Any:
    """Return `count` numbers from index `first` on as a column vector."""
    return ca.vertcat(*(numbers[first + k] for k in range(count)))


class _StrainElement(Protocol):
    """Element type with strains at stiffness points."""

    @property
    def layout(self) -> ElementDataLayout: ...

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]: ...


@dataclass(frozen=True)
class InterpolatedStrains:
    """Strains at a section, interpolated between the stiffness points of its element.

    `numbers` are the `interpolation_weights` of the points, then the values at all points: one
    quantity of `layout.stiffness_point` after another, without the quadrature weight.
    """

    element: _StrainElement

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return the strains (3,) from local coordinates."""
        layout = self.element.layout
        count, n_weights = layout.stiffness_points, STRAIN_SIZE if layout.varying else 1
        rows = range(n_weights, n_weights + len(layout.stiffness_point) - 1)
        points = [ca.vertcat(0, *(numbers[i * count + k] for i in rows)) for k in range(count)]
        strains = self.element.strain_points(SX(ca.horzcat(*points)), local.q)
        total = SX.zeros(STRAIN_SIZE)
        for k, (_, strain) in enumerate(strains):
            weights = [numbers[i * count + k] for i in range(n_weights)]
            total += (ca.vertcat(*weights) if layout.varying else weights[0]) * strain
        return total


def interpolation_weights(
    section: Section | VaryingSection, weights: Sequence[float], points: Array, s: float
) -> list[float]:
    """Return the weights of `InterpolatedStrains` at a section.

    In elements whose section varies, the section forces are interpolated, because they are smooth
    where stiffnesses have kinks or jumps: the strains are the interpolated forces divided by the
    stiffnesses at `s`, and have one row of weights for each component.

    Parameters
    ----------
    section
        Section of the beam.
    weights
        Values at `s` of the Lagrange polynomials of the stiffness points.
    points
        Arc lengths of the stiffness points of the element [m].
    s
        Arc length of the section [m].
    """
    if isinstance(section, VaryingSection):
        stiffness = np.array([(x.EA, x.GA, x.EI) for x in map(section.at, points.tolist())])
        here = section.at(s)
        ratios = stiffness.T / np.array([[here.EA], [here.GA], [here.EI]])
        return np.ravel(ratios * np.array(weights)).tolist()
    return list(weights)


def fiber_strain(local: Local, strains: Callable[[Local], SX], offset: Callable[[], Any]) -> SX:
    """Return the longitudinal strain of a fiber; `offset()[0]` is its offset from the axis [m]."""
    strain = strains(local)
    return strain[AXIAL] + offset()[0] * strain[BENDING]


def fiber_stress(local: Local, strains: Callable[[Local], SX], numbers: Callable[[], Any]) -> SX:
    """Return the stress [Pa] of a fiber; `numbers()` returns (offset [m], E [Pa], damping [s])."""
    offset, modulus, damping = (numbers()[k] for k in range(3))
    strain = fiber_strain(local, strains, lambda: (offset,))
    return modulus * (strain + damping * local.dot(strain))


@dataclass(frozen=True)
class LargestStress:
    """Largest stress magnitude of the outer fibers of several sections, and a smooth bound.

    Attributes
    ----------
    sizes
        Number of local coordinates of each section, which follow each other in `Local.q`.
    exponent
        Exponent p of the bound (sum of |stress|^p)^(1/p) over the sections.
    """

    sizes: tuple[int, ...]
    exponent: float

    def __call__(self, local: Local, *functions: Any) -> SX:
        """Return (largest, bound) [Pa].

        `functions` are, for each section, that of the strains, and one without arguments that
        returns (lever of the left fiber [m], lever of the right fiber [m], E [Pa], damping [s]).
        """
        kernels: dict[Any, ca.Function] = {}
        first, stresses = 0, []
        for size, strains, numbers in zip(self.sizes, functions[::2], functions[1::2], strict=True):
            is_formula = isinstance(strains, Formula)
            data = strains.numbers if is_formula else SX(0, 1)
            kind = strains.kind if is_formula else strains
            key = kind, size, data.numel(), is_formula
            if key not in kernels:
                kernels[key] = _fiber_magnitude_function(kind, size, data.numel(), is_formula)
            here = slice(first, first + size)
            values = slice_column(numbers(), 0, _N_FIBER_NUMBERS)
            stresses.append(kernels[key](local.q[here], local.v[here], data, values))
            first += size
        largest = SX(0)
        for stress in stresses:
            largest = ca.fmax(largest, stress)
        # Without loads, all stresses are zero, and so are the bound and its derivatives.
        scale = ca.fmax(largest, _NEGLIGIBLE)
        total = sum((stress / scale) ** self.exponent for stress in stresses)
        return ca.vertcat(largest, largest * (total + _NEGLIGIBLE) ** (1.0 / self.exponent))


def _fiber_magnitude_function(
    kind: Callable[..., SX], size: int, count: int, is_formula: bool
) -> ca.Function:
    """Return the largest stress magnitude of two fibers as a function of (q, v, data, numbers)."""
    local = Local(size)
    data, numbers = SX.sym("data", count), SX.sym("numbers", _N_FIBER_NUMBERS)
    strains = Formula(kind, data) if is_formula else kind

    def magnitude_of(lever: SX) -> SX:
        return ca.fabs(fiber_stress(local, strains, lambda: (lever, numbers[2], numbers[3])))

    magnitude = ca.fmax(magnitude_of(numbers[0]), magnitude_of(numbers[1]))
    return ca.Function("magnitude", [local.q, local.v, data, numbers], [magnitude])


def section_forces(
    local: Local,
    strains: Callable[[Local], SX],
    rotation: Callable[[Local], SX],
    numbers: Callable[[], Any],
) -> SX:
    """Return (N, Q, M) on the axis, in the axes of the section.

    `numbers()` returns (EA, GA, EI, damping), and `rotation` the rotation of the section from the
    direction of the force EA eps11; see `Kinematics.force_rotation`.
    """
    *stiffness, damping = (numbers()[k] for k in range(STRAIN_SIZE + 1))
    strain = strains(local)
    viscous = damping * local.dot(strain)
    forces = ca.vertcat(*(stiffness[k] * (strain[k] + viscous[k]) for k in range(STRAIN_SIZE)))
    forces[AXIAL] += ca.sin(rotation(local)) * forces[SHEAR]
    return forces


def no_rotation(local: Local, numbers: Any) -> SX:
    """Return zero, for strains whose forces refer to the axes of the section."""
    return SX(0)


def identity(local: Local, values: Callable[[Local], SX]) -> SX:
    """Return the values unchanged, for quantities that require no further formula."""
    return values(local)
