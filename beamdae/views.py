"""Functions behind the display methods of results: figures, animations and summaries.

Methods such as `Solution.plot` import this module through `results.displays.load_views`. Each
function is imported when it is first used: together, they import all analyses and pandas, which
takes longer than drawing a picture.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae import deferred
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.figures import require_picture_path, save_figure
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from beamdae.results.solution import Solution

# Module in `beamdae.report` and name of each function that is defined elsewhere.
_FUNCTIONS = {
    "animate": ("pictures.run_animation", "animate"),
    "animate_mode": ("pictures.mode_shapes", "animate_mode"),
    "draw_result": ("pictures.result_figures", "draw_result"),
    "plot_section_forces": ("pictures.section_diagrams", "plot_section_diagram"),
    "plot_time_series": ("pictures.time_plots", "plot"),
    "summarize_as_html": ("run_summary", "summarize_as_html"),
    "write_analysis_page": ("result_pages", "write_analysis_page"),
}

__all__ = ["save_plot", "write_run_page", *_FUNCTIONS]


def __getattr__(name: str) -> Callable[..., Any]:
    if name not in _FUNCTIONS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, function = _FUNCTIONS[name]
    display: Callable[..., Any] = getattr(deferred.module(f"report.{module}"), function)
    return display


def write_run_page(solution: Solution, path: Path) -> Path:
    """Write the page of a run and return its path; see `Solution.page`."""
    from beamdae.report.run_page import build_run_page

    title = str(solution.model.get("name") or "run")
    return write_page(path, build_run_page(solution, title))


def save_plot(plot: Plot, path: str | Path) -> Path:
    """Write a plot to a file and return the path of the file; see `Plot.save`."""
    return save_figure(plot.figure, require_picture_path("Plot.save", path))
