"""`mode_sensitivities`: derivatives of natural frequencies, damping ratios and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.eigensolution import RIGID
from beamdae.analysis.linear_dynamics.linearization import (
    REFERENCE,
    Linearization,
    active_equations,
    load_path_end,
    model_of_modes,
    solve_for_accelerations,
)
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compute_modes
from beamdae.analysis.sensitivities.eigen_derivatives import EigenpairDerivatives, Pencil
from beamdae.analysis.sensitivities.model_differences import Difference, difference_model
from beamdae.analysis.sensitivities.run_derivatives import derive_states
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    complete_parameters,
    require_parameters,
)
from beamdae.analysis.sensitivities.static_derivatives import (
    plan_tangent_along,
    select_equations,
)
from beamdae.analysis.statics.load_scaling import interpolate_tangents
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Tangent, differentiate_tangent
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.errors import BeamdaeError, record_warnings, require_choice, short_repr, warn_user
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.parts.rotation import Rotation
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import derivative_columns, select_derivative
from beamdae.results.columns import remove_unit
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.trajectory import Instant
from beamdae.simulation import as_equations
from beamdae.symbolic.sums.kernel_sums import SumPlan

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "mode_sensitivities"
_MODE = "mode"
_FREQUENCY, _DAMPING_RATIO, _GROWTH_RATE = (
    "frequency [Hz]",
    "damping ratio [-]",
    "growth rate [1/s]",
)
_HEADERS = (_FREQUENCY, _DAMPING_RATIO, _GROWTH_RATE)
# Eigenvalues with a smaller relative distance are repeated: their shapes are arbitrary up to
# rounding errors divided by this distance.
_MIN_GAP = 1e-6
# Multiple of the mass matrix that is added to the stiffness, relative to the lowest squared
# frequency, because free motions have no stiffness; and number of solutions that remove its effect.
_REGULARIZATION = 1e-4
_SOLUTIONS = 6
# Net forces above this fraction of the largest force mean that there is no equilibrium.
_MAX_UNBALANCED_FORCE = 1e-6
# Rounding errors of elastic forces, relative to the stiffness times the natural sizes, if they are
# differentiated with respect to a relative change of a parameter.
_FORCE_ROUNDING = 1e-11


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class ModeSensitivities(SensitivityResult):
    """Natural modes and their derivatives; see `mode_sensitivities`.

    Attributes
    ----------
    modes
        The modes.
    parameters
        Values by name of the parameters with respect to which the modes are differentiated.
    eigenvalues
        Derivatives (k,) of the complex eigenvalues [1/s] with respect to each parameter, by its
        name; NaN for free motions and repeated eigenvalues.
    shapes
        Derivatives (k, n) of the complex mode shapes with respect to each parameter, by its name;
        NaN for free motions and repeated eigenvalues.
    warnings
        Warnings that the call issued.
    """

    modes: Modes
    parameters: Mapping[str, float]
    eigenvalues: Mapping[str, Array] = field(repr=False)
    shapes: Mapping[str, Array] = field(repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)

    @property
    def _summary(self) -> str:
        return repr(self.modes)

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a property of the modes with respect to a parameter.

        Parameters
        ----------
        column
            "frequency", "damping ratio" or "growth rate", with or without the unit.
        parameter
            Name of the parameter.

        Returns
        -------
        pandas.Series
            Derivative (k,) in the unit of the column per unit of the parameter, indexed by the
            number of the mode; NaN for free motions and repeated eigenvalues.

        Raises
        ------
        BeamdaeError
            If the parameter is not one of `parameters`, or there is no such column.
        """
        parameter = self._require_parameter("sensitivity", parameter)
        headers = {name: header for header in _HEADERS for name in (remove_unit(header), header)}
        header = headers[require_choice("sensitivity", "column", column, list(headers))]
        index = _MODE, np.arange(1, len(self.modes) + 1)
        return select_derivative(self._columns(parameter), header, parameter, index)

    def table(self) -> pd.DataFrame:
        """Return the properties of the modes and their derivatives, one row per mode.

        The header of the derivative of the frequency with respect to "E" is "d(frequency)/d(E) [Hz
        per unit of E]".
        """
        import pandas as pd

        columns = {
            _MODE: np.arange(1, len(self.modes) + 1),
            _FREQUENCY: self.modes.frequencies,
            _DAMPING_RATIO: self.modes.damping_ratios,
            _GROWTH_RATE: self.modes.growth_rates,
        }
        by_parameter = {name: self._columns(name) for name in self.parameters}
        return pd.DataFrame({**columns, **derivative_columns(by_parameter)})

    def _columns(self, parameter: str) -> dict[str, Array]:
        value, rate = self.modes.eigenvalues, self.eigenvalues[parameter]
        size = np.where(value == 0.0, 1.0, np.abs(value))
        growth = np.real(value.conj() * rate) / size
        return {
            # No negative zeros in tables.
            _FREQUENCY: np.sign(value.imag) * rate.imag / (2.0 * np.pi) + 0.0,
            _DAMPING_RATIO: -rate.real / size + value.real * growth / size**2 + 0.0,
            _GROWTH_RATE: rate.real + 0.0,
        }


@single_threaded
@interruptible
@record_warnings
def mode_sensitivities(
    model: Model,
    by: Sequence[str] | str,
    about: Any = REFERENCE,
    n: int | None = 10,
    damping: bool = True,
    t: float = 0.0,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> ModeSensitivities:
    """Compute natural modes and differentiate them with respect to parameters of the model.

    With the mode z = (x, mu) of the eigenvalue l, P(l) z = 0 for P = [[l^2 M + l C + K, H],
    [J + l V, 0]], and its left vector w, P^T w = 0, the derivatives are

        dl = -w^T dP z / (w^T P'(l) z),    P dz = -(dP + dl P') z

    (Fox & Kapoor 1968, doi:10.2514/3.5008; Nelson 1976, doi:10.2514/3.7211; here with constraints
    and damping, and with a bordered matrix in place of P without one equation). dP contains the
    changes of the numbers of the model and of the state about which it is linearized, which moves
    with the parameters. Matrices are differentiated exactly; only the model function is
    differenced, see `sensitivities`. Shapes keep their normalization x^H M x = 1.

    Parameters
    ----------
    model
        Model function.
    by
        Names of the parameters with respect to which the modes are differentiated. They must be
        floats.
    about
        "reference", "equilibrium", positions by name, or an `Equilibrium` of the model with the
        same `parameters`, whose load factors remain constant; see `modes`. The state must be an
        equilibrium for all values of the parameters.
    n, damping, t
        See `modes`.
    parameters
        Values of the parameters of the model that differ from the defaults.

    Returns
    -------
    ModeSensitivities
        The modes with their derivatives.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the state is not an equilibrium or rotates or moves, or a
        parameter changes the structure of the equations or is at a kink of the model function.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If an eigenvalue is repeated, because its modes are then not differentiable, if a parameter
        has no effect, and as `modes`.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def oscillator(stiffness=8.0):
    ...     mech = bd.Mechanism()
    ...     bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    ...     mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    ...     mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, stiffness))
    ...     return mech
    >>> result = bd.mode_sensitivities(oscillator, "stiffness")
    >>> round(float(result.sensitivity("frequency", "stiffness")[1]), 6)  # 1 / (4 pi sqrt(k m))
    0.019894
    """
    names = require_parameters(_NAME, model, by)
    values = complete_parameters(_NAME, model, parameters)
    if isinstance(about, (Instant, Rotation)):
        raise BeamdaeError(
            f"{_NAME}: about must be a state at rest (such as 'reference' or 'equilibrium'), got "
            f"{short_repr(about)}; use differences of modes for rotating and moving states."
        )
    result = compute_modes(model(**values), about, n, damping, t)
    lin = result._linearization
    if len(lin.equations.states):
        name = lin.equations.q_names[lin.equations.states[0]]
        raise BeamdaeError(
            f"{_NAME}: modes of models with states such as {name} cannot be differentiated; use "
            "differences of bd.modes."
        )
    if lin.zero_square > 0.0:
        raise BeamdaeError(
            f"{_NAME}: the state of {model.name} is not an equilibrium, so its modes cannot be "
            "differentiated; use about='equilibrium'."
        )
    pairs = _simple_pairs(model.name, result, damping)
    is_static = isinstance(about, Equilibrium) or about == EQUILIBRIUM
    is_drawn = is_static or about in (REFERENCE, AS_DRAWN)

    def assemble(mechanism: Any) -> EquationsOfMotion:
        equations = as_equations(_NAME, model_of_modes(mechanism, about), AS_DRAWN)
        return equations if is_drawn else apply_initial_conditions(equations, about, t)

    drawn = assemble(model(**values))
    base = replace(lin.full_equations, q0=drawn.q0, v0=drawn.v0)
    eigenvalues, shapes = {}, {}
    for name in names:
        difference = difference_model(model, name, values, base, assemble, moves_operators=True)
        state = _StateDerivatives.of(lin, difference, values[name], about, t)
        along = state.equilibrium(result) if is_static else state.start(model.name, result)
        change = Pencil.of(lin.equations, state.tangent(along), damping)
        eigenvalues[name] = np.full(len(result), complex(np.nan, np.nan))
        shapes[name] = np.full(result.shapes.shape, complex(np.nan, np.nan))
        for k, pair in pairs.items():
            eigenvalues[name][k], shapes[name][k] = pair.derivative(change)
    result._issue_warnings()
    return ModeSensitivities(
        result,
        {name: float(values[name]) for name in names},
        eigenvalues,
        shapes,
        result.warnings,
    )


def _simple_pairs(model: str, result: Modes, damping: bool) -> dict[int, EigenpairDerivatives]:
    """Return by index the eigenpairs that are neither free motions nor repeated.

    Warns
    -----
    BeamdaeWarning
        If an eigenvalue is repeated.
    """
    lin = result._linearization
    pencil = Pencil.of(lin.equations, lin.tangent, damping)
    scales = lin.equations.position_scales
    pairs = {
        k: EigenpairDerivatives(pencil, scales, complex(value), shape)
        for k, (value, shape) in enumerate(zip(result.eigenvalues, result.shapes, strict=True))
        if result.kinds[k] != RIGID
    }
    repeated = [k for k, pair in pairs.items() if pair.gap < _MIN_GAP]
    if repeated:
        names = ", ".join(str(k + 1) for k in repeated)
        undamped = "; for overdamped modes, use damping=False" if damping else ""
        warn_user(
            f"{_NAME}: the eigenvalues of modes {names} of {model} are repeated (within "
            f"{_MIN_GAP:g}), so their derivatives do not exist (NaN); request fewer modes (n=), or "
            f"change a parameter so that the eigenvalues differ{undamped}."
        )
    return {k: pair for k, pair in pairs.items() if k not in repeated}


@dataclass(frozen=True)
class _StateDerivatives:
    """Derivatives of the state at rest and of its linearized equations along one parameter.

    `parts` are the equations without and with the loads of a stage, or one set of equations.
    """

    lin: Linearization
    difference: Difference
    value: float
    parts: tuple[Difference, ...]
    factor: float

    @classmethod
    def of(
        cls, lin: Linearization, difference: Difference, value: float, about: Any, t: float
    ) -> _StateDerivatives:
        def parts_of(e: EquationsOfMotion) -> tuple[tuple[EquationsOfMotion, ...], float]:
            if not isinstance(about, Equilibrium):
                return (active_equations(e, None, t)[0],), 1.0
            source = e if e.mechanism is None else e.mechanism
            _, system, factor = load_path_end(source, e, about)
            if not system.has_scaled_loads:
                return (system.equations,), 1.0
            return (system.unloaded.equations, system.equations), factor

        base, factor = parts_of(lin.full_equations)
        around = [parts_of(e)[0] for e in difference.equations]
        parts = tuple(
            select_equations(difference, e, [x[k] for x in around]) for k, e in enumerate(base)
        )
        return cls(lin, difference, value, parts, factor)

    def tangent(self, along: State) -> Tangent:
        """Return the derivative of the tangent along a state and the parameter."""
        lin = self.lin
        changes = [
            differentiate_tangent(
                part.base, lin.time, lin.state, along, part.derivative(lambda e: e.p), plans
            )
            for part, plans in zip(self.parts, self._plans, strict=True)
        ]
        return interpolate_tangents(changes[0], changes[-1], self.factor)

    @cached_property
    def _plans(self) -> list[tuple[SumPlan, SumPlan] | None]:
        return [plan_tangent_along(part) for part in self.parts]

    def equilibrium(self, result: Modes) -> State:
        """Return the derivative of the equilibrium.

        Free motions have no stiffness; the motion along them is zero.
        """
        along, error, largest = self._balance(result, self._rest)
        if np.any(error > _MAX_UNBALANCED_FORCE * largest + self._force_rounding):
            raise BeamdaeError(
                f"{_NAME}: the equilibrium has no derivative with respect to "
                f"{self.difference.name}, because a motion that it causes has no stiffness; add a "
                "spring or a joint."
            )
        return along

    def start(self, model: str, result: Modes) -> State:
        """Return the derivative of a state that follows from the drawing or given positions.

        The state is an equilibrium. Therefore, the errors of the differences of its positions,
        which strain stiff beams, are removed.
        """
        (part,), lin = self.parts, self.lin
        e, dp = part.base, part.derivative(lambda e: e.p)
        zero = np.zeros(e.n)
        dq = part.derivative(lambda e: ConsistencySolver(e).state(lin.time, e.q0, zero).q)
        dq = derive_states(part).project_positions(lin.time, lin.state.q, dq, dp)
        along = self._rest._replace(q=dq)
        # Drivers keep their positions, as in the linearized state: velocities cause no forces.
        force = self.tangent(along).residual[: e.n]
        solve = solve_for_accelerations(lin.equations, lin.tangent)
        a, lam = np.split(solve(np.concatenate([-force, np.zeros(e.m)])), [e.n])
        scales = e.position_scales
        inertia = scales * np.abs(lin.tangent.mass @ a)
        largest = np.max(scales * (abs(lin.tangent.reactions) @ np.abs(lam)), initial=0.0)
        if np.any(inertia > _MAX_UNBALANCED_FORCE * largest + self._force_rounding):
            raise BeamdaeError(
                f"{_NAME}: {self.difference.name} of {model} moves the state out of equilibrium, "
                "so its modes cannot be differentiated; use about='equilibrium'."
            )
        return self._balance(result, along._replace(lam=lam))[0]

    def _balance(self, result: Modes, along: State) -> tuple[State, Array, float]:
        """Return the direction `along`, corrected so that forces remain balanced.

        The remaining forces (n,) and the largest force are also returned, times natural sizes.
        """
        lin, e = self.lin, self.lin.equations
        tangent, scales = lin.tangent, self.lin.equations.position_scales
        rows, force = tangent.acceleration_jacobian(e), self.tangent(along).residual
        blocks = [[tangent.stiffness, tangent.reactions], [rows, sp.csc_array((e.m, e.m))]]
        matrix = sp.block_array(blocks, format="csr")
        squares = np.abs(result.eigenvalues[np.abs(result.eigenvalues) > 0.0]) ** 2
        shift = _REGULARIZATION * (float(squares[0]) if len(squares) else 1.0)
        solve = factorize_saddle_point(
            tangent.stiffness + shift * tangent.mass, tangent.reactions, rows
        )
        change = np.zeros(e.n + e.m)
        if solve is not None:
            for _ in range(_SOLUTIONS):
                change = change - solve(force + matrix @ change)
        error = scales * np.abs(force + matrix @ change)[: e.n]
        sizes = abs(matrix) @ np.abs(change) + np.abs(force)
        largest = float(np.max(scales * sizes[: e.n], initial=0.0))
        dq, dlam = np.split(change, [e.n])
        return along._replace(q=along.q + dq, lam=along.lam + dlam), error, largest

    @property
    def _force_rounding(self) -> float:
        """Rounding errors of derivatives of forces, times natural sizes."""
        scales = self.lin.equations.position_scales
        stiffness = abs(self.lin.tangent.stiffness)
        size = np.max(scales * (stiffness @ scales), initial=0.0)
        return _FORCE_ROUNDING * float(size) / (abs(self.value) or 1.0)

    @property
    def _rest(self) -> State:
        e = self.lin.equations
        return State(np.zeros(e.n), np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
