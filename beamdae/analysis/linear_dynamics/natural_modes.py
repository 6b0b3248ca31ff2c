"""Natural modes: frequencies, damping, shapes and what moves in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.linear_dynamics.linearization import REFERENCE, Linearization, linearize_about
from beamdae.analysis.linear_dynamics.quadratic_eigenproblem import QuadraticProblem
from beamdae.analysis.linear_dynamics.steady_rotation import RotatingCoordinates
from beamdae.analysis.linear_dynamics.symmetric_eigenproblem import SymmetricProblem
from beamdae.errors import BeamdaeError, require_choice, require_count, require_finite, short_repr
from beamdae.linear.factorizations import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import Mechanism

Array = np.ndarray

# Beside the largest entry: what is no asymmetry, of matrices that are exact and of differences.
_EXACT, _DIFFERENCES = 1e-12, 1e-9


class EigenSolution(NamedTuple):
    """Eigenvalues [1/s] with their shapes, zeros first, then by size; of pairs the upper one.

    Attributes
    ----------
    values
        (k,), imaginary parts of vibrations positive.
    shapes
        (n, k), x^H M x = 1.
    """

    values: Array
    shapes: Array


def is_conservative(lin: Linearization) -> bool:
    """Whether matrices are symmetric and velocities have no part in forces."""
    own, m = lin.tangent, lin.equations.m
    if own.damping.nnz and abs(own.damping).max() > 0.0:
        return False
    if not (_is_symmetric(own.stiffness) and _is_symmetric(own.mass)):
        return False
    if not m:
        return True
    # At rest constraints on velocities hold the shape of whatever vibrates.
    moving = lin.nonholonomic
    if moving.any() and abs(own.position_jacobian[moving]).max() > 0.0:
        return False
    rows = own.acceleration_jacobian(lin.equations)
    off = abs(own.reactions.T - rows)
    return bool(off.max() <= _EXACT * abs(rows).max())


def _is_symmetric(matrix: sp.csc_array) -> bool:
    # Derivatives by differences are off by more than rounding.
    return not matrix.nnz or bool(abs(matrix - matrix.T).max() <= _DIFFERENCES * abs(matrix).max())


@single_threaded
def solve_eigenproblem(lin: Linearization, count: int | None, damped: bool = True) -> EigenSolution:
    """The lowest modes, all if `count` is None.

    With `damped` False those of the symmetric parts of K and M alone.
    """
    lowest = SymmetricProblem(lin).lowest(count)
    if not damped or is_conservative(lin):
        values = np.where(lowest.squares < 0.0, 0j, 1j) * np.sqrt(np.abs(lowest.squares))
        values += np.sqrt(np.maximum(-lowest.squares, 0.0))
        return _normalize(lin, values, lowest.shapes.astype(complex), count)
    return _normalize(lin, *QuadraticProblem(lin, lowest.squares, count).lowest(count), count)


def _normalize(
    lin: Linearization, values: Array, shapes: Array, count: int | None
) -> EigenSolution:
    """Lowest first, x^H M x = 1, and as real as can be."""
    mass = lin.tangent.mass
    order = np.argsort(np.abs(values), kind="stable")[:count]
    values, shapes = values[order], shapes[:, order]
    size = np.sqrt(np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes)))
    phase = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", shapes, mass @ shapes)))
    shapes = shapes * phase / np.where(size > 0.0, size, 1.0)
    # The largest of its coordinates is positive.
    if shapes.size:
        natural = shapes.real / lin.equations.position_scales[:, None]
        largest = natural[np.argmax(np.abs(natural), axis=0), np.arange(shapes.shape[1])]
        shapes = shapes * np.where(largest < 0.0, -1.0, 1.0)
    return EigenSolution(values, shapes)


if TYPE_CHECKING:
    import pandas as pd


# Kinds of modes.
RIGID, VIBRATION, DECAY, UNSTABLE = "free motion", "vibration", "decay", "unstable"
# Real parts beside the size of an eigenvalue that rounding leaves.
_NONE = 1e-9
# Shares of a mode that are told, and those of the mass that rounding leaves.
_TOLD, _NO_SHARE = 0.005, 1e-20


# Frequencies of its short text.
_IN_SHORT = 5


@dataclass(frozen=True, repr=False)
class Modes:
    """Natural modes of a mechanism about a state, lowest first.

    Small motions about the state are sums of Re(shape exp(eigenvalue t)).

    Attributes
    ----------
    about
        The state, in words.
    eigenvalues
        (k,) complex [1/s]; of a pair that of positive frequency.
    shapes
        (k, n): coordinates of each mode, with a modal mass of one, x^H M x = 1, and as real as can
        be; seen by an observer who turns as well if the state is a rotation.
    kinds
        "vibration"; "free motion", which nothing drives back; "decay", without oscillation; or
        "unstable", which grows.
    q
        Coordinates of the state.
    mechanism
        What can be drawn, or None.
    warnings
        What the result has to be read with.
    """

    about: str
    eigenvalues: Array
    shapes: Array = field(repr=False)
    kinds: tuple[str, ...]
    q: Array = field(repr=False)
    mechanism: Mechanism | None = field(repr=False)
    warnings: tuple[str, ...]
    _linearization: Linearization = field(repr=False)

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        told = ", ".join(f"{x:.4g}" for x in self.frequencies[:_IN_SHORT])
        more = ", ..." if len(self) > _IN_SHORT else ""
        return f"<Modes about {self.about}: {len(self)}, {told}{more} Hz>"

    @property
    def frequencies(self) -> Array:
        """Frequencies of oscillation [Hz], damped ones if there is damping; zero without."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """-Re l / |l|: one for decays, negative for what grows, and zero for free motions."""
        size = np.abs(self.eigenvalues)
        return -self.eigenvalues.real / np.where(size > 0.0, size, 1.0) + 0.0

    @property
    def growth_rates(self) -> Array:
        """Real parts of the eigenvalues [1/s]: negative for what decays."""
        return self.eigenvalues.real + 0.0

    @cached_property
    def shares(self) -> dict[str, Array]:
        """Share of each part in the kinetic energy of each mode, (k,) by name; they add up to 1."""
        e = self._linearization.equations
        momentum = self._linearization.tangent.mass @ self.shapes.T
        energy = np.real(self.shapes.conj().T * momentum)
        energy /= np.where(energy.sum(axis=0) > 0.0, energy.sum(axis=0), 1.0)
        return {part.name: energy[part.rows].sum(axis=0) for part in e.parts}

    @cached_property
    def effective_masses(self) -> Array:
        """Mass [kg] that each mode moves along x and y, |x^H M r|^2, shape (k, 2).

        r is the travel of everything along the axis; over all modes of a mechanism that nothing
        but the ground holds they add up to what can move of the mass.
        """
        turning, mass = (
            RotatingCoordinates.of(self._linearization.equations),
            self._linearization.tangent.mass,
        )
        travels = np.stack([turning.travel(axis) for axis in (0, 1)], axis=1)
        found = np.abs(self.shapes.conj() @ (mass @ travels)) ** 2
        whole = np.einsum("ij,ij->j", travels, mass @ travels)
        return np.where(found > _NO_SHARE * whole, found, 0.0)

    def table(self) -> pd.DataFrame:
        """A row a mode: frequency, damping ratio, growth rate, effective masses, what moves."""
        import pandas as pd

        columns: dict[str, Any] = {
            "mode": np.arange(1, len(self) + 1),
            "frequency [Hz]": self.frequencies,
            "damping ratio [-]": self.damping_ratios,
            "growth rate [1/s]": self.growth_rates,
            "effective mass x [kg]": self.effective_masses[:, 0],
            "effective mass y [kg]": self.effective_masses[:, 1],
            "kind": list(self.kinds),
            "moves": [self._moved(k) for k in range(len(self))],
        }
        return pd.DataFrame(columns)

    def mac(self, other: Modes) -> Array:
        """Modal assurance criterion of these modes with others of the same mechanism, (k, other).

        |x^H M y|^2 / (x^H M x y^H M y): one for the same shape (Allemang & Brown 1982, here in the
        metric of the mass matrix), and zero for different modes of one undamped state.
        """
        if not isinstance(other, Modes) or other.shapes.shape[1] != self.shapes.shape[1]:
            raise BeamdaeError(
                f"mac: other must be modes of the same mechanism, got {short_repr(other)}."
            )
        mass = self._linearization.tangent.mass
        own, its = (
            np.real(np.einsum("ij,ji->i", x.conj(), mass @ x.T))
            for x in (self.shapes, other.shapes)
        )
        return np.abs(self.shapes.conj() @ (mass @ other.shapes.T)) ** 2 / np.outer(own, its)

    def _moved(self, k: int) -> str:
        shares = {name: float(share[k]) for name, share in self.shares.items()}
        told = sorted((x for x in shares.items() if x[1] >= _TOLD), key=lambda x: -x[1])
        return ", ".join(f"{name} {share:.0%}" for name, share in told)


@single_threaded
def modes(
    model: Any, about: Any = REFERENCE, n: int | None = 10, damping: bool = True, t: float = 0.0
) -> Modes:
    """Natural modes: the equations linearized about a state, and their lowest eigenvalues.

    Solutions Re(x exp(l t)) of M x'' + C x' + K x + H mu = 0 under the linearized constraints,
    with everything the equations have: prestress, weight, the stiffness that reactions lend as
    joints turn, gyroscopic and centrifugal terms. Without damping and rotation shapes and
    eigenvalues are those of a symmetric problem. Elements of a beam count as many as its mesh:
    frequencies converge from there (order 6 with the default elements).

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    about
        "reference": as drawn, at rest, with the reactions the loads bring about there; where it
        would not stay frequencies are those of the second derivatives of the potential, and a
        warning says so. "equilibrium": at rest under the loads. Positions by name, {"crank.angle":
        0.3}: at rest there. `rotation(speed)`: all of it turns steadily. `solution.at(time)`: the
        motion of a run, as if it stayed there. What `equilibrium` gives: at rest at the end of its
        path, under the load there. Drivers hold.
    n
        How many, nearest to zero; None: all of them, by dense matrices.
    damping
        False: undamped modes, of the symmetric parts of M and K alone.
    t
        Time [s] at which laws of time are read, at rest and for rotations.

    Returns
    -------
    Modes
        Free motions first, one for each motion that nothing drives back.

    Raises
    ------
    BeamdaeError
        If there is no such state, joints depend on each other without `redundant="minimum norm"`,
        or something moves without inertia.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    >>> line = mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    >>> spring = mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, stiffness=8.0))
    >>> round(float(bd.modes(mech).eigenvalues[0].imag), 12)
    2.0
    """
    wanted = None if n is None else require_count("modes", "n", n)
    damped = require_choice("modes", "damping", damping, (True, False))
    if isinstance(model, Model):
        model = model()
    lin = linearize_about("modes", model, about, require_finite("modes", "t", t))
    return compute_modes(lin, wanted, damped, model if isinstance(model, Mechanism) else None)


def compute_modes(
    lin: Linearization, n: int | None, damped: bool = True, mechanism: Mechanism | None = None
) -> Modes:
    """The modes of linearized equations."""
    found = solve_eigenproblem(lin, n, damped)
    kinds = tuple(_classify_mode(complex(value)) for value in found.values)
    return Modes(
        lin.about,
        found.values,
        found.shapes.T,
        kinds,
        lin.state.q,
        mechanism,
        (*lin.warnings, *_constraint_warnings(lin), *_instability_warnings(found.values, kinds)),
        lin,
    )


def _classify_mode(value: complex) -> str:
    if value == 0.0:
        return RIGID
    if value.real > _NONE * abs(value):
        return UNSTABLE
    return VIBRATION if value.imag > 0.0 else DECAY


def _constraint_warnings(lin: Linearization) -> list[str]:
    if lin.equations.n > lin.equations.m:
        return []
    return ["nothing vibrates: joints and drivers hold every coordinate."]


def _instability_warnings(values: Array, kinds: Sequence[str]) -> list[str]:
    growing = [float(x.real) for x, kind in zip(values, kinds, strict=True) if kind == UNSTABLE]
    if not growing:
        return []
    many = "one mode grows" if len(growing) == 1 else f"{len(growing)} modes grow"
    return [
        f"the state is unstable: {many}, the fastest by a factor e in {1.0 / max(growing):.3g} s."
    ]
