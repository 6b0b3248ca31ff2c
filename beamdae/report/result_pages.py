"""Pages of results of analyses, by the class of the result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from beamdae import deferred
from beamdae.report.page.page_file import write_page


def write_analysis_page(result: Any, path: Path, title: str | None = None) -> Path:
    """Write the page of the result of an analysis, such as modes or a response curve."""
    module, function, default = _PAGES[type(result).__name__]
    create = getattr(deferred.module(f"report.{module}"), function)
    return write_page(path, create(result, default(result) if title is None else title))


# Modules and functions that build pages, and default titles. Modules are imported when a page is
# written: together they import all analyses.
_PAGES: dict[str, tuple[str, str, Callable[[Any], str]]] = {
    "Bode": ("linear_page", "build_linear_page", lambda x: f"linear model about {x.model.about}"),
    "Boundary": ("analysis_pages", "build_critical_loads_page", lambda _: "critical loads"),
    "Buckling": ("analysis_pages", "build_modes_page", lambda x: f"buckling modes about {x.about}"),
    "Campbell": ("campbell_page", "build_campbell_page", lambda _: "Campbell diagram"),
    "Equilibrium": (
        "analysis_pages",
        "build_path_page",
        lambda x: str(x.model.get("name", "equilibria")),
    ),
    "Fit": ("fit_page", "build_fit_page", lambda x: f"Fit of {x.model_name}"),
    "FrequencyResponse": (
        "analysis_pages",
        "build_response_page",
        lambda x: f"response over {x.parameter}",
    ),
    "KnockDown": ("analysis_pages", "build_critical_loads_page", lambda _: "critical loads"),
    "LinearModel": ("linear_page", "build_linear_page", lambda x: f"linear model about {x.about}"),
    "Modes": ("analysis_pages", "build_modes_page", lambda x: f"modes about {x.about}"),
    "Optimization": (
        "optimization_page",
        "build_optimization_page",
        lambda x: f"Design of {x.model['name']}",
    ),
    "Solution": ("run_page", "build_run_page", lambda x: str(x.model.get("name") or "run")),
    "PeriodicMotion": ("analysis_pages", "build_periodic_page", lambda _: "periodic motion"),
}
