"""Pages of results of analyses, by the class of the result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from beamdae.report.analysis_pages import (
    build_critical_loads_page,
    build_modes_page,
    build_path_page,
    build_periodic_page,
    build_response_page,
)
from beamdae.report.campbell_page import build_campbell_page
from beamdae.report.fit_page import build_fit_page
from beamdae.report.linear_page import build_linear_page
from beamdae.report.optimization_page import build_optimization_page
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_file import write_page
from beamdae.report.run_page import build_run_page


def write_analysis_page(result: Any, path: Path, title: str | None = None) -> Path:
    """Write the page of the result of an analysis, such as modes or a response curve."""
    create, default = _PAGES[type(result).__name__]
    return write_page(path, create(result, default(result) if title is None else title))


# Functions that build pages, and their default titles.
_PAGES: dict[str, tuple[Callable[[Any, str], Content], Callable[[Any], str]]] = {
    "Bode": (build_linear_page, lambda x: f"linear model about {x.model.about}"),
    "Boundary": (build_critical_loads_page, lambda _: "critical loads"),
    "Buckling": (build_modes_page, lambda x: f"buckling modes about {x.about}"),
    "Campbell": (build_campbell_page, lambda _: "Campbell diagram"),
    "Equilibrium": (build_path_page, lambda x: str(x.model.get("name", "equilibria"))),
    "Fit": (build_fit_page, lambda x: f"Fit of {x.model_name}"),
    "FrequencyResponse": (build_response_page, lambda x: f"response over {x.parameter}"),
    "KnockDown": (build_critical_loads_page, lambda _: "critical loads"),
    "LinearModel": (build_linear_page, lambda x: f"linear model about {x.about}"),
    "Modes": (build_modes_page, lambda x: f"modes about {x.about}"),
    "Optimization": (build_optimization_page, lambda x: f"Design of {x.model['name']}"),
    "Solution": (build_run_page, lambda x: str(x.model.get("name") or "run")),
    "PeriodicMotion": (build_periodic_page, lambda _: "periodic motion"),
}
