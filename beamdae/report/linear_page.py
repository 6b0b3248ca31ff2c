"""HTML page of a linear model: poles and transfer functions."""

from __future__ import annotations

import numpy as np

from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.errors import format_count
from beamdae.report.page.page_content import PageCase, PageContent, PageTable
from beamdae.results.storage.files import versions

Array = np.ndarray

_GROUP = "transfers"  # id of the only group of cases
# Smaller values, relative to those with which they are compared, are rounding noise.
_NOISE_RANGE = 1e-9
# Transfer functions below this share of the bound by the norms of matrices are rounding noise.
_TRANSFER_ROUNDING = 10.0 * np.finfo(float).eps
_QUARTILES = (0.25, 0.5, 0.75)
_MAX_POLES = 24  # in the table of a linear model
_MAX_REAL_POLES = 8  # of these; overdamped axial vibrations of beams have many
_MIN_IMAGINARY_SHARE = 1e-6  # of poles; smaller imaginary parts are rounding errors
_POLE_ROUNDING = 10.0 * np.finfo(float).eps  # of poles, relative to the largest one
_FREQUENCY_MARGIN = 10.0  # of transfer functions, below the slowest and above the listed poles
_MAX_PEAK_DAMPING = 0.7  # damping ratio above which a pole has no peak
_MAX_FREQUENCY_RATIO = 1e6  # of transfer functions
_MAX_FREQUENCIES, _MIN_FREQUENCIES = 600, 60
_FREQUENCY_WORK = 1e10  # frequencies times number of states cubed; about ten seconds
_PEAK_SHARE = 0.5  # of the frequencies are beside poles
# Distances from lightly damped poles, in half widths of their peaks.
_PEAK_POSITIONS = np.array([-6.0, -3.0, -1.5, -0.7, -0.3, 0.0, 0.3, 0.7, 1.5, 3.0, 6.0])
_MIN_PEAK_WIDTH = 1e-5  # relative half width of peaks that are resolved
# Shift of the positions beside undamped poles, where the response is infinite, and the minimum
# distance of all frequencies from these poles, in half widths.
_UNDAMPED_SHIFT, _MIN_POLE_DISTANCE = 0.1, 0.05


def build_linear_page(model: LinearModel, title: str) -> PageContent:
    """Return the page content of a linear model: its poles and one case per transfer function.

    The charts show magnitude and phase over the frequency (Bode diagram).
    """
    poles = model.poles[model.poles.imag >= 0.0]
    rounding = _POLE_ROUNDING * np.max(np.abs(poles), initial=0.0)
    described = [_describe_pole(pole, rounding) for pole in poles]
    listed = _select_poles(poles, np.array([x[-1] for x in described]))
    frequencies = _choose_frequencies(poles, listed, len(model.states))
    response = model.frequency_response(frequencies)
    pairs = [
        (i, j)
        for j, source in enumerate(model.inputs)
        for i, output in enumerate(model.outputs)
        if output.name != source.name  # The response of an input to itself is 1.
    ]
    # Those with one unit share a chart, and the first ones are selected.
    units = [_format_ratio(model.outputs[i].unit, model.inputs[j].unit) for i, j in pairs]
    sizes = np.median(np.abs(response), axis=0)
    scales = {
        unit: max(sizes[x] for x, y in zip(pairs, units, strict=True) if y == unit)
        for unit in units
    }
    noise = _TRANSFER_ROUNDING * _bound_magnitudes(model, np.quantile(frequencies, _QUARTILES))
    pairs = [pairs[k] for k in sorted(range(len(pairs)), key=lambda k: units.index(units[k]))]
    rows = [[str(k + 1), *(f"{x:.6g}" for x in described[k])] for k in listed]
    growth_rate = max((x[-1] for x in described), default=0.0)
    facts = {
        "about": model.about,
        "size": f"{format_count(len(model.states), 'state')}, "
        f"{format_count(len(model.inputs), 'input')}, "
        f"{format_count(len(model.outputs), 'output')}",
        "largest growth rate": f"{growth_rate:.6g} 1/s" if len(poles) else "-",
    }
    if len(poles) > len(listed):
        fastest = np.max(np.abs(np.delete(poles, listed)))
        facts["not listed"] = f"{len(poles) - len(listed)} poles, up to |p| = {fastest:.4g} 1/s"
    values = [
        [x.name, x.unit, "output", f"{y:.6g}"]
        for x, y in zip(model.outputs, model.output_values, strict=True)
    ]
    quantities = [*([x.name, x.unit, "input", "-"] for x in model.inputs), *values]
    tables: list[PageTable] = [
        {"title": "Linear model", "rows": list(facts.items())},
        {
            "title": "Poles",
            "head": ["pole", "frequency [Hz]", "damping ratio [-]", "growth rate [1/s]"],
            "rows": rows,
        },
        {
            "title": "Inputs and outputs",
            "head": ["name", "unit", "kind", "value at the state"],
            "rows": quantities,
        },
    ]
    return {
        "title": title,
        "subtitle": f"{facts['size']}, {format_count(len(pairs), 'transfer function')}",
        "made": versions(),
        "notes": list(model.warnings),
        "groups": [{"id": _GROUP}],
        "time": {"name": "frequency", "unit": "Hz", "log": True},
        "noun": "transfer functions",
        "axes": None,
        "columns": [
            {"key": "label", "label": "output / input", "unit": "", "kind": "text"},
            {"key": "largest", "label": "largest magnitude", "unit": "", "kind": "number"},
            {"key": "at", "label": "at frequency", "unit": "Hz", "kind": "number"},
        ],
        "tables": [table for table in tables if table["rows"]],
        "cases": [
            _build_transfer_case(
                model,
                frequencies,
                response[:, i, j],
                i,
                j,
                max(_NOISE_RANGE * scales[unit], noise[i, j]),
            )
            for (i, j), unit in zip(pairs, sorted(units, key=units.index), strict=True)
        ],
    }


def _select_poles(poles: Array, growth_rates: Array) -> list[int]:
    """Return the positions of the poles in the table: growing ones, and the slowest others.

    Of the others, at most eight are real.
    """
    is_oscillating = np.array([_is_oscillating(x) for x in poles], bool)
    is_candidate = is_oscillating | (np.cumsum(~is_oscillating) <= _MAX_REAL_POLES)
    is_listed = is_candidate & (np.cumsum(is_candidate) <= _MAX_POLES)
    return np.flatnonzero(is_listed | (growth_rates > 0.0)).tolist()


def _describe_pole(pole: complex, rounding: float) -> tuple[float, float, float]:
    """Return frequency [Hz], damping ratio [-] and growth rate [1/s].

    The real part of an oscillating pole is 0 if it is at most `rounding` [1/s].
    """
    if _is_oscillating(pole) and abs(pole.real) <= rounding:
        pole = complex(0.0, pole.imag)
    size = abs(pole)
    frequency = abs(pole.imag) / (2.0 * np.pi) if _is_oscillating(pole) else 0.0
    # Adding zero changes -0 to 0.
    return frequency, (-pole.real / size if size else 0.0) + 0.0, pole.real + 0.0


def _is_oscillating(pole: complex) -> bool:
    return abs(pole.imag) > _MIN_IMAGINARY_SHARE * abs(pole)


def _format_ratio(output_unit: str, input_unit: str) -> str:
    divisor = input_unit if input_unit.isalpha() or input_unit == "-" else f"({input_unit})"
    return f"{output_unit}/{divisor}" if divisor != "-" else output_unit


def _build_transfer_case(
    model: LinearModel, frequencies: Array, response: Array, i: int, j: int, noise: float
) -> PageCase:
    """Return a transfer function, without curves if its median magnitude is at most `noise`.

    Rounding errors are compared to medians, because peaks of undamped modes have any magnitude.
    """
    output, source = model.outputs[i], model.inputs[j]
    magnitude, largest = np.abs(response), int(np.argmax(np.abs(response)))
    size = np.median(magnitude)
    # A response that is zero but for rounding has no phase.
    is_noise = magnitude <= _NOISE_RANGE * size
    phase = np.degrees(np.unwrap(np.angle(response)))
    return {
        "id": f"{i}-{j}",
        "group": _GROUP,
        "label": f"{output.header} / {source.header}",
        "family": source.name,
        "values": {"largest": float(magnitude[largest]), "at": float(frequencies[largest])},
        "curves": {
            "t": frequencies,
            "magnitude": {f"magnitude [{_format_ratio(output.unit, source.unit)}]": magnitude},
            "phase": {"phase [deg]": np.where(is_noise, np.nan, phase)},
        }
        if size > noise
        else None,
    }


def _bound_magnitudes(model: LinearModel, frequencies: Array) -> Array:
    """Return the median over the frequencies of |C (i w I - A)^-1| |B|, w = 2 pi f.

    |.| are the norms of rows and columns. Rounding errors of the transfer matrix are proportional
    to this product, even where the response is zero by symmetry.
    """
    bounds = []
    for f in frequencies:
        shifted = 2j * np.pi * f * np.eye(len(model.A)) - model.A
        gains = np.linalg.solve(shifted.T, model.C.T.astype(complex))
        bounds.append(np.outer(np.linalg.norm(gains, axis=0), np.linalg.norm(model.B, axis=0)))
    return np.median(bounds, axis=0)


def _choose_frequencies(poles: Array, listed: list[int], n_states: int) -> Array:
    """Return frequencies [Hz] around the listed poles, denser near lightly damped ones."""
    sizes = np.abs(poles) / (2.0 * np.pi)
    known = np.sort(sizes[sizes > _NOISE_RANGE * sizes.max(initial=0.0)])
    if not len(known):
        known = np.ones(1)
    low = known[0] / _FREQUENCY_MARGIN
    peaks = [
        size
        for pole, size in zip(poles[listed], sizes[listed], strict=True)
        if _is_oscillating(pole) and abs(pole.real) < _MAX_PEAK_DAMPING * abs(pole)
    ]
    high = min(max([known[0], *peaks]) * _FREQUENCY_MARGIN, low * _MAX_FREQUENCY_RATIO)
    work = _FREQUENCY_WORK / max(n_states, 1) ** 3
    count = int(np.clip(work, _MIN_FREQUENCIES, _MAX_FREQUENCIES))
    near, undamped = [], []
    n_peaks = int(_PEAK_SHARE * count) // len(_PEAK_POSITIONS)
    for k, (pole, size) in enumerate(zip(poles, sizes, strict=True)):
        if _is_oscillating(pole):
            center, width = pole.imag / (2.0 * np.pi), abs(pole.real) / (2.0 * np.pi)
            if width <= _MIN_PEAK_WIDTH * size:
                width = _MIN_PEAK_WIDTH * size
                undamped.append((center, _MIN_POLE_DISTANCE * width))
                center += _UNDAMPED_SHIFT * width
            if k < n_peaks:
                near.append(center + width * _PEAK_POSITIONS)
    near_poles = np.concatenate([np.zeros(0), *near])
    near_poles = near_poles[(near_poles > low) & (near_poles < high)]
    grid = np.geomspace(low, high, max(count - len(near_poles), 2))
    frequencies = np.unique(np.concatenate([grid, near_poles]))
    for center, distance in undamped:
        frequencies = frequencies[np.abs(frequencies - center) >= distance]
    return frequencies
