"""HTML page of a Campbell diagram."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.errors import format_count
from beamdae.report.descriptions import describe
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import sample_evenly
from beamdae.report.page_parts import (
    create_cases,
    describe_columns,
    describe_page,
    export_table,
    slider,
)
from beamdae.report.pictures.mode_shapes import (
    choose_frequency_limit,
    describe_hidden_modes,
    export_modes,
    find_overdamped,
)

Array = np.ndarray

_MAX_MOTIONS = 120  # modes with a motion; others have none
_FREQUENCY = "frequency [Hz]"
_GROWTH_RATE = "growth rate [1/s]"
_GUIDE_POINTS = 101
_VIEW_MARGIN = 0.05  # of the frequencies shown first, relative to the largest one


def build_campbell_page(diagram: Campbell, title: str) -> Content:
    """Return the page content of a Campbell diagram: one case per mode and speed.

    The scatter plot shows the frequencies over the speed, with the multiples of the speed as lines
    and the resonances as marks.
    """
    import pandas as pd

    order = np.argsort(diagram.speeds)
    unit, key = diagram.speed_unit, f"speed [{diagram.speed_unit}]"
    speeds = diagram.speeds[order] / diagram.speed_factor
    frequencies, rates = diagram.frequencies[order], diagram.eigenvalues.real[order]
    n_modes, n_speeds = frequencies.shape[1], len(speeds)
    # Overdamped modes have no frequency.
    frequencies = np.where(find_overdamped(diagram), np.nan, frequencies)
    columns = {
        key: np.tile(speeds, n_modes),
        _FREQUENCY: frequencies.T.ravel(),
        _GROWTH_RATE: rates.T.ravel(),
    }
    table = pd.DataFrame(columns)
    frames = _export_frames(diagram, order.tolist())
    places = [(i, k) for k in range(n_modes) for i in range(n_speeds)]
    labels = [f"mode {k + 1} at {speeds[i]:.6g} {unit}" for i, k in places]
    motions = [
        {
            "family": f"mode {k + 1}",
            "series": f"mode {k + 1}",
            "rank": i,
            "at": [i, k],
            "frames": x,
        }
        for i, k in places
        for x in [frames.get((i, k))]
    ]
    resonances = describe(diagram).tables["Resonances"]
    marks = resonances[[key, _FREQUENCY]].to_numpy(float).tolist()
    guide = np.linspace(speeds[0], speeds[-1], _GUIDE_POINTS)
    revolutions = np.abs(guide) * diagram.speed_factor / (2.0 * np.pi)  # per second
    lines = [
        {"label": f"{n}\u00d7", "x": guide.tolist(), "y": (n * revolutions).tolist()}
        for n in diagram.multiples
    ]
    hidden, limit = describe_hidden_modes(diagram), choose_frequency_limit(diagram)
    view = {"y": [-_VIEW_MARGIN * limit, (1.0 + _VIEW_MARGIN) * limit]}
    return describe_page(
        title,
        f"{format_count(n_modes, 'mode')} at {format_count(n_speeds, 'speed')}"
        + (f"; {hidden} above the range shown first, Reset shows all" if hidden else ""),
        diagram.warnings,
        [export_table("Resonances", resonances)],
        time={"name": "phase", "unit": "periods"},
        noun="modes",
        leads=True,
        columns=describe_columns("mode", table),
        axes={"x": key, "y": _FREQUENCY},
        views={"scatter": view} if hidden else {},
        overlays=[
            {
                "x": key,
                "y": _FREQUENCY,
                "lines": lines,
                "marks": [{"label": "", "x": x, "y": y} for x, y in marks],
            }
        ],
        sliders=[slider("speed", speeds.tolist(), unit), slider("mode", range(1, n_modes + 1))],
        cases=create_cases(table, labels, *motions),
    )


def _export_frames(diagram: Campbell, order: list[int]) -> dict[tuple[int, int], Any]:
    """Return one animation per mode at evenly sampled speeds, by position of speed and mode.

    Shapes have the phase of the shape at the speed before.
    """
    n_modes = diagram.eigenvalues.shape[1]
    frames: dict[tuple[int, int], Any] = {}
    before: dict[int, Array] = {}
    for i in sorted(sample_evenly(len(order), max(_MAX_MOTIONS // max(n_modes, 1), 2))):
        modes = diagram.modes[order[i]]
        numbers = _find_modes(modes, diagram.eigenvalues[order[i]])
        phases = []
        for k, number in enumerate(numbers):
            product = np.vdot(modes.shapes[number], before.get(k, modes.shapes[number]))
            phases.append(product / abs(product) if product else 1.0)
            before[k] = phases[-1] * modes.shapes[number]
        exported = export_modes(modes, numbers, phases)
        frames |= {(i, k): x for k, x in enumerate(exported)}
    return frames


def _find_modes(modes: Modes, eigenvalues: Array) -> list[int]:
    """Return the numbers of the modes with these eigenvalues; equal ones in ascending order."""
    free = list(range(len(modes)))
    numbers = []
    for eigenvalue in eigenvalues:
        numbers.append(min(free, key=lambda k: abs(modes.eigenvalues[k] - eigenvalue)))
        free.remove(numbers[-1])
    return numbers
