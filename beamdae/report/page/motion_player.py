"""Animation of a mechanism as a small HTML document for notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.report.page.page_data import encode_frames
from beamdae.report.page.page_file import fill_template
from beamdae.results.displays import ANIMATION_WIDTH, Animation

_STYLES = ("page", "charts", "mechanism")
_SCRIPTS = ("decoding", "elements", "numbers", "axes", "mechanism", "player", "notebook_player")

# The drawing of the mechanism [units of its view box]; the same numbers as in script/mechanism.js.
_DRAWING_WIDTH = 420.0
_MIN_DRAWING_HEIGHT = 180.0
_MAX_DRAWING_HEIGHT = 400.0
_SCALE_BAR_HEIGHT = 16.0
_CONTROLS_HEIGHT = 150  # below the drawing [pixels]
_MIN_EXTENT = 1e-300  # avoids division by zero [m]


def build_motion_player(
    frames: Mapping[str, Any], size: tuple[float, float], caption: str, speed: float, colored: bool
) -> Animation:
    """Return a player of frames exported by `beamdae.report.scene.frame_export.export_frames`.

    Parameters
    ----------
    frames
        Times, bodies, symbols and colors.
    size
        Width and height of the visible region [m].
    caption
        Text above the drawing.
    speed
        Playback speed relative to real time.
    colored
        If true, beams start with the first of the colors.
    """
    data = {
        "frames": encode_frames(frames),
        "caption": caption,
        "speed": speed,
        "colored": colored,
    }
    document = fill_template("notebook_player", _STYLES, _SCRIPTS, data)
    height = _DRAWING_WIDTH * size[1] / max(size[0], _MIN_EXTENT)
    height = min(max(height, _MIN_DRAWING_HEIGHT), _MAX_DRAWING_HEIGHT) + _SCALE_BAR_HEIGHT
    return Animation(document, round(height * ANIMATION_WIDTH / _DRAWING_WIDTH) + _CONTROLS_HEIGHT)
