"""Moving pictures as GIF and as MP4."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.report.pictures.time_plots import picture_path
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

_DPI = 100
# Colors of a GIF, and how many of its frames tell which.
_COLORS, _ASKED = 128, 8
# Pillow takes any color this near to another one for it.
_WHITE = 240


@dataclass(frozen=True)
class FigureAnimation:
    """A figure that is changed from frame to frame.

    Attributes
    ----------
    figure
        With all its artists.
    show
        Makes it that of a frame.
    frames, rate
        How many, and how many a second.
    """

    figure: Figure
    show: Callable[[int], Any]
    frames: int
    rate: float

    def written(self, name: str, path: str | Path) -> Path:
        """Write it to a file; `name` asks for it.

        Raises
        ------
        BeamdaeError
            If the file is of another kind than GIF and MP4 or cannot be written.
        """
        kind = picture_path(name, path).suffix.lower().removeprefix(".")
        if kind not in ("gif", "mp4"):
            raise BeamdaeError(f"{name}: path {path} must end in .gif or .mp4.")
        if kind == "mp4":
            _require_ffmpeg(name)
        with atomic_write(Path(path)) as scratch:
            # Writers go by the suffix.
            named = scratch.with_name(f"{scratch.name}.{kind}")
            try:
                (self._gif if kind == "gif" else self._mp4)(named)
                named.replace(scratch)
            finally:
                named.unlink(missing_ok=True)
        return Path(path)

    def _mp4(self, path: Path) -> None:
        from matplotlib.animation import FFMpegWriter, FuncAnimation

        rate: Any = self.rate
        moving = FuncAnimation(self.figure, self.show, frames=self.frames, blit=False)
        moving.save(str(path), writer=FFMpegWriter(fps=rate), dpi=_DPI)

    def _gif(self, path: Path) -> None:
        """Frames share one palette: what does not change between them takes no room."""
        from PIL.Image import Dither

        asked = np.linspace(0, self.frames - 1, min(_ASKED, self.frames)).astype(int)
        palette = _palette(_side_by_side([self._picture(int(k)) for k in asked]))
        pictures = (
            self._picture(k).quantize(palette=palette, dither=Dither.NONE)
            for k in range(self.frames)
        )
        # GIFs count hundredths of a second; rounded one by one they would not add up.
        ends = np.round(np.arange(self.frames + 1) * 100.0 / self.rate)
        lasting = [10 * max(int(x), 1) for x in np.diff(ends)]
        first = next(pictures)
        first.save(
            path, save_all=True, append_images=pictures, duration=lasting, loop=0, optimize=False
        )

    def _picture(self, frame: int) -> Image:
        from PIL import Image

        self.show(frame)
        self.figure.set_dpi(_DPI)
        canvas: Any = self.figure.canvas
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _require_ffmpeg(name: str) -> None:
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise BeamdaeError(f"{name}: MP4 files need the program ffmpeg, which is not there.")


def _palette(picture: Image) -> Image:
    """The colors of a picture; what is nearly white is white, as most of it is."""
    from PIL import Image

    colors = np.array(picture.quantize(_COLORS).getpalette(), int).reshape(-1, 3)
    colors[colors.min(axis=1) > _WHITE] = 255
    found = Image.new("P", (1, 1))
    found.putpalette(colors.ravel().tolist())
    return found


def _side_by_side(pictures: list[Image]) -> Image:
    from PIL import Image

    found = Image.new("RGB", (sum(x.width for x in pictures), pictures[0].height))
    at = 0
    for one in pictures:
        found.paste(one, (at, 0))
        at += one.width
    return found
