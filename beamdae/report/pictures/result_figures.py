"""Pictures of results of analyses, by the class of the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from beamdae.parts.mechanism import Mechanism

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Modules are imported when a picture is drawn: together they import all analyses.


def create_result_figure(
    result: Any, title: str, names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Return the picture of the result of an analysis; None if there is nothing to draw.

    `names` are columns, and `x` the column of the horizontal axis, of paths, periodic motions and
    response curves; by default, columns that vary.
    """
    return _FIGURES[type(result).__name__](result, title, names, x)


def _draw_modes(modes: Any, title: str, *_: Any) -> Figure | None:
    from beamdae.report.pictures.mode_shapes import create_modes_figure

    is_drawable = modes.mechanism is not None and len(modes)
    return create_modes_figure(modes, title) if is_drawable else None


def _draw_campbell(diagram: Any, title: str, *_: Any) -> Figure:
    from beamdae.report.pictures.mode_shapes import create_campbell_figure

    return create_campbell_figure(diagram, title)


def _draw_bode(diagram: Any, title: str, *_: Any) -> Figure:
    from beamdae.report.pictures.bode_plots import create_bode_figure

    return create_bode_figure(diagram, title)


def _draw_path(path: Any, title: str, names: Sequence[str], x: str | None) -> Figure:
    from beamdae.report.pictures.path_plots import create_path_figure

    return create_path_figure(path, title, names, x)


def _draw_response(response: Any, title: str, names: Sequence[str], _: Any) -> Figure | None:
    from beamdae.report.pictures.path_plots import create_response_figure

    return create_response_figure(response, title, names) if response.points else None


def _draw_motion(motion: Any, title: str, names: Sequence[str], _: Any) -> Figure | None:
    from beamdae.report.pictures.time_plots import create_figure, create_run_figure, select_plot

    columns = motion.solution.all_columns()
    if names:
        return create_figure({"run": columns}, select_plot(columns, columns, names), columns, title)
    return create_run_figure(columns, title) if motion.solution.columns else None


def _draw_fit(fit: Any, *_: Any) -> Figure:
    figure: Figure = fit.plot().figure
    return figure


def _draw_design(result: Any, *_: Any) -> Figure | None:
    best = result.mechanism()
    return best.draw().figure if isinstance(best, Mechanism) else None


_FIGURES: dict[str, Callable[..., Figure | None]] = {
    "Bode": _draw_bode,
    "Buckling": _draw_modes,
    "Campbell": _draw_campbell,
    "Equilibrium": _draw_path,
    "Fit": _draw_fit,
    "FrequencyResponse": _draw_response,
    "Modes": _draw_modes,
    "Optimization": _draw_design,
    "PeriodicMotion": _draw_motion,
}
