"""Figures and animations for notebooks, and access to the functions that display results."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from beamdae import deferred
from beamdae.results.storage.files import require_file_path, write_escaped_table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ANIMATION_WIDTH = 640  # maximum width of an animation in a notebook [pixels]
_NOTEBOOK_RESOLUTION = 110  # resolution of a figure in a notebook [dots per inch]


@dataclass(frozen=True)
class Plot:
    """Matplotlib figure that notebooks display and that can be written to a file.

    Attributes
    ----------
    figure
        The Matplotlib figure; it may be modified.
    """

    figure: Figure

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(
            f"Plot has no attribute {name!r}; use plot.save(path), or the Matplotlib figure "
            "plot.figure."
        )

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
        figures = deferred.module("report.pictures.figures")
        written: Path = figures.save_figure(
            self.figure, figures.require_picture_path("Plot.save", path)
        )
        return written


@dataclass(frozen=True)
class Animation:
    """Animation that notebooks display.

    Attributes
    ----------
    page
        Self-contained HTML document with the frames and a player.
    height
        Approximate height of the document [pixels].
    """

    page: str
    height: int

    def _repr_html_(self) -> str:
        # Scripts start faster without the table of all entities of HTML.
        from html import escape

        style = (
            f"width: 100%; max-width: {ANIMATION_WIDTH}px; height: {self.height}px; border: none"
        )
        return f'<iframe srcdoc="{escape(self.page)}" style="{style}" title="motion"></iframe>'


class HasCsv:
    """Base class of results of which a table is written as CSV."""

    @property
    def _written_table(self) -> pd.DataFrame:
        raise NotImplementedError

    def to_csv(self, path: str | Path, *, sep: str = ",", decimal: str = ".") -> Path:
        """Write the table of the result as CSV and return the path.

        Text that spreadsheets would evaluate as a formula is escaped.

        Parameters
        ----------
        path
            Path of the file. An existing file is replaced.
        sep, decimal
            See `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If an argument is invalid or the file cannot be written.
        """
        return write_escaped_table(path, self._written_table, sep, decimal)


class HasTable(HasCsv):
    """Base class of results with a method `table`."""

    def table(self) -> pd.DataFrame:
        """Return the result as a table."""
        raise NotImplementedError

    @property
    def _written_table(self) -> pd.DataFrame:
        return self.table()


class HasPage:
    """Base class of results of analyses that are shown on an HTML page."""

    def page(self, path: str | Path) -> Path:
        """Write an HTML page with charts, tables and, where there is one, the motion.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        return deferred.module("report.result_displays").write_analysis_page(
            self, require_file_path("page", path)
        )


class HasModeShapes(HasTable, HasPage):
    """Base class of results with mode shapes."""

    def plot(self) -> Plot:
        """Draw up to twelve mode shapes, superimposed on the state to which they belong.

        Displacements are linearized about the state of the modes and scaled to be visible.

        Raises
        ------
        BeamdaeError
            If there are no modes, or no mechanism with parts that can be drawn.
        """
        return deferred.module("report.result_displays").draw_result(self)

    def animate(
        self, mode: int, path: str | Path | None = None, frames: int = 32
    ) -> Animation | Path:
        """Animate one period of a mode, without decay or growth, in a notebook or in a file.

        Parameters
        ----------
        mode
            Number of the mode, starting at 1.
        path
            Path of a GIF or MP4 file, see `Solution.animate`. Without a path, the animation is
            displayed in a notebook.
        frames
            Number of frames per period, 2 to 500.

        Returns
        -------
        Animation or Path
            Animation for a notebook, or the path of the file.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, the mode does not exist, there is no mechanism with parts
            that can be drawn, ffmpeg is required but missing, or the file cannot be written.
        """
        return deferred.module("report.pictures.mode_shapes").animate_mode(self, mode, path, frames)
