"""`periodic_sensitivities`: derivatives of periodic motions with respect to parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from beamdae.analysis.periodic.load_periods import Loads
from beamdae.analysis.periodic.monodromy import EXACT_RANK
from beamdae.analysis.periodic.period_map import PeriodMap, PeriodRun
from beamdae.analysis.periodic.periodic_solution import periodic
from beamdae.analysis.periodic.shooting import DEFAULT_RTOL, ShootingMatrix
from beamdae.analysis.sensitivities.neighbors import Difference, difference_models
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_run_columns,
    time_derivative,
)
from beamdae.analysis.sensitivities.run_chain import differentiate_states
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    select_parameters,
)
from beamdae.equations import measures
from beamdae.errors import (
    BeamdaeError,
    format_exception,
    record_warnings,
    require_positive,
    short_repr,
)
from beamdae.integrators import Integrator, Radau
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.read_only import read_only_data
from beamdae.results.periodic_motion import PeriodicMotion
from beamdae.results.trajectory import Trajectory
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "periodic_sensitivities"
# Corrections of the derivative of the start; the monodromy matrix is that of the discrete motion up
# to the errors of its iterations.
_CORRECTIONS = 3
# Singular values below this fraction of the largest belong to motions of any amplitude; integration
# errors are near 1e-8.
_MIN_SINGULAR_VALUE = 1e-6


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class PeriodicSensitivities(SensitivityResult):
    """A periodic motion and its derivatives; see `periodic_sensitivities`.

    Attributes
    ----------
    motion
        The motion.
    parameters
        Values by name of the parameters with respect to which the motion is differentiated.
    periods
        Derivatives of the period [s per unit of the parameter] by parameter.
    trajectories
        Derivatives of (q, v, a, lam) at fixed times with respect to each parameter, by its name.
    warnings
        Warnings that the call issued.
    """

    motion: PeriodicMotion
    parameters: Mapping[str, float]
    periods: Mapping[str, float]
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    _differences: Mapping[str, Difference] = field(repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)

    @property
    def _summary(self) -> str:
        return repr(self.motion)

    @property
    def _index(self) -> tuple[str, Array]:
        return measures.TIME, self.motion.solution.t

    @cached_property
    def _columns(self) -> dict[str, dict[str, Array]]:
        """Derivatives of the observed columns at fixed phases by parameter and header."""
        run = self.motion.solution
        e, (times, at) = run.equations, run.trajectory.at(run.t)
        changes = differentiate_run_columns(
            e, run.trajectory, run.t, self.trajectories, self._differences
        )
        if e.observables and any(self.periods.values()):
            along = run.trajectory.derivative_at(run.t)
            rates = np.hstack([time_derivative(o, e, times, at, along) for o in e.observables])
            shifts = (run.t - run.t[0])[:, None] / self.motion.period * rates
            changes = {name: rows + self.periods[name] * shifts for name, rows in changes.items()}
        return {
            name: dict(zip(e.observed_headers, x.T, strict=True)) for name, x in changes.items()
        }


@single_threaded
@interruptible
@record_warnings
def periodic_sensitivities(
    model: Model,
    by: Sequence[str] | str,
    period: Any = None,
    integrator: Integrator | None = None,
    start: Any = None,
    t_start: float = 0.0,
    settle: int = 5,
    tolerance: float | None = None,
    period_guess: float | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> PeriodicSensitivities:
    """Find a periodic motion and differentiate it with respect to parameters of the model.

    The state x = (q, v) at the start of a period T satisfies x(T; x, p) = x. With the monodromy
    matrix M and the derivative s(T) of the run for a constant start, its derivative dx solves

        (M - I) dx + s(T) dp + x'(T) dT = 0

    for the motions that the joints allow, where x' is the time derivative. The period of a
    self-excited or free motion has a derivative, too; then, dx is orthogonal to x', see
    `periodic`. Runs are differentiated as in `sensitivities`.

    Parameters
    ----------
    model
        Model function.
    by
        Names of the parameters with respect to which the motion is differentiated. They must be
        floats.
    period
        Period [s]; None to find the period, see `periodic`. If parameters change the period of the
        loads, a function of the values of all parameters by name, such as
        `lambda **values: 1.0 / values["frequency"]`.
    integrator
        `Radau`. Defaults to Radau(1e-8).
    start, t_start, settle, tolerance, period_guess
        See `periodic`.
    parameters
        Values of the parameters of the model that differ from the defaults.

    Returns
    -------
    PeriodicSensitivities
        The motion with its derivatives.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, no periodic motion is found, the motion does not have a
        derivative because neighboring motions are periodic, too, a parameter changes the period of
        the loads although `period` is a number, or parameters are not differentiable, see
        `sensitivities`.
    Interrupted
        If Ctrl-C ends the call.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def shaker(stiffness=9.0):
    ...     mech = bd.Mechanism()
    ...     mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    ...     rail = mech.ground.at(1.0, 0.0)
    ...     mech.add(bd.PointOnLine("rail", rail, mass.point, (1.0, 0.0)))
    ...     wall = mech.ground.at(0.0, 0.0)
    ...     mech.add(bd.Spring("spring", wall, mass.point, stiffness, 0.5))
    ...     mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.3), 0.0)))
    ...     mech.observe("mass", mass.point)
    ...     return mech
    >>> result = bd.periodic_sensitivities(shaker, "stiffness", period=1.0 / 0.3)
    >>> round(float(result.sensitivity("mass.x", "stiffness").max()), 4)  # load |H|^2
    0.0327
    """
    names, model = select_parameters(_NAME, model, by, parameters)
    values = model.parameters
    method = Radau(DEFAULT_RTOL) if integrator is None else integrator
    if not isinstance(method, Radau):
        raise BeamdaeError(f"{_NAME}: integrator must be Radau, got {short_repr(integrator)}.")
    is_function = callable(period)
    duration = _evaluate_period(period, values) if is_function else period
    motion = periodic(model(), duration, method, start, t_start, settle, tolerance, period_guess)
    if not motion.status.success:
        raise BeamdaeError(
            f"{_NAME}: no periodic motion of {model.name} was found ({motion.status.sentence})."
        )
    equations = motion.solution.equations
    if equations.redundant:
        raise BeamdaeError(
            f"{_NAME}: {model.name} permits redundant constraints, which are not supported; remove "
            "redundant='minimum norm' and the redundant joints."
        )
    period_map = PeriodMap.from_equations(
        equations, method, float(motion.solution.t[0]), motion.period
    )
    run = PeriodRun(period_map, motion.solution)
    matrix = ShootingMatrix.of(run, is_free=True, tolerance=EXACT_RANK)
    jacobian = run.projection @ matrix.jacobian @ run.basis
    if period is None:
        column = run.projection @ matrix.by_parameter
        jacobian = np.vstack([np.column_stack([jacobian, column]), np.append(run.rate, 0.0)])
    singular_values = np.linalg.svd(jacobian, compute_uv=False)
    if not singular_values[-1] > _MIN_SINGULAR_VALUE * singular_values[0]:
        raise BeamdaeError(
            f"{_NAME}: neighboring motions of {model.name} are periodic, too, so the motion has no "
            f"derivative with respect to {names[0]}; add damping, or omit period= for a "
            "self-excited motion."
        )

    assemble = partial(as_equations, _NAME, start=AS_DRAWN)
    drawn = assemble(model())
    base = replace(equations, q0=drawn.q0, v0=drawn.v0)
    periods, trajectories = {}, {}
    differences = difference_models(model, names, base, assemble)
    for name, difference in differences.items():
        stretch = 0.0
        if is_function:
            changed = [{**values, name: values[name] + x} for x in difference.steps]
            lengths = [_evaluate_period(period, x) for x in changed]
            stretch = float(difference.combine(lengths))
        elif period is not None and not all(
            Loads(e, period_map.begin, duration).repeat for e in difference.models
        ):
            raise BeamdaeError(
                f"{_NAME}: {name} of {model.name} changes the period of loads or drivers; pass "
                "period= as a function of the parameters, such as "
                "lambda **values: 1.0 / values['frequency']."
            )
        periods[name], trajectories[name] = _differentiate(
            run, jacobian, method, difference, stretch
        )
    return PeriodicSensitivities(
        motion, {name: float(values[name]) for name in names}, periods, trajectories, differences
    )


def _evaluate_period(period: Callable[..., Any], values: Mapping[str, Any]) -> float:
    """Return the period [s] that a function of the user gives."""
    try:
        value = period(**values)
    except Exception as problem:
        raise BeamdaeError(
            f"{_NAME}: the function period failed ({format_exception(problem)}); it must accept "
            "the values of all parameters by name."
        ) from problem
    return require_positive(_NAME, "period", value)


def _differentiate(
    run: PeriodRun, jacobian: Array, method: Radau, difference: Difference, stretch: float
) -> tuple[float, Trajectory]:
    """Return the derivatives of the period and of the states at fixed times.

    `stretch` is the derivative of a prescribed period.
    """
    name = difference.name
    last, count = run.solution.trajectory.intervals[-1].state, run.basis.shape[1]
    end_rate = np.concatenate([last.v[-1], last.a[-1]])
    phase, change = jacobian[count:, :count], np.zeros(len(run.scales))
    for _ in range(_CORRECTIONS):
        dq, dv = np.split(change, 2)
        states = differentiate_states(run.solution, method, {name: difference}, {name: (dq, dv)})
        along = states[name].trajectory
        first, end = along.intervals[0].state, along.intervals[-1].state
        change = np.concatenate([first.q[0], first.v[0]])
        defect = np.concatenate([end.q[-1], end.v[-1]]) + stretch * end_rate - change
        inner = [run.projection @ defect, phase @ (run.projection @ change)]
        correction = -np.linalg.solve(jacobian, np.concatenate(inner))
        change = change + run.basis @ correction[:count]
        stretch += run.period_map.period * float(np.sum(correction[count:]))
    return stretch, along
