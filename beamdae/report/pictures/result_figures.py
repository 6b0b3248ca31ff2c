"""Pictures of results of analyses, by the class of the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from beamdae import deferred
from beamdae.errors import BeamdaeError, short_repr
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Modules and functions of a result and a title. Modules are imported when a picture is drawn:
# together they import all analyses.
_FIGURES = {
    "Bode": ("bode_plots", "create_bode_figure"),
    "Boundary": ("path_plots", "create_critical_loads_figure"),
    "Buckling": ("mode_shapes", "create_modes_figure"),
    "Campbell": ("mode_shapes", "create_campbell_figure"),
    "Equilibrium": ("path_plots", "create_path_figure"),
    "Fit": ("fit_plots", "create_fit_figure"),
    "FrequencyResponse": ("path_plots", "create_response_figure"),
    "KnockDown": ("path_plots", "create_critical_loads_figure"),
    "Modes": ("mode_shapes", "create_modes_figure"),
    "Optimization": ("drawing", "create_design_figure"),
    "PeriodicMotion": ("time_plots", "create_motion_figure"),
    "ProfileLikelihood": ("fit_plots", "create_profile_figure"),
}
# Results whose functions also take columns, and the column of the horizontal axis.
_WITH_COLUMNS = ("Equilibrium", "FrequencyResponse", "PeriodicMotion")


def create_result_figure(
    result: Any, title: str = "", names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Return the picture of the result of an analysis; None if there is nothing to draw.

    `names` are columns, and `x` the column of the horizontal axis, of paths, periodic motions and
    response curves; by default, columns that vary.
    """
    kind = type(result).__name__
    module, function = _FIGURES[kind]
    create = getattr(deferred.module(f"report.pictures.{module}"), function)
    figure: Figure | None = create(result, title, *((names, x) if kind in _WITH_COLUMNS else ()))
    return figure


def draw_result(result: Any, *names: str, x: str | None = None) -> Plot:
    """Return the picture of a result for its method `plot`."""
    figure = create_result_figure(result, "", names, x)
    if figure is None:
        raise BeamdaeError(f"plot: there is nothing to draw in {short_repr(result)}.")
    return Plot(figure)
