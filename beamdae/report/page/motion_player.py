"""A motion alone: what notebooks show, by the script and the styles of the page of a study."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from beamdae.report.page.encoding import stored_frames
from beamdae.report.page.template import filled

_STYLES = ("page", "charts", "mechanism")
_SCRIPTS = ("data", "elements", "numbers", "axes", "mechanism", "player", "alone")
# Of the picture and of what is below it [pixels].
_WIDTH, _BELOW = 640, 150


@dataclass(frozen=True)
class Animation:
    """Moving pictures a notebook shows.

    Attributes
    ----------
    page
        An HTML document that needs nothing else.
    height
        Of the document, about [pixels].
    """

    page: str
    height: int

    def _repr_html_(self) -> str:
        look = f"width: 100%; max-width: {_WIDTH}px; height: {self.height}px; border: none"
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{look}" title="motion"></iframe>'


def animation(
    frames: Mapping[str, Any], size: tuple[float, float], caption: str, speed: float, colored: bool
) -> Animation:
    """A player of frames, see `beamdae.report.scene.scene_frames.plain_frames`.

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
        "frames": stored_frames(frames),
        "caption": caption,
        "speed": speed,
        "colored": colored,
    }
    page = filled("alone", _STYLES, _SCRIPTS, data)
    # As the script has it: a stage of 420 by 180 to 400, and 16 more.
    tall = min(max(420.0 * size[1] / max(size[0], 1e-300), 180.0), 400.0) + 16.0
    return Animation(page, round(tall * _WIDTH / 420.0) + _BELOW)
