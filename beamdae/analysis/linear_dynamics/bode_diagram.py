"""Frequency response of a linear model: magnitude and phase of its transfer functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from beamdae import deferred
from beamdae.analysis.eigenproblems.eigensolution import UNSTABLE, classify_modes
from beamdae.analysis.linear_dynamics.linear_model import (
    LinearModel,
    compute_linear_model,
    require_linear_model,
)
from beamdae.analysis.linear_dynamics.linearization import searched_start
from beamdae.errors import (
    BeamdaeError,
    format_count,
    require_pair,
    require_positive,
    require_sequence,
    short_repr,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.read_only import read_only_data
from beamdae.results.columns import largest_by
from beamdae.results.displays import HasPage, HasTable, Plot
from beamdae.symbolic.statements import Variable

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_QUARTILES = (0.25, 0.5, 0.75)
_MAX_VIBRATIONS = 24  # in the default range
_FREQUENCY_MARGIN = 10.0  # of the range, below the slowest pole and above the fastest vibration
_MIN_RANGE = 3.0  # of the range above the lowest resonance, also if its error is large
_MAX_PEAK_DAMPING = 0.7  # damping ratio above which a pole has no peak
_MAX_FREQUENCY_RATIO = 1e6  # of the range
_MAX_FREQUENCIES, _MIN_FREQUENCIES = 600, 60
_FREQUENCY_WORK = 1e10  # frequencies times number of states cubed; about ten seconds
# Frequencies beside poles, in half widths of their peaks: at 1, the response has half of the power
# of the peak. The half width is at least this share of the frequency.
_PEAK_POSITIONS = np.outer([-1.0, 1.0], [0.3, 0.7, 1.0, 1.5, 3.0, 6.0]).ravel()
_MIN_WIDTH = 1e-6
# Minimum ratio of listed peaks to the response beside them. Rounding errors cause lower ones, most
# of all at undamped modes that the input does not excite; those that it excites are far higher.
_MIN_PEAK_RATIO, _MIN_UNDAMPED_RATIO = 1.01, 2.0**0.5
_NOISE_RANGE = 1e-9  # smaller values, relative to those with which they are compared, are rounding


class TransferFunction(NamedTuple):
    """Transfer function from one input to one output.

    Attributes
    ----------
    name
        Names and units of output and input, such as "tip.y [m] / push.Fy [N]".
    output, input
        Indices of the output and the input.
    unit
        Unit of output per unit of input.
    response
        Complex values at the frequencies, (k,).
    is_noise
        True if the response is zero but for rounding errors.
    """

    name: str
    output: int
    input: int
    unit: str
    response: Array
    is_noise: bool

    @property
    def phase(self) -> Array:
        """Continuous phase [deg]."""
        return np.degrees(np.unwrap(np.angle(self.response)))


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Bode(HasTable, HasPage):
    """Magnitude and phase of the transfer functions of a linear model; see `bode`.

    Attributes
    ----------
    model
        The linear model.
    frequencies
        Frequencies [Hz], (k,), ascending.
    response
        Complex transfer matrices, (k, outputs, inputs), in units of output per unit of input.
    """

    model: LinearModel
    frequencies: Array
    response: Array = field(repr=False)
    _remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        first, last = self.frequencies[[0, -1]].tolist()
        count = len(self.model.outputs) * len(self.model.inputs)
        return (
            f"<Bode: {format_count(count, 'transfer function')} at {len(self.frequencies)} "
            f"frequencies, {first:g} to {last:g} Hz>"
        )

    @cached_property
    def errors(self) -> Any:
        """Errors of the natural frequencies and the transfer functions, see `Errors`.

        They are measured by a model of refined beams, and relative to the frequency or to the
        largest magnitude.
        """
        return self.model.measure_errors(self.frequencies, self.response)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the linear model, and those that `bode` issues."""
        return (*self.model.warnings, *self._remarks, *self.errors.sentences())

    @cached_property
    @single_threaded
    def transfer_functions(self) -> tuple[TransferFunction, ...]:
        """Transfer functions between different quantities; those with one unit are adjacent."""
        model, sizes = self.model, np.median(np.abs(self.response), axis=0)
        pairs = [
            (i, j, divide_units(output, source))
            for j, source in enumerate(model.inputs)
            for i, output in enumerate(model.outputs)
            if output.name != source.name  # The response of an input to itself is 1.
        ]
        largest = largest_by((unit for *_, unit in pairs), (sizes[i, j] for i, j, _ in pairs))
        pairs.sort(key=lambda x: list(largest).index(x[2]))
        noise = model.bound_rounding(np.quantile(self.frequencies, _QUARTILES))
        return tuple(
            TransferFunction(
                f"{model.outputs[i].header} / {model.inputs[j].header}",
                i,
                j,
                unit,
                self.response[:, i, j],
                # Medians, because peaks of undamped modes have any magnitude.
                bool(sizes[i, j] <= max(_NOISE_RANGE * largest[unit], noise[i, j])),
            )
            for i, j, unit in pairs
        )

    def table(self) -> pd.DataFrame:
        """Return magnitudes, in output per input, and phases [deg] over the frequency [Hz]."""
        import pandas as pd

        columns: dict[str, Array] = {"frequency [Hz]": self.frequencies}
        for x in self.transfer_functions:
            name = self._short_name(x)
            columns[f"{name} magnitude [{x.unit}]"] = np.abs(x.response)
            columns[f"{name} phase [deg]"] = x.phase
        return pd.DataFrame(columns)

    def peak_table(self) -> pd.DataFrame:
        """Return the peak of each resonance, and the largest magnitude if it is none, by rows.

        Peaks are omitted if they are below 1e-9 of the largest magnitude of their transfer
        function, or less than 1 % above the response beside them. Those of undamped modes (damping
        ratios below 1e-6) are infinite. Natural frequencies closer than 1e-6 are one resonance.
        Peaks between the frequencies of the diagram are interpolated; their phases are within 180
        degrees.
        """
        import pandas as pd

        f, poles = self.frequencies, np.sort_complex(1j * self.model.poles.conj())
        poles = poles[poles.real >= 0.0] if len(poles) else np.zeros(1, complex)
        first = np.diff(poles.real, prepend=-np.inf) > _MIN_WIDTH * poles.real
        centers, is_undamped = poles.real[first] / (2.0 * np.pi), _are_undamped(poles[first] / 1j)
        nearest = np.argmin(np.abs(np.subtract.outer(f, centers)), axis=1)
        is_pole = is_undamped[nearest] & (np.abs(f - centers[nearest]) <= _MIN_WIDTH * f)
        prominence = np.log(np.where(is_pole, _MIN_UNDAMPED_RATIO, _MIN_PEAK_RATIO))
        rows = []
        for x in self.transfer_functions:
            if x.is_noise:
                continue
            size = np.abs(x.response)
            levels = np.log(np.maximum(size, _NOISE_RANGE * size.max()))
            peaks = scipy.signal.find_peaks(levels, prominence=prominence)[0].tolist()
            # Rounding errors divide the peaks of nearly undamped resonances.
            highest = {nearest[k]: k for k in sorted(peaks, key=size.__getitem__)}
            for k in sorted({*highest.values(), int(np.argmax(size))}):
                frequency, value = f[k], x.response[k]
                if k in peaks:
                    near = slice(k - 1, k + 2)
                    frequency, value = _interpolate_peak(f[near], x.response[near])
                peak = (frequency, abs(value), x.unit, np.degrees(np.angle(value)))
                if is_pole[k]:
                    peak = (centers[nearest[k]], np.inf, x.unit, np.nan)
                rows.append((self._short_name(x), *peak, k in peaks))
        names = ["output / input", "frequency [Hz]", "magnitude", "unit", "phase [deg]", "peak"]
        return pd.DataFrame(rows, columns=names)

    def plot(self) -> Plot:
        """Draw magnitudes and phases over the frequency, of up to six transfer functions."""
        return deferred.module("report.result_displays").draw_result(self)

    def _short_name(self, x: TransferFunction) -> str:
        return f"{self.model.outputs[x.output].name} / {self.model.inputs[x.input].name}"


@single_threaded
@interruptible
def bode(
    model: LinearModel,
    frequencies: Sequence[float] | None = None,
    between: tuple[float, float] | None = None,
    *,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> Bode:
    """Compute magnitude and phase of the transfer functions of a linear model (Bode diagram).

    The transfer matrix is G = C (i w I - A)^-1 B + D with w = 2 pi f. This is the steady response
    to sinusoidal inputs that are small; `frequency_response` computes nonlinear periodic motions.

    Parameters
    ----------
    model
        Result of `linearize`.
    frequencies
        Frequencies f [Hz]. Defaults to up to 600 frequencies with equal ratios, the natural
        frequencies between them with the frequencies at which resonances have half of their power,
        and further ones near the slowest resonances, so that no peak is missed.
    between
        Smallest and largest of the default frequencies [Hz]. Defaults to a tenth of the lowest and
        ten times the highest one of the first 24 natural frequencies. It ends before, but not below
        three times the lowest one, where the first natural frequency has an error of more than
        1 %.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to all natural frequencies
        and transfer functions.

    Returns
    -------
    Bode
        The transfer functions, with `table`, `peak_table`, `plot` and `page`.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, both arguments are given, or the response is infinite at one of
        the given frequencies.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If the model is unstable, or `Bode.errors` exceed 4 %; they are measured unless warnings are
        filtered out.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> mass = mech.add(bd.PointMass("mass", 2.0, at=(1.0, 0.0)))
    >>> rail = mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point))
    >>> ends = mech.ground.at(0.0, 0.0), mass.point
    >>> spring = mech.add(bd.Spring("spring", *ends, stiffness=200.0, damping=1.0))
    >>> push = mech.add(bd.Force("push", mass.point, (0.0, 0.0)))
    >>> mech.observe("mass", mass.point)
    >>> diagram = bd.bode(bd.linearize(mech, inputs=["push"], outputs=["mass.x"]))
    >>> peak = diagram.peak_table().iloc[0]
    >>> print(f"{peak['magnitude']:.4f} {peak['unit']} at {peak['frequency [Hz]']:.3f} Hz")
    0.1000 m/N at 1.591 Hz
    """
    require_linear_model("bode", model)
    if frequencies is not None and between is not None:
        raise BeamdaeError("bode: frequencies and between are mutually exclusive; omit one.")
    values, ends = None, None
    if frequencies is not None:
        given = require_sequence("bode", "frequencies", frequencies, "a list [Hz]")
        values = np.unique([require_positive("bode", "frequencies", f) for f in given])
        if not len(values):
            raise BeamdaeError("bode: frequencies must contain at least one value [Hz], got none.")
    elif between is not None:
        first, last = (
            require_positive("bode", "between", x) for x in require_pair("bode", "between", between)
        )
        if not first < last:
            raise BeamdaeError(f"bode: between must ascend, got {short_repr(between)}.")
        ends = first, last
    lin, request = model._linearization, model._request
    if accuracy is not None and request is None:
        raise BeamdaeError("bode: accuracy requires a linearized mechanism.")
    mechanism = lin.full_equations.mechanism

    def analyze(refined: Any, _: Any) -> Bode:
        linear = model
        if refined is not mechanism and request is not None:
            linear = compute_linear_model(refined, request)
        return _compute_bode(linear, values, ends)

    until = deferred.module("accuracy.until")
    start = searched_start("bode", None if request is None else request.about, accuracy)
    analysis = until.Analysis("bode", analyze, start=start)
    diagram = until.reach_accuracy(analysis, mechanism, accuracy, accuracy_columns)
    if not warnings_are_ignored():
        warn_of_result((*diagram._remarks, *diagram.errors.sentences()))
    return diagram


def _compute_bode(
    model: LinearModel, values: Array | None, ends: tuple[float, float] | None
) -> Bode:
    """Return the result of `bode` without issuing warnings."""
    if values is None:
        values = _choose_frequencies(model, ends)
    response = model.evaluate_response(values.tolist())
    remarks: tuple[str, ...] = ()
    if UNSTABLE in classify_modes(model.poles):
        rate = float(np.max(model.poles.real))
        remarks = (
            f"the linear model is unstable (largest growth rate {rate:.4g} 1/s), so motions do not "
            "settle to this response; linearize about a stable state, or close the control loop.",
        )
    return Bode(model, values, response, remarks)


def _choose_frequencies(model: LinearModel, ends: tuple[float, float] | None) -> Array:
    """Return frequencies [Hz] around the slow poles, or between `ends` [Hz].

    They contain all natural frequencies and half-power frequencies.
    """
    poles = model.poles[model.poles.imag >= 0.0]
    vibrations = poles[poles.imag > 0.0]
    if ends is None:
        sizes = np.abs(poles[poles != 0.0]) / (2.0 * np.pi)
        slowest = float(sizes[0]) if len(sizes) else 1.0
        is_peak = np.abs(vibrations.real) < _MAX_PEAK_DAMPING * np.abs(vibrations)
        peaks = (np.abs(vibrations[is_peak]) / (2.0 * np.pi)).tolist()[:_MAX_VIBRATIONS]
        low, first = slowest / _FREQUENCY_MARGIN, min(peaks, default=slowest)
        high = min(_FREQUENCY_MARGIN * max([slowest, *peaks[-1:]]), low * _MAX_FREQUENCY_RATIO)
        resolved = deferred.module("accuracy.linear_models").find_resolved_frequency(model, high)
        ends = low, min(high, max(resolved, _MIN_RANGE * first))
    low, high = ends
    work = _FREQUENCY_WORK / max(len(model.states), 1) ** 3
    count = int(np.clip(work, _MIN_FREQUENCIES, _MAX_FREQUENCIES))
    damped = vibrations[~_are_undamped(vibrations)]
    near = np.append(frequencies_beside(vibrations), damped.imag / (2.0 * np.pi))
    near = near[(near > low) & (near < high)]
    grid = np.geomspace(low, high, max(count - len(near), _MIN_FREQUENCIES // 2))
    return np.unique(np.append(grid, near))


def frequencies_beside(poles: Array, positions: Array = _PEAK_POSITIONS) -> Array:
    """Return frequencies [Hz] beside the peaks of poles, at positions in their half widths."""
    centers = np.abs(poles.imag) / (2.0 * np.pi)
    widths = np.maximum(np.abs(poles.real) / (2.0 * np.pi), _MIN_WIDTH * centers)
    return np.ravel(centers[:, None] + widths[:, None] * positions)


def _interpolate_peak(f: Array, response: Array) -> tuple[float, complex]:
    """Return the frequency and the response of a peak between three frequencies.

    1 / H is a quadratic polynomial of the frequency for an oscillator, and its squared magnitude
    one of the squared frequency.
    """
    squares = f**2 - f[1] ** 2
    a, b, _ = np.polyfit(squares, np.abs(response[1] / response) ** 2, 2)
    lowest = np.clip(-0.5 * b / a, *squares[[0, 2]]) if a > 0.0 else 0.0
    frequency = float(np.sqrt(f[1] ** 2 + lowest))
    ratio = np.polyval(np.polyfit(f - f[1], response[1] / response, 2), frequency - f[1])
    return frequency, complex(response[1] / ratio)


def _are_undamped(poles: Array) -> Array:
    """Return the mask of poles at whose frequencies responses are infinite."""
    return np.asarray(np.abs(poles.real) <= _MIN_WIDTH * np.abs(poles))


def divide_units(output: Variable, source: Variable) -> str:
    """Return the unit of an output per unit of an input."""
    divisor = source.unit if source.unit.isalpha() or source.unit == "-" else f"({source.unit})"
    return f"{output.unit}/{divisor}" if divisor != "-" else output.unit
