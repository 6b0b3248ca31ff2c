"""Gain, phase and delay margins of control loops."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
import scipy.linalg as la
import scipy.optimize as opt

from beamdae.analysis.linear_dynamics.bode_diagram import frequencies_beside
from beamdae.analysis.linear_dynamics.linear_model import (
    LinearModel,
    Matrices,
    ModelInput,
    differentiate_part_laws,
    reduce_to_states,
    require_linear_model,
    transfer_matrix,
)
from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.commands import compile_commands, differentiate_laws
from beamdae.errors import (
    BeamdaeError,
    as_text,
    format_count,
    join_names,
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
from beamdae.parts.signals import State as SignalState
from beamdae.results.displays import HasTable
from beamdae.symbolic.statements import Variable

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Frequencies per decade at the start, decades around the poles, and the relative distance to which
# intervals between frequencies are divided.
_POINTS_PER_DECADE, _DECADES, _MIN_SPACING = 20, 2.0, 1e-7
# Intervals are divided until the phase [rad] and the logarithm of the magnitude change by less.
_MAX_CHANGE = 0.3
_MAX_FREQUENCIES = 20_000
# Magnitudes of listed phase crossovers: smaller ones do not matter, larger ones are those of poles.
_MIN_MAGNITUDE, _MAX_MAGNITUDE = 1e-3, 1e9
_MIN_SIZE = math.log(0.5 * _MIN_MAGNITUDE)  # logarithm of the magnitude of samples
# Phases [turns] closer to -180 degrees are those of loops without damping, not crossovers.
_PHASE_ROUNDING = 1e-9
_MULTIPLIER_ROUNDING = 1e-7  # of multipliers of stiff structures, and of double ones at 1
# Loops with a delay have a phase crossover in each turn of the phase.
_MAX_CROSSOVERS = 1000
_MAX_DELAY = 1000  # samples; each adds one state
# Shift of the inverse from which slow poles are computed, relative to the slowest pole that is not
# zero: not small, because free motions are poles at zero, and not a round number.
_SHIFT_RATIO = 0.618034
# Smaller damping ratios and relative growth rates are rounding errors.
_MIN_DAMPING_RATIO = 1e-9
_MIN_IMAGINARY_SHARE = 1e-6  # of poles; smaller ones are rounding errors of double real poles
# Poles of the closed loop are zero up to this multiple of the errors of free motions in the plant,
# and up to this share of the slowest pole.
_ERROR_RATIO, _ZERO_RATIO = 10.0, 1e-7
_FULL_TURN = 2.0 * np.pi


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


@dataclass(frozen=True, eq=False)
class _Loop:
    """Loop transfer function of a system with one input and one output, and a delay [s].

    `every` is None in continuous time; otherwise, there is no `delay`. `poles` and `closed_poles`
    are those of the open and the closed loop without delay [1/s], and `known` the values that were
    computed, by frequency.
    """

    system: Matrices
    poles: Array
    closed_poles: Array
    every: float | None = None
    delay: float = 0.0
    known: dict[float, complex] = field(default_factory=dict)

    def at(self, f: float) -> complex:
        """Return L without its delay at a frequency [Hz]; not finite at a pole."""
        if f not in self.known:
            s = 1j * _FULL_TURN * f
            point = s if self.every is None else np.exp(s * self.every)
            self.known[f] = complex(transfer_matrix(self.system, point)[0, 0])
        return self.known[f]

    def lag(self, f: float) -> float:
        """Return the phase above -180 degrees without the delay [rad], from 0 to a full turn."""
        return float(np.angle(-self.at(f))) % _FULL_TURN


def _find_poles(matrix: Array, slowest: float, every: float | None) -> Array:
    """Return the poles [1/s] of a state matrix, that of samples if `every` is not None, (states,).

    Elements of matrices of stiff structures are so large that errors of their eigenvalues, which
    are relative to the norm, exceed the slow ones. They are therefore those of the inverse of
    A - s I (shift and invert), with errors relative to its norm. Real parts within these are zero.
    The shift is relative to the magnitude of the slowest pole that is not zero.
    """
    if not matrix.size:
        return np.zeros(0, complex)
    if every is not None:
        return _poles_of_samples(np.linalg.eigvals(matrix), every)
    a, shift = la.matrix_balance(matrix, permute=False)[0], _SHIFT_RATIO * slowest
    values = np.linalg.eigvals(np.linalg.inv(a - shift * np.eye(len(a))))
    poles = shift + 1.0 / values.astype(complex)
    rounding = np.finfo(float).eps * np.max(np.abs(values)) / np.abs(values)
    poles.real[np.abs(poles.real) <= (_MIN_DAMPING_RATIO + rounding) * np.abs(poles)] = 0.0
    poles.imag[np.abs(poles.imag) <= _MIN_IMAGINARY_SHARE * np.abs(poles)] = 0.0
    return poles


def _poles_of_samples(multipliers: Array, every: float) -> Array:
    tiny = np.finfo(float).tiny
    logarithms = np.log(np.where(multipliers == 0.0, tiny, multipliers).astype(complex))
    logarithms.real[np.abs(logarithms.real) < _MULTIPLIER_ROUNDING] = 0.0
    return logarithms / every


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
    require_linear_model("margins", model)
    loop = _open_loop(model, at, controller, every, delay)
    crossovers = _find_crossovers(loop)
    none = Crossover("", math.nan, math.inf, math.inf, math.inf)
    phases = [x for x in crossovers if x.kind == "gain"]
    gains = [x for x in crossovers if x.kind == "phase"]
    gain = min(gains, key=lambda x: abs(math.log(x.gain_margin)), default=none)
    phase = min(phases, key=lambda x: abs(x.phase_margin), default=none)
    late = min(phases, key=lambda x: x.delay_margin, default=none)
    count = _count_unstable_poles(loop, [x.frequency for x in phases])
    warnings: tuple[str, ...] = ()
    if count:
        warnings = (
            f"margins: the closed loop is unstable ({format_count(count, 'unstable pole')}), so "
            "the margins are not distances from instability; check the sign and the gain of the "
            "controller.",
        )
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


def _open_loop(model: LinearModel, at: Any, controller: Any, every: Any, delay: Any) -> _Loop:
    """Return the loop, opened at an input or at the command of a `pid`."""
    inputs, lin, own = [x.name for x in model.inputs], model._linearization, model.poles
    mechanism = lin.equations.mechanism
    commands = [] if mechanism is None else list(mechanism.outputs)
    if at is None and len(inputs) == 1:
        at = inputs[0]
    if at is None:
        names = join_names([*inputs, *commands]) if inputs or commands else "none"
        raise BeamdaeError(
            f"margins: at must name the input or pid at which the loop is opened ({names})."
        )
    name = as_text(at) or ""
    if name not in inputs and name in commands:
        if every is not None or type(controller) is not float or controller != 1.0:
            raise BeamdaeError(
                f"margins: {name} closes the loop itself, in continuous time; omit controller and "
                "every."
            )
        a, b, c, d = _inject_at_command(lin, name)
        # x' = A x + b (w - u), u = c x: without the feedback through w = u + disturbance.
        dead_time = require_non_negative("margins", "delay", delay)
        opened = a - b @ c
        poles = _find_poles(opened, _slowest(own, opened), None)
        return _Loop((opened, b, -c, d), poles, own, None, dead_time)
    columns = [
        k
        for k, x in enumerate(model.inputs)
        if name in (x.name, x.header) or x.name.startswith(f"{name}.")
    ]
    if len(columns) != 1:
        raise BeamdaeError(
            f"margins: there is no input or pid {short_repr(at)}"
            f"{suggest(name, [*inputs, *commands])}; use the name of an input of the linear model "
            "or of a pid."
        )
    law, interval = _as_system(controller, len(model.outputs), every)
    if interval is None:
        plant, dead_time = model, require_non_negative("margins", "delay", delay)
    else:
        plant, dead_time = model.state_space(interval), 0.0
        samples = require_count("margins", "delay", delay, 0, _MAX_DELAY)
        # The state of a sample of delay is the value of the loop at the sample before.
        first, last = np.eye(samples)[:, :1], np.eye(samples)[-1:]
        shift = np.eye(samples, k=-1), first, last, np.zeros((1, 1))
        law = _connect(law, shift) if samples else law
    system = _connect((plant.A, plant.B[:, columns], plant.C, plant.D[:, columns]), law)
    a, b, c, d = system
    gain = float(d[0, 0])
    if abs(1.0 + gain) <= np.finfo(float).eps * (1.0 + abs(gain)):
        raise BeamdaeError(
            f"margins: the loop at {name} is algebraic with the gain -1, so that it has no "
            "solution; change the gain, or add a delay."
        )
    matrix = a - b @ c / (1.0 + gain)
    slowest = _slowest(own, matrix)
    closed, computed, poles = (_find_poles(x, slowest, interval) for x in (matrix, plant.A, law[0]))
    # Free motions have poles of zero; the computed ones show the errors of the closed loop.
    errors = np.sort(np.abs(computed))[: np.count_nonzero(own == 0.0)]
    rounding = max(_ERROR_RATIO * np.max(errors, initial=0.0), _ZERO_RATIO * slowest)
    closed[np.abs(closed) <= rounding] = 0.0
    if interval is not None:
        own = _poles_of_samples(np.exp(own * interval), interval)
    return _Loop(system, np.append(own, poles), closed, interval, dead_time)


def _slowest(poles: Array, matrix: Array) -> float:
    """Return the magnitude of the slowest pole that is not zero, or that of a state matrix."""
    sizes = np.abs(poles[poles != 0.0])
    return float(np.min(sizes) if len(sizes) else np.max(np.abs(matrix), initial=0.0) or 1.0)


def _inject_at_command(lin: Linearization, name: str) -> Matrices:
    """Return the linear model from a disturbance, added to the output of a `pid`, to this output.

    All loops are closed. The output is the command before the disturbance.
    """
    mechanism = lin.equations.mechanism
    assert mechanism is not None
    commands = compile_commands(lin.equations)
    command = next((x for x in commands if x.name.startswith(f"{name}: ")), None)
    if command is None:
        raise BeamdaeError(
            f"margins: the command of {name} does not depend on the motion, so there is no loop; "
            "use sensors in its error."
        )
    if command.has_limits:
        value, limit, distance = command.excess(lin.time, *lin.state[:2])
        if distance >= 0.0:
            raise BeamdaeError(
                f"margins: the command {value:.4g} of {name} is at or beyond its limit "
                f"{limit:.4g}, where the loop is open; linearize about a state with a command "
                "between its limits."
            )
    laws = list(differentiate_laws(mechanism, name, lin.time, lin.state))
    if not laws:
        raise BeamdaeError(
            f"margins: no law of a part contains the output of {name}; pass it to a force, a "
            "moment or a state as it is, or in a formula."
        )
    change = np.zeros(lin.equations.n + lin.equations.m)
    for part, slopes in laws:
        if isinstance(part, SignalState):
            # The row of the state is x' - rate.
            change[map_coordinates(mechanism).slice_of(part)] -= slopes[0]
        elif len(part.inputs) == len(slopes):
            inputs = differentiate_part_laws(mechanism, part, lin)
            change += sum(slope * x.change for slope, x in zip(slopes, inputs, strict=True))
        else:
            raise BeamdaeError(
                f"margins: the loop cannot be opened at {name} because {part.name} is not a force, "
                "a moment or a state; open it at an input instead."
            )
    full, data = lin.full_equations, command.value.observable.data
    shifted = slice(len(full.p) + data.start, len(full.p) + data.stop)
    extended = replace(full, p=np.concatenate([full.p, command.value.numbers]))
    disturbance = ModelInput(name, Variable(name, "-"), change)
    observable = replace(command.value.observable, data=shifted)
    closed = reduce_to_states(replace(lin, full_equations=extended), [disturbance], [observable])
    return closed.A, closed.B, closed.C[:1], np.zeros((1, 1))


def _connect(first: Matrices, second: Matrices) -> Matrices:
    """Return the series of two systems."""
    (a, b, c, d), (ak, bk, ck, dk) = first, second
    matrix = np.block([[a, np.zeros((len(a), len(ak)))], [bk @ c, ak]])
    return matrix, np.vstack([b, bk @ d]), np.hstack([dk @ c, ck]), dk @ d


def _as_system(controller: Any, count: int, every: Any) -> tuple[Matrices, float | None]:
    """Return the matrices of a controller with one command, and its sampling interval."""
    interval = None if every is None else require_positive("margins", "every", every)
    if isinstance(controller, (scipy.signal.lti, scipy.signal.dlti)):
        system = controller.to_ss()
        matrices, own = (system.A, system.B, system.C, system.D), getattr(system, "dt", None)
        is_invalid = own is True or (own is not None and not own > 0.0)
        if is_invalid or own != (interval or own):
            raise BeamdaeError(
                "margins: the interval dt of a discrete controller must be positive [s] and equal "
                f"to every, got dt = {own!r} and every = {every!r}; pass a discrete "
                "controller with its interval dt and omit every."
            )
        interval = own
    else:
        gains = [controller]
        if not np.isscalar(controller):
            gains = require_sequence(
                "margins", "controller", controller, "a gain, gains or a system of scipy.signal"
            )
        row = np.array([[require_finite("margins", "controller", x) for x in gains]])
        matrices = np.zeros((0, 0)), np.zeros((0, len(gains))), np.zeros((1, 0)), row
    if matrices[3].shape != (1, count):
        raise BeamdaeError(
            "margins: controller must have one command, and one gain or input per output of the "
            f"linear model ({count}), got {short_repr(controller)}; select outputs with "
            "linearize(outputs=...)."
        )
    return matrices, interval


def _find_crossovers(loop: _Loop) -> list[Crossover]:
    """Return all crossovers in ascending order of their frequencies."""
    f = _sample(loop)
    values = np.array([loop.at(x) for x in f.tolist()])
    sizes = np.log(np.abs(values))
    # Phases above -180 degrees [turns], continuous from the first to the last end of each interval.
    first = np.angle(-values[:-1]) / _FULL_TURN - f[:-1] * loop.delay
    last = first + np.angle(values[1:] / values[:-1]) / _FULL_TURN - np.diff(f) * loop.delay
    # Both ends of all frequencies.
    ends, crossovers = [(0.0, loop.at(0.0))], []
    if loop.every is not None:
        ends.append((0.5 / loop.every, loop.at(0.5 / loop.every)))
    elif not loop.delay:
        ends.append((math.inf, complex(loop.system[3][0, 0])))
    critical = [(x, abs(value)) for x, value in ends if np.isfinite(value) and value.real < 0.0]
    for k in np.flatnonzero((sizes[:-1] * sizes[1:] < 0.0) | (sizes[:-1] == 0.0)).tolist():
        x = _find_root(lambda x: math.log(abs(loop.at(x))), f[k], f[k + 1])
        lag = (loop.lag(x) - _FULL_TURN * x * loop.delay) % _FULL_TURN
        margin = math.degrees(lag if lag <= np.pi else lag - _FULL_TURN)
        crossovers.append(Crossover("gain", x, math.nan, margin, lag / (_FULL_TURN * x)))
    for k in np.flatnonzero(np.maximum(sizes[:-1], sizes[1:]) > _MIN_SIZE).tolist():
        low, high = sorted((first[k], last[k]))
        levels = np.arange(np.ceil(low), np.ceil(high))[: _MAX_CROSSOVERS - len(critical)]
        for level in levels[np.maximum(levels - low, high - levels) > _PHASE_ROUNDING]:

            def turns(x: float, k: int = k, level: float = level) -> float:
                change = float(np.angle(loop.at(x) / values[k])) / _FULL_TURN
                return first[k] + change - (x - f[k]) * loop.delay - level

            x = _find_root(turns, f[k], f[k + 1])
            critical.append((x, abs(loop.at(x))))
    crossovers += [
        Crossover("phase", x, 1.0 / magnitude, math.nan, math.nan)
        for x, magnitude in critical
        if _MIN_MAGNITUDE < magnitude < _MAX_MAGNITUDE
    ]
    return sorted(crossovers, key=lambda x: x.frequency)


def _find_root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(opt.brentq(function, low, high, xtol=1e-14 * high, rtol=1e-13))


def _sample(loop: _Loop) -> Array:
    """Return frequencies [Hz] between which magnitude and phase change little."""
    poles = np.concatenate([loop.poles, loop.closed_poles])
    poles = poles[np.isfinite(poles) & (poles != 0.0)]
    scales = [*(np.abs(poles) / _FULL_TURN).tolist(), *([1.0 / loop.delay] if loop.delay else [])]
    low, high = min(scales, default=1.0) / 10**_DECADES, max(scales, default=1.0) * 10**_DECADES
    if loop.every is not None:
        high = 0.5 / loop.every
        low = min(low, 1e-3 * high)
    elif not loop.system[3].any():
        # The magnitude decreases at least as the reciprocal of the frequency.
        high *= max(1.0, abs(loop.at(high)) / _MIN_MAGNITUDE)
    near = frequencies_beside(poles, np.array([-1.0, 0.0, 1.0]))
    count = int(_POINTS_PER_DECADE * math.log10(high / low)) + 2
    f = np.unique([*np.geomspace(low, high, count), *near[(near > low) & (near < high)]])
    while True:
        values = np.array([loop.at(x) for x in f.tolist()])
        with np.errstate(all="ignore"):
            change = np.log(values[1:] / values[:-1])
        is_coarse = ~(np.maximum(np.abs(change.real), np.abs(change.imag)) < _MAX_CHANGE)
        is_coarse &= ~(np.maximum(*np.abs([values[1:], values[:-1]])) < math.exp(_MIN_SIZE))
        is_coarse &= f[1:] > (1.0 + _MIN_SPACING) * f[:-1]
        if not is_coarse.any() or len(f) > _MAX_FREQUENCIES:
            return f[np.isfinite(values) & (values != 0.0)]
        f = np.sort(np.append(f, np.sqrt(f[1:] * f[:-1])[is_coarse]))


def _count_unstable_poles(loop: _Loop, crossovers: Sequence[float]) -> int:
    """Return the number of unstable poles of the closed loop; see `margins` for delays."""
    # Both poles of a pair count; negative multipliers have no conjugate but the phase pi.
    poles = loop.closed_poles
    count = int(np.sum((poles != 0.0) & (poles.real > 0.0)))
    for f in crossovers if loop.delay else ():
        is_falling = abs(loop.at((1.0 + 1e-6) * f)) < abs(loop.at((1.0 - 1e-6) * f))
        n_crossings = max(math.floor(f * loop.delay - loop.lag(f) / _FULL_TURN) + 1, 0)
        count += (2 if is_falling else -2) * n_crossings
    return max(count, 0)
