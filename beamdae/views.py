"""Functions behind the display methods of results: figures, animations and summaries.

Methods such as `Solution.plot` import this module through `results.displays.load_views`.
"""

from __future__ import annotations

from pathlib import Path

from beamdae.report.analysis_pages import write_analysis_page
from beamdae.report.pictures.figures import require_picture_path, save_figure
from beamdae.report.pictures.fit_plots import plot_fit, plot_profile
from beamdae.report.pictures.path_plots import plot_path as plot_equilibrium_path
from beamdae.report.pictures.path_plots import plot_response as plot_frequency_response
from beamdae.report.pictures.run_animation import animate
from beamdae.report.pictures.section_diagrams import plot_section_diagram as plot_section_forces
from beamdae.report.pictures.time_plots import plot as plot_time_series
from beamdae.report.run_summary import summarize_as_html, summarize_certificate_as_html
from beamdae.results.displays import Plot

__all__ = [
    "animate",
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
]


def save_plot(plot: Plot, path: str | Path) -> Path:
    """Write a plot to a file and return the path of the file; see `Plot.save`."""
    return save_figure(plot.figure, require_picture_path("Plot.save", path))
