"""Figures and animations that notebooks display, and the access to the functions that draw them."""

from __future__ import annotations

import html
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from beamdae import deferred

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ANIMATION_WIDTH = 640  # largest width of an animation in a notebook [pixels]
_NOTEBOOK_RESOLUTION = 110  # of a figure in a notebook [dots per inch]


@dataclass(frozen=True)
class Plot:
    """A figure that a notebook displays.

    Attributes
    ----------
    figure
        The matplotlib figure, which may be modified.
    """

    figure: Figure

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.figure.savefig(png, dpi=_NOTEBOOK_RESOLUTION, format="png")
        return png.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write the figure to a file and return its path.

        Parameters
        ----------
        path
            Path of the file; its suffix selects the format, for example .png, .svg or .pdf.

        Raises
        ------
        BeamdaeError
            If the suffix is missing or not supported, or the file cannot be written.
        """
        return load_views().save_plot(self, path)


@dataclass(frozen=True)
class Animation:
    """An animation that a notebook displays.

    Attributes
    ----------
    page
        Self-contained HTML document with the frames and the player.
    height
        Approximate height of the document [pixels].
    """

    page: str
    height: int

    def _repr_html_(self) -> str:
        style = (
            f"width: 100%; max-width: {ANIMATION_WIDTH}px; height: {self.height}px; border: none"
        )
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{style}" title="motion"></iframe>'


class Views(Protocol):
    """Functions of `beamdae.views` that methods of results call, with the types they return."""

    animate: Callable[..., Animation | Path]
    plot_equilibrium_path: Callable[..., Plot]
    plot_frequency_response: Callable[..., Plot]
    plot_section_forces: Callable[..., Plot]
    plot_time_series: Callable[..., Plot]
    save_plot: Callable[..., Path]
    summarize_as_html: Callable[..., str]


def load_views() -> Views:
    """Return `beamdae.views`, which draws results.

    Results hold data and depend on no drawing code; their methods `plot`, `animate`, `diagram` and
    `_repr_html_` all call through this function.
    """
    return cast("Views", deferred.module("views"))
