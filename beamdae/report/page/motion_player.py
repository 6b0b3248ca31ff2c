"""A motion alone: what notebooks show, by the script and the styles of the page of a study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.report.page.page_data import encode_frames
from beamdae.report.page.page_file import fill_template
from beamdae.results.displays import ANIMATION_WIDTH, Animation

_STYLES = ("page", "charts", "mechanism")
_SCRIPTS = ("data", "elements", "numbers", "axes", "mechanism", "player", "alone")
# Height of the controls below the picture [pixels].
_BELOW = 150


def build_motion_player(
    frames: Mapping[str, Any], size: tuple[float, float], caption: str, speed: float, colored: bool
) -> Animation:
    """A player of frames, see `beamdae.report.scene.frame_export.export_frames`.

    Parameters
    ----------
    size
        Width and height of what is seen [m].
    caption
        What is above it.
    speed
        Seconds of the motion in one second.
    colored
        Whether beams have the first of the colors from the start.
    """
    data = {
        "frames": encode_frames(frames),
        "caption": caption,
        "speed": speed,
        "colored": colored,
    }
    page = fill_template("alone", _STYLES, _SCRIPTS, data)
    # As the script has it: a stage of 420 by 180 to 400, and 16 more.
    tall = min(max(420.0 * size[1] / max(size[0], 1e-300), 180.0), 400.0) + 16.0
    return Animation(page, round(tall * ANIMATION_WIDTH / 420.0) + _BELOW)
