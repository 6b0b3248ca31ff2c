"""Gain, phase and delay margins of control loops."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.optimize as opt

from beamdae.analysis.linear_dynamics.bode_diagram import find_growing_poles
from beamdae.analysis.linear_dynamics.command_loops import inject_at_command
from beamdae.analysis.linear_dynamics.linear_model import LinearModel, compute_poles, find_inputs
from beamdae.errors import (
    BeamdaeError,
    format_count,
    join_names,
    plain_text,
    require_count,
    require_finite,
    require_non_negative,
    require_positive,
    require_sequence,
    short_repr,
    suggest,
    warn_of_result,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.results.displays import HasTable

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Frequencies per decade at the start, decades around the poles, and the relative distance to which
# intervals between frequencies are divided.
_POINTS_PER_DECADE, _DECADES, _MIN_SPACING = 20, 2.0, 1e-7
_MIN_POLE = 1e-4  # [1/s]; smaller poles are zero
# Intervals are divided until the phase [rad] and the logarithm of the magnitude change by less.
_MAX_CHANGE = 0.3
_MAX_FREQUENCIES = 20_000
# Intervals are not divided where the magnitude is below the first one; phase crossovers are listed
# between the others: smaller magnitudes are resolved in part, and larger ones are those of poles.
_MIN_DIVIDED, _MIN_MAGNITUDE, _MAX_MAGNITUDE = 5e-4, 1e-3, 1e9
# Phases [rad] closer to -180 degrees are those of loops without damping, not crossovers.
_PHASE_ROUNDING = 1e-9
# Positions beside poles, in half widths of their peaks.
_NEAR_POLES = np.array([-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0])
_MIN_WIDTH = 1e-6  # relative half width
# Errors of multipliers of stiff structures, and of double ones at 1.
_MULTIPLIER_ROUNDING = 1e-7
_NYQUIST_ROUNDING = 1e-9  # of the phase of negative multipliers
_MAX_DELAY = 1000  # samples; each adds one state


class Crossover(NamedTuple):
    """Frequency at which the loop has the phase -180 degrees, or the magnitude 1.

    Attributes
    ----------
    kind
        "phase" (phase of -180 degrees) or "gain" (magnitude 1).
    frequency
        Frequency [Hz].
    gain_margin
        Factor of the gain up to which the loop does not change its stability; NaN for the kind
        "gain".
    phase_margin
        Phase above -180 degrees [deg]; NaN for the kind "phase".
    delay_margin
        Delay that turns the phase to -180 degrees [s]; NaN for the kind "phase".
    """

    kind: str
    frequency: float
    gain_margin: float
    phase_margin: float
    delay_margin: float


@dataclass(frozen=True, repr=False)
class StabilityMargins(HasTable):
    """Gain, phase and delay margins of a control loop; see `margins`.

    If there are several crossovers, the margin of the one with the smallest margin is stated: that
    of the gain with the ratio closest to 1, and that of the phase with the smallest magnitude.

    Attributes
    ----------
    gain_margin
        Factor of the gain at which the loop becomes unstable, if its phase does not change; below
        1, the gain may decrease to it. It is inf without a phase crossover.
    phase_crossover
        Frequency at which the phase is -180 degrees [Hz]; NaN if there is none.
    phase_margin
        Decrease of the phase at which the loop becomes unstable [deg]; inf without a gain
        crossover.
    gain_crossover
        Frequency at which the magnitude is 1 [Hz]; NaN if there is none.
    delay_margin
        Additional delay at which the loop becomes unstable [s]; inf without a gain crossover and
        NaN if the closed loop is unstable. In sampled loops, it is exact for whole samples.
    delay_crossover
        Gain crossover of the delay margin [Hz].
    unstable_poles
        Number of unstable poles of the closed loop.
    crossovers
        All crossovers in ascending order of their frequencies.
    every
        Interval between samples [s]; None in continuous time.
    warnings
        One warning if the closed loop is unstable.
    """

    gain_margin: float
    phase_crossover: float
    phase_margin: float
    gain_crossover: float
    delay_margin: float
    delay_crossover: float
    unstable_poles: int
    crossovers: tuple[Crossover, ...] = field(repr=False)
    every: float | None = None
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<StabilityMargins: {self}>"

    def __str__(self) -> str:
        text = f"gain margin {self.gain_margin:.4g}"
        if math.isfinite(self.gain_margin):
            text += f" ({self.gain_margin_db:.3g} dB) at {self.phase_crossover:.4g} Hz"
        text += f", phase margin {self.phase_margin:.4g} deg"
        if math.isfinite(self.phase_margin):
            text += f" at {self.gain_crossover:.4g} Hz, delay margin {self.delay_margin:.4g} s"
        stability = "stable" if self.stable else "unstable"
        return f"{text}; closed loop {stability}"

    @property
    def stable(self) -> bool:
        """True if no pole of the closed loop is unstable."""
        return self.unstable_poles == 0

    @property
    def gain_margin_db(self) -> float:
        """Gain margin [dB], 20 log10 of the factor."""
        return 20.0 * math.log10(self.gain_margin)

    def table(self) -> pd.DataFrame:
        """Return all crossovers, one row each."""
        import pandas as pd

        names = ["kind", "frequency [Hz]", "gain margin", "phase margin [deg]", "delay margin [s]"]
        return pd.DataFrame(self.crossovers, columns=names)


class _Loop(NamedTuple):
    """Loop transfer function L of x' = A x + B u, -u = C x + D u (or x_k+1), with a delay [s].

    `every` is None in continuous time; otherwise, there is no `delay`.
    """

    a: Array
    b: Array
    c: Array
    d: float
    every: float | None
    delay: float

    def at(self, f: float) -> complex:
        """Return L at a frequency [Hz]; NaN at a pole."""
        w = 2.0 * np.pi * f
        point = 1j * w if self.every is None else np.exp(1j * w * self.every)
        try:
            with np.errstate(all="ignore"):
                state = np.linalg.solve(point * np.eye(len(self.a)) - self.a, self.b + 0j)
                value = complex(self.c @ state + self.d) * np.exp(-1j * w * self.delay)
        except np.linalg.LinAlgError:
            return complex("nan")
        return complex(value)

    def poles(self, is_closed: bool) -> Array:
        """Return the poles without delay [1/s]."""
        matrix = self.a
        if is_closed:
            matrix = matrix - np.outer(self.b, self.c) / (1.0 + self.d)
        if self.every is None:
            return compute_poles(matrix)
        multipliers = np.linalg.eigvals(matrix).astype(complex)
        tiny = np.finfo(float).tiny
        logarithms = np.log(np.where(multipliers == 0.0, tiny, multipliers))
        logarithms.real[np.abs(logarithms.real) < _MULTIPLIER_ROUNDING] = 0.0
        return logarithms / self.every


@single_threaded
@interruptible
def margins(
    model: LinearModel,
    at: str | None = None,
    controller: Any = 1.0,
    *,
    every: float | None = None,
    delay: float = 0.0,
) -> StabilityMargins:
    """Compute gain, phase and delay margins of a loop that is opened at an input or a command.

    The feedback is negative: at an input u of the model, the controller K closes the loop of the
    transfer functions G from u to the outputs y by u = -K y, so that L = K G. At the command of a
    `pid`, which closes the loop in the mechanism, a disturbance w of the command u returns as
    u = -L w. The closed loop is 1 / (1 + L), and the critical point is L = -1:

    - gain margin 1 / |L| where the phase of L is -180 degrees (phase crossover),
    - phase margin 180 deg + phase of L where |L| = 1 (gain crossover at the frequency f),
    - delay margin: phase margin, from 0 to 360 deg, / (360 deg f).

    All other loops of the mechanism are closed, and other inputs are constant.

    Parameters
    ----------
    model
        Result of `linearize`.
    at
        Name of an input of the model, such as "torque" or "motor.M", or of a `pid`. Defaults to the
        only input.
    controller
        Gain of the output, one gain per output of the model, or a system of `scipy.signal` from
        these outputs to one command, in continuous or discrete time (`dt`). Only for inputs.
    every
        Interval between samples [s] of a controller that consists of gains; those of discrete
        systems is their `dt`. The plant is then discretized exactly, with the input held between
        samples (zero-order hold), as by a `Controller`, and frequencies end at 1 / (2 every).
        Defaults to None, for continuous time.
    delay
        Delay in the loop: in continuous time [s], in sampled loops a number of samples, as that of
        `Controller`.

    Returns
    -------
    StabilityMargins
        The smallest margins and all crossovers.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the input or the controller does not exist, or the command of the
        `pid` is at its limit, does not depend on the motion, or is used in a table or in a part
        other than forces, moments and states.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If the closed loop is unstable: its margins are not distances from instability.

    Notes
    -----
    A mechanism with a `Controller` cannot be linearized. For its loop, linearize the mechanism
    without it, and pass its linear law as `controller` with `every` and `delay`. Gain margins above
    1000 (60 dB) are reported as inf.

    Unstable poles with a delay in continuous time follow from those without it: a pair of poles
    crosses the imaginary axis at each delay for which L = -1 at a gain crossover, to the right if
    |L| decreases there (Walton & Marshall, IEE Proc. D 134 (1987) 101).

    Examples
    --------
    An integrator with the gain 2 1/s and a delay of 0.25 s has the phase -180 degrees at w delay =
    pi / 2, and |L| = 1 at w = 2 rad/s:

    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> valve = mech.input("valve")
    >>> level = mech.state("level", valve)
    >>> tank = bd.linearize(mech, outputs=["level"])
    >>> loop = bd.margins(tank, controller=2.0, delay=0.25)
    >>> print(f"{loop.gain_margin:.4f}, {loop.phase_margin:.2f} deg, {loop.delay_margin:.4f} s")
    3.1416, 61.35 deg, 0.5354 s
    """
    if not isinstance(model, LinearModel):
        raise BeamdaeError(
            f"margins: model must be a result of linearize, got {short_repr(model)}; pass "
            "linearize(model)."
        )
    loop = _build_loop(model, at, controller, every, delay)
    crossovers = _find_crossovers(loop)
    count = _count_unstable_poles(loop, [x.frequency for x in crossovers if x.kind == "gain"])
    warnings: tuple[str, ...] = ()
    if count:
        warnings = (
            f"margins: the closed loop is unstable ({format_count(count, 'unstable pole')}), so "
            "the margins are not distances from instability; check the sign and the gain of the "
            "controller.",
        )
    gains = [x for x in crossovers if x.kind == "phase"]
    phases = [x for x in crossovers if x.kind == "gain"]
    none = Crossover("", math.nan, math.inf, math.inf, math.inf)
    gain = min(gains, key=lambda x: abs(math.log(x.gain_margin)), default=none)
    phase = min(phases, key=lambda x: abs(x.phase_margin), default=none)
    late = min(phases, key=lambda x: x.delay_margin, default=none)
    warn_of_result(warnings)
    return StabilityMargins(
        gain.gain_margin,
        gain.frequency,
        phase.phase_margin,
        phase.frequency,
        math.nan if count else late.delay_margin,
        late.frequency,
        count,
        tuple(crossovers),
        loop.every,
        warnings,
    )


def _build_loop(model: LinearModel, at: Any, controller: Any, every: Any, delay: Any) -> _Loop:
    at, lin = plain_text(at), model._linearization
    mechanism = None if lin is None else lin.equations.mechanism
    commands = {} if mechanism is None else mechanism.outputs
    inputs = [x.name for x in model.inputs]
    if at is None and len(inputs) != 1:
        names = join_names([*inputs, *commands]) if inputs or commands else "none"
        raise BeamdaeError(
            f"margins: at must name the input or pid at which the loop is opened ({names})."
        )
    name = inputs[0] if at is None else at
    if isinstance(name, str) and name not in inputs and name in commands and lin is not None:
        is_default = type(controller) is float and controller == 1.0
        if not is_default or every is not None:
            raise BeamdaeError(
                f"margins: {name} closes the loop itself, in continuous time; omit controller and "
                "every."
            )
        closed = inject_at_command(lin, name)
        b, c = closed.B[:, 0], closed.C[0]
        # x' = A x + b (w - u), u = c x: without the feedback through w = u + disturbance.
        return _Loop(
            closed.A - np.outer(b, c),
            b,
            -c,
            0.0,
            None,
            require_non_negative("margins", "delay", delay),
        )
    columns = find_inputs(model.inputs, name)
    if len(columns) != 1:
        raise BeamdaeError(
            f"margins: there is no input or pid {short_repr(name)}"
            f"{suggest(name, [*inputs, *commands])}; use the name of an input of the linear model "
            "or of a pid."
        )
    (column,) = columns
    system, interval = _as_system(controller, len(model.outputs), every)
    if interval is None:
        plant = (model.A, model.B[:, column], model.C, model.D[:, column])
        dead_time, samples = require_non_negative("margins", "delay", delay), 0
    else:
        sampled = model.state_space(interval)
        plant = (sampled.A, sampled.B[:, column], sampled.C, sampled.D[:, column])
        dead_time, samples = 0.0, require_count("margins", "delay", delay, 0, _MAX_DELAY)
    a, b, c, d = _connect(plant, system)
    for _ in range(samples):
        # The state of a sample of delay is the value of the loop at the sample before.
        a = np.block([[a, np.zeros((len(a), 1))], [c, np.zeros((1, 1))]])
        b, c, d = np.append(b, d), np.append(np.zeros(len(c)), 1.0), 0.0
    if abs(1.0 + d) <= np.finfo(float).eps * (1.0 + abs(d)):
        raise BeamdaeError(
            f"margins: the loop at {name} is algebraic with the gain -1, so that it has no "
            "solution; change the gain, or add a delay."
        )
    return _Loop(a, b, c, d, interval, dead_time)


def _connect(
    plant: tuple[Array, Array, Array, Array], controller: tuple[Array, Array, Array, Array]
) -> tuple[Array, Array, Array, float]:
    """Return the series of a plant with one input and a controller with one output."""
    (a, b, c, d), (ak, bk, ck, dk) = plant, controller
    matrix = np.block([[a, np.zeros((len(a), len(ak)))], [bk @ c, ak]])
    return (
        matrix,
        np.concatenate([b, bk @ d]),
        np.concatenate([dk[0] @ c, ck[0]]),
        float(dk[0] @ d),
    )


def _as_system(
    controller: Any, count: int, every: Any
) -> tuple[tuple[Array, Array, Array, Array], float | None]:
    """Return the matrices of a controller with one command, and its sampling interval."""
    # Imported here because importing scipy.signal takes as long as a short run.
    from scipy.signal import dlti, lti

    interval = None if every is None else require_positive("margins", "every", every)
    if isinstance(controller, (lti, dlti)):
        system = controller.to_ss()
        a, b, c, d = (
            np.atleast_2d(np.asarray(x, float)) for x in (system.A, system.B, system.C, system.D)
        )
        if not np.size(system.A):
            a, b, c = np.zeros((0, 0)), np.zeros((0, d.shape[1])), np.zeros((len(d), 0))
        own = getattr(system, "dt", None)
        if own is not None and (isinstance(own, bool) or not own > 0.0):
            raise BeamdaeError(
                f"margins: the discrete controller must have an interval dt in s, got {own!r}."
            )
        if d.shape != (1, count):
            raise BeamdaeError(
                f"margins: controller must have {format_count(count, 'input')} (the outputs of the "
                f"linear model) and 1 output, got {d.shape[1]} and {d.shape[0]}."
            )
        if interval is not None and own != interval:
            raise BeamdaeError(
                f"margins: every = {interval:g} s differs from the interval dt of the controller, "
                f"{own if own is None else format(own, 'g')}; pass a discrete controller with this "
                "dt and omit every."
            )
        return (a, b, c, d), None if own is None else float(own)
    gains = [controller]
    if not np.isscalar(controller):
        gains = require_sequence(
            "margins", "controller", controller, "a gain, gains or a system of scipy.signal"
        )
    row = np.array([[require_finite("margins", "controller", x) for x in gains]])
    if row.shape[1] != count:
        raise BeamdaeError(
            f"margins: controller must have one gain per output of the linear model ({count}), got "
            f"{short_repr(controller)}; select outputs with linearize(outputs=...)."
        )
    return (np.zeros((0, 0)), np.zeros((0, count)), np.zeros((1, 0)), row), interval


def _find_crossovers(loop: _Loop) -> list[Crossover]:
    """Return all crossovers in ascending order of their frequencies."""
    grid, values = _sample(loop)
    crossovers = [_gain_limit(f, x) for f, x in _find_real_ends(loop)]
    sizes, angles = np.log(np.abs(values)), np.angle(-values)
    for k in range(len(grid) - 1):
        ends = float(grid[k]), float(grid[k + 1])
        if sizes[k] * sizes[k + 1] < 0.0 or sizes[k] == 0.0:
            f = _find_root(lambda x: math.log(abs(loop.at(x))), *ends)
            # From 0 to 360 degrees.
            lag = float(np.angle(-loop.at(f))) % (2.0 * np.pi)
            margin = math.degrees(lag if lag <= np.pi else lag - 2.0 * np.pi)
            crossovers.append(Crossover("gain", f, math.nan, margin, lag / (2.0 * np.pi * f)))
        is_turning = abs(angles[k]) < 0.5 * np.pi and abs(angles[k + 1]) < 0.5 * np.pi
        is_clear = max(abs(angles[k]), abs(angles[k + 1])) > _PHASE_ROUNDING
        if is_turning and is_clear and angles[k] * angles[k + 1] < 0.0:
            f = _find_root(lambda x: float(np.angle(-loop.at(x))), *ends)
            crossovers.append(_gain_limit(f, abs(loop.at(f))))
    limits = 1.0 / _MAX_MAGNITUDE, 1.0 / _MIN_MAGNITUDE
    crossovers = [
        x for x in crossovers if x.kind == "gain" or limits[0] < x.gain_margin < limits[1]
    ]
    return sorted(crossovers, key=lambda x: x.frequency)


def _gain_limit(f: float, size: float) -> Crossover:
    return Crossover("phase", f, 1.0 / size if size else math.inf, math.nan, math.nan)


def _find_root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(opt.brentq(function, low, high, xtol=1e-14 * high, rtol=1e-13))


def _find_real_ends(loop: _Loop) -> list[tuple[float, float]]:
    """Return frequency and magnitude at the ends of all frequencies where L is negative."""
    ends = [(0.0, loop.at(0.0))]
    if loop.every is not None:
        last = 0.5 / loop.every
        ends.append((last, loop.at(last)))
    elif not loop.delay:
        ends.append((math.inf, complex(loop.d)))
    return [(f, abs(x)) for f, x in ends if np.isfinite(x) and x.real < 0.0]


def _sample(loop: _Loop) -> tuple[Array, Array]:
    """Return frequencies [Hz] between which magnitude and phase change little, and the values."""
    poles = np.concatenate([loop.poles(is_closed=False), loop.poles(is_closed=True)])
    poles = poles[np.isfinite(poles) & (np.abs(poles) > _MIN_POLE)]
    scales = np.abs(poles) / (2.0 * np.pi)
    if loop.delay:
        scales = np.append(scales, 1.0 / loop.delay)
    if not len(scales):
        scales = np.ones(1)
    low = float(np.min(scales)) * 10.0**-_DECADES
    high = float(np.max(scales)) * 10.0**_DECADES
    if loop.every is not None:
        high = 0.5 / loop.every
        low = min(low, 1e-3 * high)
    count = int(_POINTS_PER_DECADE * math.log10(high / low)) + 2
    grid = [np.geomspace(low, high, count)]
    centers = np.abs(poles.imag) / (2.0 * np.pi)
    widths = np.maximum(np.abs(poles.real) / (2.0 * np.pi), _MIN_WIDTH * centers)
    near = np.add.outer(centers, np.zeros(len(_NEAR_POLES))) + np.outer(widths, _NEAR_POLES)
    grid.append(near[(near > low) & (near < high)])
    known = {float(f): loop.at(float(f)) for f in np.unique(np.concatenate(grid))}
    pending = list(pairwise(sorted(known)))
    while pending and len(known) < _MAX_FREQUENCIES:
        divided = []
        for first, last in pending:
            ends = known[first], known[last]
            if max(map(abs, ends)) < _MIN_DIVIDED or last < (1.0 + _MIN_SPACING) * first:
                continue
            change = ends[1] / ends[0] if ends[0] else complex("nan")
            if not (
                abs(np.angle(change)) < _MAX_CHANGE
                and abs(math.log(abs(change) or 1e-300)) < _MAX_CHANGE
            ):
                middle = math.sqrt(first * last)
                known[middle] = loop.at(middle)
                divided += [(first, middle), (middle, last)]
        pending = divided
    grid_values = [(f, x) for f, x in sorted(known.items()) if np.isfinite(x) and x]
    return np.array([f for f, _ in grid_values]), np.array([x for _, x in grid_values])


def _count_unstable_poles(loop: _Loop, crossovers: Sequence[float]) -> int:
    """Return the number of unstable poles of the closed loop; see `margins` for delays."""
    growing = find_growing_poles(loop.poles(is_closed=True))
    is_pair = growing.imag > 0.0
    if loop.every is not None:
        # Negative multipliers have no conjugate.
        is_pair &= growing.imag * loop.every < np.pi * (1.0 - _NYQUIST_ROUNDING)
    count = len(growing) + int(np.sum(is_pair))
    if not loop.delay:
        return count
    for f in crossovers:
        w, step = 2.0 * np.pi * f, 1e-6 * f
        is_falling = abs(loop.at(f + step)) < abs(loop.at(f - step))
        lag = float(np.angle(-loop.at(f) * np.exp(1j * w * loop.delay))) % (2.0 * np.pi)
        n_crossings = max(math.floor((w * loop.delay - lag) / (2.0 * np.pi)) + 1, 0)
        count += (2 if is_falling else -2) * n_crossings
    return max(count, 0)
