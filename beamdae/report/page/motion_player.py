"""Animation player for notebooks, as a self-contained HTML document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.report.page.page_file import fill_template
from beamdae.results.displays import ANIMATION_WIDTH, Animation

_STYLES = ("page", "charts", "mechanism")
_SCRIPTS = ("data", "numbers", "markers", "mechanism", "player", "notebook_player")

# Size of the picture [units of the SVG view box]; must agree with script/mechanism.js.
_DRAWING_WIDTH = 420.0
_MIN_DRAWING_HEIGHT = 180.0
_MAX_DRAWING_HEIGHT = 400.0
_SCALE_BAR_HEIGHT = 16.0
_CONTROLS_HEIGHT = 150  # below the picture [pixels]
_MIN_EXTENT = 1e-300  # avoids division by zero [m]


def build_motion_player(
    frames: Mapping[str, Any], size: tuple[float, float], caption: str, speed: float, colored: bool
) -> Animation:
    """Return an animation that plays exported frames in a notebook.

    Parameters
    ----------
    frames
        Frames from `beamdae.report.scene.frame_export.export_frames`.
    size
        Width and height of the visible region [m].
    caption
        Text above the animation.
    speed
        Playback speed relative to real time.
    colored
        If true, beams are initially colored by the first color quantity.
    """
    data = {
        "frames": frames,
        "caption": caption,
        "speed": speed,
        "colored": colored,
    }
    document = fill_template("notebook_player", _STYLES, _SCRIPTS, data)
    height = _DRAWING_WIDTH * size[1] / max(size[0], _MIN_EXTENT)
    height = min(max(height, _MIN_DRAWING_HEIGHT), _MAX_DRAWING_HEIGHT) + _SCALE_BAR_HEIGHT
    return Animation(document, round(height * ANIMATION_WIDTH / _DRAWING_WIDTH) + _CONTROLS_HEIGHT)
