"""Natural modes: frequencies, damping ratios, shapes and distribution of kinetic energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae import deferred
from beamdae.analysis.eigenproblems.eigensolution import (
    RIGID,
    UNSTABLE,
    VIBRATION,
    classify_modes,
    solve_eigenproblem,
)
from beamdae.analysis.eigenproblems.linearized_equations import (
    is_symmetric_matrix,
    quadratic_forms,
)
from beamdae.analysis.linear_dynamics.linearization import (
    REFERENCE,
    Linearization,
    linearize_about,
    model_of_modes,
    searched_start,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import compute_rigid_motions
from beamdae.equations.starts.steady_rotation import RotatingCoordinates
from beamdae.errors import (
    BeamdaeError,
    format_count,
    require_choice,
    require_count,
    require_finite,
    short_repr,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.mechanism import Mechanism
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasModeShapes
from beamdae.simulation import is_unchecked

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Parts with a smaller fraction of the kinetic energy are not listed in the table.
_MIN_NAMED_SHARE = 0.005
# Effective masses below this fraction of the moving mass are rounding errors.
_MASS_ROUNDING = 1e-20
# Smallest share of the kinetic energy, without rigid motions of the bodies, of a motion that
# deforms beams. Clamped beams have 3 %, rounding errors of free strips with L/h = 1e6 0.003 %.
_MIN_DEFORMATION_SHARE = 1e-3
_ASSESSED = 10  # modes whose errors are measured if all modes are requested
# Number of frequencies shown in the repr.
_REPR_FREQUENCIES = 5


class _Request(NamedTuple):
    """State and time [s] of modes, see `modes`, and the number of modes whose errors are measured.

    If `is_checked` is set, warnings contain these errors. `has_accuracy` is that of `Errors`.
    """

    about: Any
    t: float
    damping: bool
    assessed: int
    is_checked: bool
    has_accuracy: bool


@read_only_data
@dataclass(frozen=True, repr=False)
class Modes(HasModeShapes):
    """Natural modes about a state, in ascending order of |eigenvalue|; see `modes`.

    Re(c shape exp(eigenvalue t)), with any small complex amplitude c, is a free motion about the
    state.

    Attributes
    ----------
    about
        Description of the state.
    eigenvalues
        Complex eigenvalues [1/s], (k,). Each conjugate pair is represented by the eigenvalue with
        positive imaginary part.
    shapes
        Mode shapes, (k, n), normalized to x^H M x = 1 and as real as possible; in the rotating
        frame if the state is a steady rotation.
    kinds
        Kind of each mode: "free motion" (zero eigenvalue), "unstable" (growing), "vibration"
        (oscillating) or "decay" (decaying without oscillation).
    q
        Coordinates of the state, (n,).
    mechanism
        Mechanism for pictures of the modes; None if the model is not a `Mechanism`.
    """

    about: str
    eigenvalues: Array
    shapes: Array = field(repr=False)
    kinds: tuple[str, ...]
    q: Array = field(repr=False)
    mechanism: Mechanism | None = field(repr=False)
    _linearization: Linearization = field(repr=False)
    _request: _Request = field(repr=False)

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        shown = zip(self.kinds, self.frequencies[:_REPR_FREQUENCIES].tolist(), strict=False)
        frequencies = ", ".join(f"{x:.4g} Hz" if x else kind for kind, x in shown)
        more = ", ..." if len(self) > _REPR_FREQUENCIES else ""
        count = len(vars(self).get("warnings", self._linearization.warnings))
        note = f"; {format_count(count, 'warning')}, see .warnings" if count else ""
        return f"<Modes about {self.about}: {len(self)}, {frequencies}{more}{note}>"

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the whole model."""
        return self._linearization.full_equations

    @cached_property
    def errors(self) -> Any:
        """Errors of the eigenvalues, see `Errors`, measured by modes of refined beams.

        If all modes are requested, they are those of the first ten.
        """
        return deferred.module("accuracy.linear_models").measure_modes(self)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the state and the modes; `modes` issues them.

        They say that the state is unstable, not an equilibrium, or the end of an equilibrium path
        or a run that ended early, that the command of a controller has reached its limit, that
        there are no modes, that rounding errors of the stiffness hide slow modes, that friction is
        a damper about a state at rest, or that `errors` of eigenvalues exceed 4 %.
        """
        is_checked = self.mechanism is not None and self._request.is_checked
        sentences = self._linearization.warnings
        return (*sentences, *(self.errors.sentences() if is_checked else ()))

    def _issue_warnings(self) -> None:
        if not warnings_are_ignored():
            warn_of_result(self.warnings, self._linearization.equations.build_warnings)

    def describe(self, k: int) -> str:
        """Return a label of mode `k`, counted from 0: number k + 1, frequency, damping ratio.

        Modes of frequency zero have their kind in place of the frequency. Only vibrations with
        damping have a damping ratio in the label.
        """
        ratio = self.damping_ratios[k]
        damping = f", damping {ratio:.2g}" if self.kinds[k] == VIBRATION and ratio else ""
        kind = f"{self.frequencies[k]:.4g} Hz" if self.frequencies[k] else self.kinds[k]
        return f"{k + 1}: {kind}{damping}"

    @property
    def frequencies(self) -> Array:
        """Damped natural frequencies |Im l| / (2 pi) [Hz] of the eigenvalues l, (k,)."""
        return np.abs(self.eigenvalues.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios -Re l / |l| [-] of the eigenvalues l, (k,).

        They are 1 for decay without oscillation, negative for growth and 0 for free motions.
        """
        size = np.abs(self.eigenvalues)
        return -self.eigenvalues.real / np.where(size > 0.0, size, 1.0) + 0.0

    @property
    def growth_rates(self) -> Array:
        """Real parts of the eigenvalues [1/s], (k,); negative for decaying modes."""
        return self.eigenvalues.real + 0.0

    @cached_property
    def shares(self) -> dict[str, Array]:
        """Share of each moving part in the kinetic energy of each mode [-], (k,), by part name."""
        energy = np.real(self.shapes.conj().T * (self._linearization.tangent.mass @ self.shapes.T))
        energy /= np.where(energy.sum(axis=0) > 0.0, energy.sum(axis=0), 1.0)
        parts = self._linearization.equations.parts
        return {part.name: energy[part.rows].sum(axis=0) for part in parts}

    @cached_property
    def effective_masses(self) -> Array:
        """Effective modal masses along x and y [kg], (k, 2).

        That of a mode with the eigenvalue l and the shape x is Re(l^2 (x^T M r)^2 / (l^2 m - k)),
        with m = x^T M x, k = x^T K x and the unit translation r of all points along the axis; it is
        twice as large if the mode stands for a pair. Without damping, it is (x^T M r)^2 / m. Those
        of all modes add up to r^T M r, the mass of the moving parts without the mass that joints
        hold; those of single decays may be negative. They are NaN if the matrices are not
        symmetric, as in rotations, with friction, controllers and follower loads: shapes then do
        not determine them.
        """
        lin, problem = self._linearization, self._linearization.linearized_equations
        mass, x, values = lin.tangent.mass, self.shapes.T, self.eigenvalues[:, None]
        is_undamped = problem.is_conservative or not self._request.damping
        if not (is_undamped or (problem.is_symmetric and is_symmetric_matrix(lin.tangent.damping))):
            return np.full((len(self), 2), np.nan)
        translations = RotatingCoordinates.from_equations(lin.equations).translations
        inertia = np.einsum("ij,ij->j", x, mass @ x)[:, None]
        slopes = values**2 * inertia - problem.energies(x)[0][:, None]
        is_free, is_pair = values == 0.0, is_undamped | (values.imag != 0.0)
        shares = np.where(is_pair, 2.0, 1.0) * values**2 / np.where(is_free, 1.0, slopes)
        shares = np.where(is_free, 1.0 / inertia, shares)
        masses = np.real(shares * (x.T @ (mass @ translations)) ** 2)
        total = quadratic_forms(mass, translations)
        return np.where(np.abs(masses) > _MASS_ROUNDING * total, masses, 0.0)

    def table(self) -> pd.DataFrame:
        """Return a table with one row per mode.

        Columns: number, frequency [Hz], damping ratio [-], growth rate [1/s], effective masses
        [kg], kind, and the parts with at least 0.5 % of the kinetic energy.
        """
        import pandas as pd

        columns: dict[str, Any] = {
            "mode": np.arange(1, len(self) + 1),
            "frequency [Hz]": self.frequencies,
            "damping ratio [-]": self.damping_ratios,
            "growth rate [1/s]": self.growth_rates,
            "effective mass x [kg]": self.effective_masses[:, 0],
            "effective mass y [kg]": self.effective_masses[:, 1],
            "kind": list(self.kinds),
            "moves": [self._describe_shares(k) for k in range(len(self))],
        }
        return pd.DataFrame(columns)

    def mac(self, other: Modes) -> Array:
        """Return the modal assurance criterion (MAC) with other modes of the same mechanism.

        The MAC |x^H M y|^2 / (x^H M x y^H M y) of shapes x and y is one for equal shapes and zero
        for different modes of one undamped state (Allemang & Brown 1982, here in the metric of the
        mass matrix of these modes).

        Parameters
        ----------
        other
            Modes with the same coordinates, about the same or a different state.

        Returns
        -------
        numpy.ndarray
            MAC values from 0 to 1, (k, number of other modes).

        Raises
        ------
        BeamdaeError
            If `other` is not a `Modes` object or has a different number of coordinates.
        """
        if not isinstance(other, Modes) or other.shapes.shape[1] != self.shapes.shape[1]:
            raise BeamdaeError(
                f"mac: other must be modes of the same mechanism, got {short_repr(other)}."
            )
        return compare_shapes(self._linearization.tangent.mass, self.shapes.T, other.shapes.T)

    def _describe_shares(self, k: int) -> str:
        shares = {name: float(share[k]) for name, share in self.shares.items()}
        significant = (x for x in shares.items() if x[1] >= _MIN_NAMED_SHARE)
        ordered = sorted(significant, key=lambda x: -x[1])
        return ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in ordered)


def compare_shapes(mass: sp.csc_array, x: Array, y: Array) -> Array:
    """Return the modal assurance criterion (MAC) of shapes (n, k) and (n, j), (k, j).

    It is zero for shapes without mass, those of states of controllers.
    """
    masses = np.outer(*(quadratic_forms(mass, shapes).real for shapes in (x, y)))
    products = np.abs(x.conj().T @ (mass @ y)) ** 2
    return np.divide(products, masses, out=np.zeros_like(products), where=masses > 0.0)


@interruptible
def modes(
    model: Any,
    about: Any = REFERENCE,
    n: int | None = 10,
    damping: bool = True,
    t: float = 0.0,
    *,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> Modes:
    """Compute the natural modes of the equations linearized about a state.

    The modes Re(x exp(l t)) solve M x'' + C x' + K x + H mu = 0 under the linearized constraints.
    The matrices contain prestress, weight, the geometric stiffness of reactions, gyroscopic and
    centrifugal terms. Without damping, friction, rotation and follower loads, the problem is
    symmetric. Frequencies converge with the mesh of the beams (order 6 with cubic elements).

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    about
        State about which to linearize; drivers are fixed:

        - "reference": at rest in the reference configuration, with the reactions to the loads. If
          this is not an equilibrium, the stiffness is the second derivative of the potential, and
          a warning names the coordinate that accelerates most.
        - "equilibrium": at rest under the loads.
        - positions by name, such as {"crank.angle": 0.3}: at rest at these positions.
        - `rotation(speed)`: steady rotation of the whole mechanism.
        - `solution.at(time)`: an instant of a run, with its velocities frozen.
        - an `Equilibrium`: at rest at the end of its path, under the loads at this point, with the
          value of the driver, the input or the parameter that the path varies.
    n
        Number of modes to return, those with the smallest |eigenvalue|. None returns all modes,
        computed with dense matrices. Material damping gives each fast mode a decay at the rate
        1 / damping; if such decays take the place of vibrations, set `damping=False`. Large models
        may then lack one of several equal modes near this rate.
    damping
        Set False for undamped modes, from the symmetric parts of M and K alone.
    t
        Time [s] at which laws are evaluated. Ignored if `about` is an instant of a run or an
        `Equilibrium`.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to all modes.

    Returns
    -------
    Modes
        Free motions, then the other modes in ascending order of the magnitude of the eigenvalue.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the state does not exist, a coordinate has no inertia, or
        constraints are dependent and the model does not set `redundant="minimum norm"`.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        For each of `Modes.warnings`. The `errors` are measured unless warnings are filtered out.

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
    result = compute_modes(
        model, about, n, damping, t, accuracy=accuracy, accuracy_columns=accuracy_columns
    )
    result._issue_warnings()
    return result


@single_threaded
def compute_modes(
    model: Any,
    about: Any = REFERENCE,
    n: int | None = 10,
    damping: bool = True,
    t: float = 0.0,
    assessed: int | None = None,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
    has_accuracy: bool = True,
) -> Modes:
    """Compute natural modes as `modes` does, without issuing the warnings of the result.

    Errors are measured for the first `assessed` modes; None means all, or ten if `n` is None.
    `has_accuracy` is that of `Errors`.
    """
    until = deferred.module("accuracy.until")
    count = None if n is None else require_count("modes", "n", n)
    is_damped = require_choice("modes", "damping", damping, (True, False))
    time = require_finite("modes", "t", t)
    if assessed is None:
        assessed = _ASSESSED if count is None else count

    def solve(model: Any, _: Any) -> Modes:
        is_checked = assessed > 0 and not is_unchecked()
        request = _Request(about, time, is_damped, assessed, is_checked, has_accuracy)
        return _solve(model, linearize_about("modes", model, about, time), count, request)

    start = searched_start("modes", about, accuracy)
    analysis = until.Analysis("modes", solve, start=start)
    result: Modes = until.reach_accuracy(
        analysis, model_of_modes(model, about), accuracy, accuracy_columns
    )
    return result


def _solve(model: Any, lin: Linearization, count: int | None, request: _Request) -> Modes:
    """Return the modes of a linearized model."""
    solution = solve_eigenproblem(lin.linearized_equations, count, request.damping)
    kinds = classify_modes(solution.values)
    free = [k for k, kind in enumerate(kinds) if kind == RIGID]
    warnings = [*lin.warnings]
    if free:
        warnings += _describe_hidden_modes(lin, solution.shapes[:, free])
    if lin.equations.n <= lin.equations.m:
        warnings.append("there are no modes because joints and drivers fix every coordinate.")
    if growing := kinds.count(UNSTABLE):
        number = "one mode grows" if growing == 1 else f"{growing} modes grow"
        warnings.append(
            f"the state is unstable: {number}, and the fastest growth is by a factor of e in "
            f"{1.0 / np.max(solution.values.real):.3g} s."
        )
    mechanism = model if isinstance(model, Mechanism) else None
    return Modes(
        lin.about,
        solution.values,
        solution.shapes.T,
        kinds,
        lin.state.q,
        mechanism,
        replace(lin, warnings=tuple(warnings)),
        request,
    )


def _describe_hidden_modes(lin: Linearization, free: Array) -> list[str]:
    """Return a warning if a free motion, of the columns of `free`, deforms a beam, or none.

    It is a slow vibration that rounding errors of stiffer parts hide.
    """
    e, mass = lin.equations, lin.tangent.mass
    rigid = e.position_scales[:, None] * compute_rigid_motions(e, lin.state.q)
    momenta = mass @ rigid
    motions = free - rigid @ (np.linalg.pinv(rigid.T @ momenta) @ (momenta.T @ free))
    energies, totals = (quadratic_forms(mass, x).real for x in (motions, free))
    if not np.any(energies > _MIN_DEFORMATION_SHARE * totals):
        return []
    return [
        "free motions deform beams and can be slow vibrations, because rounding errors of the "
        "stiffest parts reach the stiffness of the softest ones; replace very stiff beams by rigid "
        "bodies, or very thin ones by thicker ones."
    ]
