"""Static equilibrium of a mechanism under loads that are brought up by a factor."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from beamdae.analysis.statics.load_scaling import Loading, build_loading
from beamdae.analysis.statics.path_tracing import PathSettings, free_coordinate, trace_path
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeWarning, require_finite
from beamdae.linear.factorizations import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, Mechanism, require_start
from beamdae.results.equilibrium import Equilibrium
from beamdae.simulation import as_equations

Array = np.ndarray

_NAME = "equilibrium"
_WITHOUT_FRICTION = (
    "friction follows the speed of sliding and holds nothing at rest: this is where the mechanism "
    "rests without it."
)


def equilibrium(
    model: Any,
    loads: Any = None,
    to: Any = 1.0,
    control: str | None = None,
    step: float | None = None,
    switch: Any = 0,
    most_points: int = 500,
    t: float = 0.0,
    start: Any = None,
) -> Equilibrium:
    """Where a mechanism rests under its loads: its equilibria as these are brought up by a factor.

    Solves F(t, q, 0, 0; mu) + G^T lam = 0, g(t, q) = 0 along a path that begins at mu = 0 (load
    stepping), by Newton's method with the exact tangent and cut-back. Laws, drivers and moving
    loads are read at the time `t`; dampers and friction do nothing at rest (friction follows the
    speed of sliding, what it would hold by sticking slides). Stability is that under loads that
    stay: by the signs of the tangent stiffness in the motions that the joints allow, and where
    loads have no potential (follower loads) by the eigenvalues with the mass matrix.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations. The
        latter two have no loads by name: they are brought to rest as they are.
    loads
        Which loads the factor scales: names of parts that state forces alone, and "gravity".
        Default: every `Force`, `Moment`, `DistributedForce` and `MovingForce`, and gravity. Lists
        of names are stages, one after the other, each from 0 to 1; `to` is of the last. What is not
        named acts in full from the beginning.
    to
        The load factor to go to, or several one after the other; or {"tip.y": value}, the value (or
        several) of an observed position that the path is to be followed to. Each is a row of the
        path.
    control
        What is given in each step: "load", the factor (default); "displacement", the column of
        `to`, which passes limit loads (default where `to` names one); or "arc length" (Keller,
        1977), which passes turning points of the displacement as well, and goes on and never back.
    step
        The largest step: of the factor (default a tenth of the way), of the column (a twentieth),
        or by arc length of the motion, relative to the size of the mechanism or in rad (0.05).
    switch
        Leave the path at this branch point, the first is 1, on to the path that crosses it there,
        by arc length; negative: to the other side. Several: the next is counted on that path.
    most_points
        Where the path ends whatever it has reached.
    t
        Time [s] at which laws are read.
    start
        Positions to begin near, by name as in `simulate`, or the end of another path; default the
        model's own.

    Returns
    -------
    Equilibrium
        Also where the path ended early: `status` says why, and the path up to there is kept.

    Raises
    ------
    BeamdaeError
        If the model or a setting is wrong, or nothing comes to rest even without the load.

    Warns
    -----
    BeamdaeWarning
        Of a path that did not reach its end, with the last factor that did and the reason, and of
        what is not to be trusted as it stands, see `Equilibrium.warnings`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, 0.2)))
    >>> left = mech.add(bd.Spring("left", mech.ground.at(-1.0, 0.0), crown.point, 1000.0))
    >>> right = mech.add(bd.Spring("right", mech.ground.at(1.0, 0.0), crown.point, 1000.0))
    >>> press = mech.add(bd.Force("press", crown.point, (0.0, -1.0)))
    >>> mech.observe("crown", crown.point)
    >>> path = bd.equilibrium(mech, to={"crown.y": 0.0})
    >>> [(point.kind, round(point.factor, 6)) for point in path.critical]
    [('limit point', 3.019147)]
    """
    information: dict[str, Any] = {}
    if isinstance(model, Model):
        information = {"name": model.name, "parameters": model.parameters}
        model = model()
    t = require_finite(_NAME, "t", t)
    asked = PathSettings.of(to, control, step, switch, most_points)
    whole, q = _begin(model, start)
    loading = build_loading(model, whole, loads, t)
    with single_threaded:
        found = _result(loading, q, asked, information)
    told = list(found.warnings)
    if not found.status.success:
        told.insert(0, f"{information.get('name', _NAME)}: {found.status.sentence}.")
    for sentence in told:
        warnings.warn(sentence, BeamdaeWarning, stacklevel=2)
    return found


def _begin(model: Any, start: Any) -> tuple[EquationsOfMotion, Array]:
    """The equations of the whole model, and positions to begin near."""
    if isinstance(start, Equilibrium):
        whole = as_equations(_NAME, model, AS_DRAWN)
        return whole, start.starting().starting(whole).q0
    if start is None and isinstance(model, Mechanism):
        start = model.start
    if start is not None:
        start = require_start(_NAME, start, ", or another equilibrium")
    whole = as_equations(_NAME, model, AS_DRAWN if start == EQUILIBRIUM else start)
    return whole, whole.q0


def _result(
    loading: Loading, q: Array, asked: PathSettings, information: dict[str, Any]
) -> Equilibrium:
    e, time = loading.whole, loading.systems[0].under.time
    found = trace_path(loading, q, asked)
    states = np.array([point.x for point in found.points])
    rubs = any(term.rows is not None for term in e.forces)
    return Equilibrium(
        e,
        float(time[0]),
        found.status,
        loading.stages,
        found.factors,
        states[:, : e.n],
        loading.reactions(states[:, : e.n], states[:, e.n :]),
        np.array([point.stability.unstable for point in found.points]),
        found.critical,
        {**asked.told, "iterations": found.iterations},
        information,
        (_WITHOUT_FRICTION,) if rubs else (),
        free_coordinate(e, found.points[-1]),
    )
