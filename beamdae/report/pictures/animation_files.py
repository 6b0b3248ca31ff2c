"""Animated figures, and their output as GIF and MP4 files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.report.pictures.figures import require_picture_path
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

_RESOLUTION = 100  # [dots per inch]
_PALETTE_SIZE = 128  # colors of a GIF
_PALETTE_FRAMES = 8  # number of frames from which the palette is computed
# Pillow may map white to a palette color that is only close to white. Colors whose components all
# exceed this value are therefore replaced by white.
_MIN_WHITE = 240


@dataclass(frozen=True)
class FigureAnimation:
    """A figure that changes from frame to frame.

    Attributes
    ----------
    figure
        The figure with all its artists.
    show
        Function that updates the figure to a frame, given by its index.
    frames
        Number of frames.
    rate
        Frames per second.
    """

    figure: Figure
    show: Callable[[int], Any]
    frames: int
    rate: float

    def save(self, name: str, path: str | Path) -> Path:
        """Write the animation to a file and return the path.

        Parameters
        ----------
        name
            Name of the calling function, used in error messages.
        path
            Path of the file, with the suffix .gif or .mp4.

        Raises
        ------
        BeamdaeError
            If the suffix is not .gif or .mp4, ffmpeg is missing for MP4, or the file cannot be
            written.
        """
        kind = require_picture_path(name, path).suffix.lower().removeprefix(".")
        if kind not in ("gif", "mp4"):
            raise BeamdaeError(f"{name}: path {path} must end in .gif or .mp4.")
        if kind == "mp4":
            _require_ffmpeg(name)
        with atomic_write(Path(path)) as scratch:
            # The writers select the format by the suffix.
            with_suffix = scratch.with_name(f"{scratch.name}.{kind}")
            try:
                (self._save_gif if kind == "gif" else self._save_mp4)(with_suffix)
                with_suffix.replace(scratch)
            finally:
                with_suffix.unlink(missing_ok=True)
        return Path(path)

    def _save_mp4(self, path: Path) -> None:
        from matplotlib.animation import FFMpegWriter, FuncAnimation

        rate: Any = self.rate
        animation = FuncAnimation(self.figure, self.show, frames=self.frames, blit=False)
        animation.save(str(path), writer=FFMpegWriter(fps=rate), dpi=_RESOLUTION)

    def _save_gif(self, path: Path) -> None:
        """Write a GIF with one palette for all frames, so that static regions compress well."""
        from PIL.Image import Dither

        samples = np.linspace(0, self.frames - 1, min(_PALETTE_FRAMES, self.frames)).astype(int)
        palette = _create_palette(_place_side_by_side([self._render(int(k)) for k in samples]))
        images = (
            self._render(k).quantize(palette=palette, dither=Dither.NONE)
            for k in range(self.frames)
        )
        # Durations are multiples of 10 ms. Rounding the end times avoids accumulated errors.
        end_times = np.round(np.arange(self.frames + 1) * 100.0 / self.rate)
        durations = [10 * max(int(x), 1) for x in np.diff(end_times)]
        first = next(images)
        first.save(
            path, save_all=True, append_images=images, duration=durations, loop=0, optimize=False
        )

    def _render(self, frame: int) -> Image:
        from PIL import Image

        self.show(frame)
        self.figure.set_dpi(_RESOLUTION)
        canvas: Any = self.figure.canvas
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _require_ffmpeg(name: str) -> None:
    from matplotlib.animation import FFMpegWriter

    if not FFMpegWriter.isAvailable():
        raise BeamdaeError(
            f"{name}: MP4 files need the program ffmpeg, which was not found; install "
            "ffmpeg or write a GIF file."
        )


def _create_palette(image: Image) -> Image:
    """Return a palette of the colors in an image, with colors close to white replaced by white."""
    from PIL import Image

    colors = np.array(image.quantize(_PALETTE_SIZE).getpalette(), int).reshape(-1, 3)
    colors[colors.min(axis=1) > _MIN_WHITE] = 255
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors.ravel().tolist())
    return palette


def _place_side_by_side(images: list[Image]) -> Image:
    from PIL import Image

    wide = Image.new("RGB", (sum(x.width for x in images), images[0].height))
    x_offset = 0
    for image in images:
        wide.paste(image, (x_offset, 0))
        x_offset += image.width
    return wide
