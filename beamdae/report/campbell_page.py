"""HTML page of a Campbell diagram."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.errors import BeamdaeError, format_count
from beamdae.report.page.page_content import PageContent
from beamdae.report.page.page_data import sample_evenly
from beamdae.report.pictures.mode_shapes import (
    ModeScenes,
    choose_frequency_limit,
    describe_hidden_modes,
    find_overdamped,
)
from beamdae.report.scene.frame_export import FRAMES_PER_PERIOD, export_frames
from beamdae.results.storage.files import versions

Array = np.ndarray

_GROUP = "modes"  # id of the only group of cases
_MAX_MOTIONS = 120  # modes with a motion; others have none
_SPEED = "speed [rad/s]"
_FREQUENCY = "frequency [Hz]"
_GROWTH_RATE = "growth rate [1/s]"
_COUNTS = ("mode", "multiple")
_GUIDE_POINTS = 101
_VIEW_MARGIN = 0.05  # of the frequencies shown first, relative to the largest one


def build_campbell_page(diagram: Campbell, title: str) -> PageContent:
    """Return the page content of a Campbell diagram: one case per mode and speed.

    The scatter plot shows the frequencies over the speed, with the multiples of the speed as lines
    and the resonances as marks.
    """
    order = np.argsort(diagram.speeds)
    unit, key = diagram.speed_unit, f"speed [{diagram.speed_unit}]"
    speeds = diagram.speeds[order] / diagram.speed_factor
    frequencies, rates = diagram.frequencies[order], diagram.eigenvalues.real[order]
    guide = np.linspace(speeds[0], speeds[-1], _GUIDE_POINTS)
    revolutions = diagram.speed_factor / (2.0 * np.pi)  # per second and unit of the speed
    n_modes = frequencies.shape[1]
    frames = _export_frames(diagram, order.tolist())
    resonances = diagram.resonances()
    resonances.insert(0, key, resonances.pop(_SPEED) / diagram.speed_factor)
    marks = resonances.to_dict("records")
    hidden, overdamped = describe_hidden_modes(diagram), find_overdamped(diagram)
    limit = choose_frequency_limit(diagram)
    return {
        "title": title,
        "subtitle": f"{format_count(n_modes, 'mode')} at {format_count(len(speeds), 'speed')}"
        + (f"; {hidden} above the range shown first, Reset shows all" if hidden else ""),
        "made": versions(),
        "notes": list(diagram.warnings),
        "groups": [{"id": _GROUP}],
        "time": {"name": "phase", "unit": "periods"},
        "noun": "modes",
        "leads": True,
        "columns": [
            {"key": "label", "label": "mode", "unit": "", "kind": "text"},
            {"key": key, "label": "speed", "unit": unit, "kind": "number"},
            {"key": _FREQUENCY, "label": "frequency", "unit": "Hz", "kind": "number"},
            {"key": _GROWTH_RATE, "label": "growth rate", "unit": "1/s", "kind": "number"},
        ],
        "axes": {"x": key, "y": _FREQUENCY},
        "views": {"scatter": {"y": [-_VIEW_MARGIN * limit, (1.0 + _VIEW_MARGIN) * limit]}}
        if hidden
        else {},
        "overlays": [
            {
                "x": key,
                "y": _FREQUENCY,
                "lines": [
                    {
                        "label": f"{multiple}\u00d7",
                        "x": guide.tolist(),
                        "y": (multiple * np.abs(guide) * revolutions).tolist(),
                    }
                    for multiple in diagram.multiples
                ],
                "marks": [{"label": "", "x": x[key], "y": x[_FREQUENCY]} for x in marks],
            }
        ],
        "sliders": [
            {
                "label": "speed",
                "unit": unit,
                "values": speeds.tolist(),
            },
            {
                "label": "mode",
                "unit": "",
                "values": list(range(1, n_modes + 1)),
            },
        ],
        "tables": [
            {
                "title": "Resonances",
                "head": [key, "frequency [Hz]", "mode", "excitations per revolution"],
                "rows": [
                    [f"{x[key]:.6g}", f"{x[_FREQUENCY]:.6g}", *(str(x[k]) for k in _COUNTS)]
                    for x in marks
                ],
            }
        ],
        "cases": [
            {
                "id": f"{i}-{k}",
                "group": _GROUP,
                "label": f"mode {k + 1} at {speeds[i]:.6g} {unit}",
                "family": f"mode {k + 1}",
                "series": f"mode {k + 1}",
                "rank": i,
                "at": [i, k],
                "values": {
                    key: float(speeds[i]),
                    # Overdamped modes have no frequency.
                    _FREQUENCY: float(frequencies[i, k]) if not overdamped[k] else None,
                    _GROWTH_RATE: float(rates[i, k]),
                },
                "frames": frames.get((i, k)),
            }
            for k in range(n_modes)
            for i in range(len(speeds))
        ],
    }


def _export_frames(diagram: Campbell, order: list[int]) -> dict[tuple[int, int], dict[str, Any]]:
    """Return one animation per mode at evenly sampled speeds, by position of speed and mode.

    Shapes have the phase of the shape at the speed before, so that animations can be interpolated.
    """
    n_modes = diagram.eigenvalues.shape[1]
    positions = sorted(sample_evenly(len(order), max(_MAX_MOTIONS // max(n_modes, 1), 2)))
    shares = np.linspace(0.0, 1.0, FRAMES_PER_PERIOD + 1)
    phases = np.exp(2j * np.pi * shares)
    frames: dict[tuple[int, int], dict[str, Any]] = {}
    before: dict[int, Array] = {}
    for i in positions:
        modes = diagram.modes[order[i]]
        try:
            scenes = ModeScenes("page", modes)
        except BeamdaeError:
            return {}
        for k, number in enumerate(_find_modes(modes, diagram.eigenvalues[order[i]])):
            product = np.vdot(modes.shapes[number], before.get(k, modes.shapes[number]))
            turn = product / abs(product) if product else 1.0
            before[k] = turn * modes.shapes[number]
            frames[i, k] = export_frames(scenes.vibrating(number, turn * phases), shares)
    return frames


def _find_modes(modes: Modes, eigenvalues: Array) -> list[int]:
    """Return the numbers of the modes with these eigenvalues; equal ones in ascending order."""
    free = list(range(len(modes)))
    numbers = []
    for eigenvalue in eigenvalues:
        numbers.append(min(free, key=lambda k: abs(modes.eigenvalues[k] - eigenvalue)))
        free.remove(numbers[-1])
    return numbers
