"""`sensitivities`: derivatives of a run with respect to parameters of its model function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.sensitivities.differentiable_run import (
    DifferentiableRun,
    assess_derivatives,
    require_differentiable_method,
    warn_of_errors,
)
from beamdae.analysis.sensitivities.neighbors import Difference
from beamdae.analysis.sensitivities.observable_derivatives import differentiate_run_columns
from beamdae.analysis.sensitivities.restart_times import differentiate_event_time, event_number
from beamdae.analysis.sensitivities.sensitivity_result import (
    SensitivityResult,
    require_parameters,
    select_parameters,
)
from beamdae.equations import measures
from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError, record_warnings, short_repr
from beamdae.integrators import Integrator
from beamdae.integrators.limits import Progress
from beamdae.interrupts import (
    Interrupted,
    PartialResult,
    acknowledge,
    interruptible,
)
from beamdae.model_functions import HasOrigin, Model, model_of, transform_mechanisms
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import (
    ColumnDerivatives,
    derivative_header,
)
from beamdae.results.outcome import Status
from beamdae.results.run_data import coordinate_headers
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory
from beamdae.simulation import as_equations

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(SensitivityResult):
    """A run and its derivatives with respect to parameters of the model; see `sensitivities`.

    Attributes
    ----------
    solution
        The run.
    parameters
        Values by name of the parameters with respect to which the run is differentiated.
    trajectories
        Derivatives of (q, v, a, lam) with respect to each parameter, by its name: at the steps of
        the run, with dense output, in the units of (q, v, a, lam) per unit of the parameter.
    warnings
        Warnings that the call issued.
    """

    solution: Solution
    parameters: Mapping[str, float]
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    _differences: Mapping[str, Difference] = field(repr=False)
    _repeat: Callable[[Callable[[Any], Any], Any], Sensitivities] | None = None
    warnings: tuple[str, ...] = field(default=(), repr=False)

    def __getstate__(self) -> dict[str, Any]:
        # Model functions cannot always be pickled; errors that are known are kept.
        return {**vars(self), "_repeat": None}

    @cached_property
    def errors(self) -> Any:
        """Errors of the derivatives of observed columns, see `Errors`, by a refined repetition.

        They are relative to the root mean square of the derivative over time.
        """
        return deferred.module("accuracy.derivatives").measure_sensitivities(self)

    @property
    def _summary(self) -> str:
        t = self.solution.t
        return f"t = {t[0]:g} to {t[-1]:g} s in {len(t)} rows"

    @property
    def t(self) -> Array:
        """Output times (k,) of the run [s]."""
        return self.solution.t

    @property
    def _index(self) -> tuple[str, Array]:
        return measures.TIME, self.t

    @property
    def _columns(self) -> Mapping[str, Mapping[str, Array]]:
        return self.columns.observed

    def _further_columns(self, parameter: str) -> Mapping[str, Array]:
        """Return the derivatives of coordinates, velocities and multipliers."""
        return self.columns.coordinates[parameter]

    @property
    def events(self) -> pd.DataFrame:
        """Table of the events: name, time, and derivatives of the time with respect to parameters.

        The header of the derivative is "d(t)/d(damping) [s per unit of damping]". Events that
        act on the run and events that are only recorded are included.

        Raises
        ------
        BeamdaeError
            If the quantity of an event only touches its value, where the derivative does not exist.
        """
        import pandas as pd

        run, equations = self.solution, self.solution.equations
        rows = []
        for record in run.event_records:
            k = int(run.trajectory.interval_index(np.array([record.t]))[0])
            derivatives = differentiate_event_time(
                equations,
                event_number(equations, record.name),
                run.trajectory.intervals[k],
                record.t,
                {name: x.intervals[k] for name, x in self.trajectories.items()},
                self._differences,
            )
            rows.append({"event": record.name, measures.TIME: record.t, **derivatives})
        headers = {name: derivative_header(measures.TIME, name) for name in self.parameters}
        columns = ["event", measures.TIME, *self.parameters]
        return pd.DataFrame(rows, columns=columns).rename(columns=headers)

    def at_times(self, times: Array) -> Sensitivities:
        """Return the result at other times [s], which must ascend and lie within the run."""
        return replace(self, solution=self.solution.at_times(times))

    @cached_property
    def columns(self) -> ColumnDerivatives:
        """Derivatives of all columns at the output times."""
        run = self.solution
        along = {name: x.at(run.t)[1] for name, x in self.trajectories.items()}
        rows = differentiate_run_columns(
            run.equations, run.trajectory, run.t, self.trajectories, self._differences
        )
        headers = run.equations.observed_headers
        observed = {name: dict(zip(headers, x.T, strict=True)) for name, x in rows.items()}
        headers = coordinate_headers(run.equations)[1:]
        coordinates = {
            name: dict(zip(headers, np.hstack([x.q, x.v, x.lam]).T, strict=True))
            for name, x in along.items()
        }
        return ColumnDerivatives(run.t, self.parameters, observed, coordinates)


@interruptible
@record_warnings
def sensitivities(
    model: Model,
    by: Sequence[str] | str,
    integrator: Integrator | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    start: Any = None,
    estimate_error: bool = True,
) -> Sensitivities:
    """Integrate a model and differentiate the run with respect to parameters of its function.

    The result contains d(column)/d(parameter) of every observed column, coordinate, velocity and
    multiplier. Without events, it is the derivative of the discrete solution, up to the Newton
    errors of the run: with F(t, q, v, a, p) + G^T lam = 0 and g(t, q, p) = 0, where p are the
    numbers in the equations, each step solves

        F_q dq + F_v dv + F_a da + d(G^T lam) + F_p dp = 0,    G dq + g_p dp = 0

    for the derivatives of its unknowns, or of its stages, with the step sequence of the run and
    directional derivatives of the kernels; cf. Maly & Petzold, Appl. Numer. Math. 20
    (1996) 57, doi:10.1016/0168-9274(95)00117-4. In contrast to this paper, the derivatives do not
    enter an error test. Only the model function is differenced, because it is an arbitrary Python
    function: dp/dparameter and the derivatives of the initial positions and velocities are
    differences of fourth order, with relative errors near 1e-12. Where the model rejects values on
    one side, such as damping < 0, differences are one-sided and of third order.

    The derivatives are those at fixed times. They can jump at events, impacts and breakpoints of
    laws whose times depend on the parameters (Galan, Feehery & Barton, Appl. Numer. Math. 31 (1999)
    17, doi:10.1016/S0168-9274(98)00125-1). In the interval before an event, the last step ends at
    the event, and its stages are those of the dense output. Steps of `GeneralizedAlpha` after an
    event are moved with its time and keep their lengths; in motions that are much too fast for the
    step, derivatives after several events can differ from differences of runs, whose steps fill the
    interval. Such runs are inaccurate themselves and violate the balance of energy.

    Parameters
    ----------
    model
        Model function.
    by
        Names of the parameters with respect to which the run is differentiated. They must be
        floats.
    integrator
        `Radau`, or `GeneralizedAlpha` in the index-3 form, whose `newton_tolerance` is reduced to
        1e-10. The derivatives do not include changes of adaptive steps. `Auto` is replaced by
        `Radau`. Defaults to `Radau(rtol=1e-5)`.
    t_end
        End time [s]. Defaults to the model's end time. It does not depend on the parameters. A run
        that an event stops is differentiated up to its end.
    output_step
        Time between rows of the result [s]. Defaults to a thousandth of the end time.
    parameters
        Values of the parameters of the model that differ from the defaults.
    start
        Start of the run, see `simulate`; not another run or its file.
    estimate_error
        True to measure `Sensitivities.errors` and those of the run, and warn of errors above 4 %,
        unless this takes more than 2 s and eight times the run.

    Returns
    -------
    Sensitivities
        The run with its derivatives.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the run fails, a parameter changes the structure of the equations
        or is at a kink of the model function, or the derivatives do not exist: two events act at
        the same time, an event acts at a breakpoint or at the end of the run, an event quantity
        only touches its value, or a parameter moves a breakpoint across the start or the end of the
        run.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` contains the result if only the estimate of
        its error is missing.

    Warns
    -----
    BeamdaeWarning
        If the run has warnings, a parameter has no effect on the model, differences of the model
        function depend on their step, or derivatives of observed columns have errors above 4 %.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def oscillator(stiffness=40.0):
    ...     mech = bd.Mechanism()
    ...     mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0), velocity=(0.2, 0.0)))
    ...     mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, stiffness))
    ...     mech.observe("mass", mass.point)
    ...     return mech
    >>> result = bd.sensitivities(oscillator, "stiffness", bd.GeneralizedAlpha(step=1e-3))
    >>> print(f"{result.sensitivity('mass.x', 'stiffness').iloc[-1]:.3e} m per N/m")
    2.481e-03 m per N/m
    """
    return assess_derivatives(
        estimate_error,
        lambda: differentiate_run(
            model, by, integrator, t_end, output_step, parameters=parameters, start=start
        ),
    )


def differentiate_run(
    model: Model,
    by: Sequence[str] | str,
    integrator: Integrator | None,
    t_end: float | None,
    output_step: float | None = None,
    *,
    parameters: Mapping[str, Any] | None,
    start: Any,
) -> Sensitivities:
    """Return the result of `sensitivities` without a check of its errors.

    Raises
    ------
    BeamdaeError
        As `sensitivities`.
    """
    names, model = select_parameters("sensitivities", model, by, parameters)
    method = require_differentiable_method(integrator)
    run = DifferentiableRun.of(model, method, start, t_end=t_end, output_step=output_step)
    return _differentiate(run, model, names)


def simulate_with(
    by: Sequence[str] | str,
    model: Any,
    integrator: Integrator | None,
    t_end: float | None,
    output_step: float | None,
    *,
    progress: Progress | None,
    start: Any,
    inputs: Mapping[str, Any] | None,
    partial: PartialResult,
) -> Solution:
    """Return the run with the derivatives of its columns with respect to the parameters in `by`.

    The other arguments are those of `simulate`. A run that does not reach its end has no
    derivatives.

    Raises
    ------
    BeamdaeError
        As `sensitivities`, or if no model function builds `model`.
    Interrupted
        As `simulate`; an interrupt of the derivatives preserves the run.
    """
    function = model_of(model) if isinstance(model, HasOrigin) else model
    if not isinstance(function, Model):
        raise BeamdaeError(
            "simulate: sensitivities need a model function (bd.model), which is called at "
            f"neighboring values of its parameters, got {short_repr(model)}; put the lines that "
            "build the model into such a function."
        )
    names = require_parameters("simulate", function, by, "sensitivities")
    if function is not model:
        rebuilt = as_equations("simulate", function(), start)
        if hash_model(rebuilt) != hash_model(as_equations("simulate", model, start)):
            raise BeamdaeError(
                f"simulate: the mechanism was changed after {function.name} had built it, so that "
                "its sensitivities are not those of this function; make the changes in "
                f"{function.name}."
            )
    if inputs is not None:
        function = transform_mechanisms(function, lambda built: built.with_inputs(inputs))
    run = DifferentiableRun.of(
        function,
        require_differentiable_method(integrator),
        start,
        t_end=t_end,
        output_step=output_step,
        progress=progress,
        partial=partial,
    )
    solution = run.solution
    if not solution.status.success:
        return solution
    try:
        result = _differentiate(run, function, names)
        columns = result.columns
        warn_of_errors(result)
    except KeyboardInterrupt:
        reason = "interrupted while the derivatives were computed"
        if partial == "raise":
            raise Interrupted(reason, solution, "simulate") from None
        acknowledge()
        return replace(solution, status=Status("interrupted", reason))
    return replace(
        solution, derivatives=replace(columns, evaluate=lambda t: result.at_times(t).columns)
    )


def _differentiate(run: DifferentiableRun, model: Model, names: Sequence[str]) -> Sensitivities:
    """Return the derivatives of a run of a model."""
    differences, derivatives = run.differentiate(names)

    def repeat(change: Callable[[Any], Any], method: Any) -> Sensitivities:
        changed = transform_mechanisms(model, change)
        return _differentiate(run.repeat(changed, method), changed, names)

    return Sensitivities(
        run.solution,
        {x: float(model.parameters[x]) for x in names},
        {x: derivatives[x].trajectory for x in names},
        differences,
        repeat,
    )
