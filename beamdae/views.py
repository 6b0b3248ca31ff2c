"""Functions behind the display methods of results: figures, animations and summaries.

Methods such as `Solution.plot` import this module through `results.displays.load_views`.
"""

from __future__ import annotations

from pathlib import Path

from beamdae.report.analysis_pages import write_analysis_page
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.figures import require_picture_path, save_figure
from beamdae.report.pictures.fit_plots import plot_fit, plot_profile
from beamdae.report.pictures.mode_shapes import draw_campbell, draw_modes
from beamdae.report.pictures.path_plots import plot_critical_loads
from beamdae.report.pictures.path_plots import plot_path as plot_equilibrium_path
from beamdae.report.pictures.path_plots import plot_response as plot_frequency_response
from beamdae.report.pictures.run_animation import animate
from beamdae.report.pictures.section_diagrams import plot_section_diagram as plot_section_forces
from beamdae.report.pictures.time_plots import plot as plot_time_series
from beamdae.report.run_page import build_run_page
from beamdae.report.run_summary import summarize_as_html, summarize_certificate_as_html
from beamdae.results.displays import Plot
from beamdae.results.solution import Solution

__all__ = [
    "animate",
    "draw_campbell",
    "draw_modes",
    "plot_critical_loads",
    "plot_equilibrium_path",
    "plot_fit",
    "plot_frequency_response",
    "plot_profile",
    "plot_section_forces",
    "plot_time_series",
    "save_plot",
    "summarize_as_html",
    "summarize_certificate_as_html",
    "write_analysis_page",
    "write_run_page",
]


def write_run_page(solution: Solution, path: Path) -> Path:
    """Write the page of a run and return its path; see `Solution.page`."""
    title = str(solution.model.get("name") or "run")
    return write_page(path, build_run_page(solution, title))


def save_plot(plot: Plot, path: str | Path) -> Path:
    """Write a plot to a file and return the path of the file; see `Plot.save`."""
    return save_figure(plot.figure, require_picture_path("Plot.save", path))
