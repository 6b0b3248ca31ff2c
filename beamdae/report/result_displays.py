"""Pages and pictures of the results of analyses, by the class of the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae import deferred
from beamdae.errors import BeamdaeError, short_repr
from beamdae.report.page.page_file import write_page
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Pages and pictures by the class of the result: modules of this package with functions of the
# result and a title. Modules are imported when one is needed: together they import all analyses.
_PAGES = {
    "Bode": ("analysis_pages", "build_linear_page"),
    "Boundary": ("analysis_pages", "build_critical_loads_page"),
    "Buckling": ("analysis_pages", "build_modes_page"),
    "Campbell": ("analysis_pages", "build_campbell_page"),
    "Equilibrium": ("analysis_pages", "build_path_page"),
    "Fit": ("parameter_pages", "build_fit_page"),
    "FrequencyResponse": ("run_pages", "build_response_page"),
    "KnockDown": ("analysis_pages", "build_critical_loads_page"),
    "LinearModel": ("analysis_pages", "build_linear_page"),
    "Modes": ("analysis_pages", "build_modes_page"),
    "Optimization": ("parameter_pages", "build_optimization_page"),
    "PeriodicMotion": ("run_pages", "build_periodic_page"),
    "Solution": ("run_pages", "build_run_page"),
}
# Default titles of pages.
_TITLES: dict[str, Callable[[Any], str]] = {
    "Bode": lambda x: f"linear model about {x.model.about}",
    "Boundary": lambda _: "critical loads",
    "Buckling": lambda x: f"buckling modes about {x.about}",
    "Campbell": lambda _: "Campbell diagram",
    "Equilibrium": lambda x: str(x.model.get("name", "equilibria")),
    "Fit": lambda x: f"Fit of {x.model_name}",
    "FrequencyResponse": lambda x: f"response over {x.parameter}",
    "KnockDown": lambda _: "critical loads",
    "LinearModel": lambda x: f"linear model about {x.about}",
    "Modes": lambda x: f"modes about {x.about}",
    "Optimization": lambda x: f"Design of {x.model['name']}",
    "PeriodicMotion": lambda _: "periodic motion",
    "Solution": lambda x: str(x.model.get("name") or "run"),
}
_FIGURES = {
    "Bode": ("pictures.analysis_plots", "create_bode_figure"),
    "Boundary": ("pictures.analysis_plots", "create_critical_loads_figure"),
    "Buckling": ("pictures.mode_shapes", "create_modes_figure"),
    "Campbell": ("pictures.mode_shapes", "create_campbell_figure"),
    "Equilibrium": ("pictures.analysis_plots", "create_path_figure"),
    "Fit": ("pictures.analysis_plots", "create_fit_figure"),
    "FrequencyResponse": ("pictures.analysis_plots", "create_response_figure"),
    "KnockDown": ("pictures.analysis_plots", "create_critical_loads_figure"),
    "Modes": ("pictures.mode_shapes", "create_modes_figure"),
    "Optimization": ("pictures.drawing", "create_design_figure"),
    "PeriodicMotion": ("pictures.time_plots", "create_motion_figure"),
    "ProfileLikelihood": ("pictures.analysis_plots", "create_profile_figure"),
}
# Results whose functions also take columns, and the column of the horizontal axis.
_WITH_COLUMNS = ("Equilibrium", "FrequencyResponse", "PeriodicMotion")


def write_analysis_page(result: Any, path: Path, title: str | None = None) -> Path:
    """Write the page of the result of an analysis, such as modes or a response curve."""
    kind = type(result).__name__
    create = _import_function(*_PAGES[kind])
    return write_page(path, create(result, _TITLES[kind](result) if title is None else title))


def create_result_figure(
    result: Any, title: str = "", names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Return the picture of the result of an analysis; None if there is nothing to draw.

    `names` are columns, and `x` the column of the horizontal axis, of paths, periodic motions and
    response curves; by default, columns that vary.
    """
    kind = type(result).__name__
    create = _import_function(*_FIGURES[kind])
    figure: Figure | None = create(result, title, *((names, x) if kind in _WITH_COLUMNS else ()))
    return figure


def draw_result(result: Any, *names: str, x: str | None = None) -> Plot:
    """Return the picture of a result for its method `plot`."""
    figure = create_result_figure(result, "", names, x)
    if figure is None:
        raise BeamdaeError(f"plot: there is nothing to draw in {short_repr(result)}.")
    return Plot(figure)


def _import_function(module: str, function: str) -> Callable[..., Any]:
    return getattr(deferred.module(f"report.{module}"), function)
