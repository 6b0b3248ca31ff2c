"""Output of animated figures as GIF and MP4 files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.errors import BeamdaeError
from beamdae.report.pictures.figures import require_picture_path
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RESOLUTION = 100  # [dots per inch]


def save_animation(
    name: str, path: str | Path, figure: Figure, show: Callable[[int], Any], frames: int, rate: Any
) -> Path:
    """Write an animation to a file and return the path.

    Parameters
    ----------
    name
        Name of the calling function, used in error messages.
    path
        Path of the file, with the suffix .gif or .mp4.
    figure
        The figure with all its artists.
    show
        Function that updates the figure to a frame, given by its index.
    frames
        Number of frames.
    rate
        Frames per second.

    Raises
    ------
    BeamdaeError
        If the suffix is not .gif or .mp4, ffmpeg is missing for MP4, or the file cannot be written.
    """
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter

    kind = require_picture_path(name, path).suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise BeamdaeError(f"{name}: path {path} must end in .gif or .mp4.")
    if kind == ".mp4" and not FFMpegWriter.isAvailable():
        raise BeamdaeError(
            f"{name}: MP4 files need the program ffmpeg, which was not found; install "
            "ffmpeg or write a GIF file."
        )
    writer = PillowWriter(rate) if kind == ".gif" else FFMpegWriter(rate)
    with atomic_write(Path(path)) as scratch:
        animation = FuncAnimation(figure, show, frames=frames, blit=False)
        # The writers select the format by the suffix.
        with_suffix = scratch.with_name(f"{scratch.name}{kind}")
        try:
            animation.save(str(with_suffix), writer=writer, dpi=_RESOLUTION)
            with_suffix.replace(scratch)
        finally:
            with_suffix.unlink(missing_ok=True)
    return Path(path)
