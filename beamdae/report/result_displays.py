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

# Pages and pictures by the class of the result: functions of this package, which take the result
# and a title. Modules are imported when one is needed: together they import all analyses.
_PAGES = {
    "Bode": "analysis_pages.build_linear_page",
    "Boundary": "analysis_pages.build_critical_loads_page",
    "Buckling": "analysis_pages.build_modes_page",
    "Campbell": "analysis_pages.build_campbell_page",
    "Equilibrium": "analysis_pages.build_path_page",
    "Fit": "analysis_pages.build_fit_page",
    "FrequencyResponse": "run_pages.build_response_page",
    "KnockDown": "analysis_pages.build_critical_loads_page",
    "LinearModel": "analysis_pages.build_linear_page",
    "Modes": "analysis_pages.build_modes_page",
    "Optimization": "analysis_pages.build_optimization_page",
    "PeriodicMotion": "run_pages.build_periodic_page",
    "Solution": "run_pages.build_run_page",
}
# Default titles of pages, with values of the result.
_TITLES = {
    "Bode": "linear model about {0.model.about}",
    "Boundary": "critical loads",
    "Buckling": "buckling modes about {0.about}",
    "Campbell": "Campbell diagram",
    "Equilibrium": "equilibria",
    "Fit": "Fit of {0.model_name}",
    "FrequencyResponse": "response over {0.parameter}",
    "KnockDown": "critical loads",
    "LinearModel": "linear model about {0.about}",
    "Modes": "modes about {0.about}",
    "Optimization": "Design of {0.model[name]}",
    "PeriodicMotion": "periodic motion",
    "Solution": "run",
}
_NAMED = ("Equilibrium", "Solution")  # whose pages have the name of the model as their title
_FIGURES = {
    "Bode": "pictures.analysis_plots.create_bode_figure",
    "Boundary": "pictures.analysis_plots.create_critical_loads_figure",
    "Buckling": "pictures.mode_shapes.create_modes_figure",
    "Campbell": "pictures.mode_shapes.create_campbell_figure",
    "Equilibrium": "pictures.analysis_plots.create_path_figure",
    "Fit": "pictures.analysis_plots.create_fit_figure",
    "FrequencyResponse": "pictures.analysis_plots.create_response_figure",
    "KnockDown": "pictures.analysis_plots.create_critical_loads_figure",
    "Modes": "pictures.mode_shapes.create_modes_figure",
    "Optimization": "pictures.drawing.create_design_figure",
    "PeriodicMotion": "pictures.time_plots.create_motion_figure",
    "ProfileLikelihood": "pictures.analysis_plots.create_profile_figure",
}
# Results whose functions also take columns, and for pictures the column of the horizontal axis.
_WITH_COLUMNS = ("Equilibrium", "FrequencyResponse", "PeriodicMotion")


def write_analysis_page(
    result: Any, path: Path, title: str | None = None, names: Sequence[str] = ()
) -> Path:
    """Write the page of the result of an analysis, such as modes or a response curve.

    Those of paths, periodic motions and response curves open on the columns `names`.
    """
    kind = type(result).__name__
    if title is None:
        name = result.model.get("name") if kind in _NAMED else None
        title = str(name or _TITLES[kind].format(result))
    chosen = (names,) if kind in _WITH_COLUMNS else ()
    return write_page(path, _import_function(_PAGES[kind])(result, title, *chosen))


def create_result_figure(
    result: Any, title: str = "", names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Return the picture of the result of an analysis; None if there is nothing to draw.

    `names` are columns, and `x` the column of the horizontal axis, of paths, periodic motions and
    response curves; by default, columns that vary.
    """
    kind = type(result).__name__
    create = _import_function(_FIGURES[kind])
    figure: Figure | None = create(result, title, *((names, x) if kind in _WITH_COLUMNS else ()))
    return figure


def draw_result(result: Any, *names: str, x: str | None = None) -> Plot:
    """Return the picture of a result for its method `plot`."""
    figure = create_result_figure(result, "", names, x)
    if figure is None:
        raise BeamdaeError(f"plot: there is nothing to draw in {short_repr(result)}.")
    return Plot(figure)


def _import_function(path: str) -> Callable[..., Any]:
    module, _, name = path.rpartition(".")
    return getattr(deferred.module(f"report.{module}"), name)
