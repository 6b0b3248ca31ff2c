"""Drawing functions of all symbols, by the symbol names used in `Part.symbol`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from beamdae.errors import require_choice
from beamdae.parts.part import Part
from beamdae.report.scene.elastic_symbols import (
    draw_bushing,
    draw_contact,
    draw_spring_damper,
    draw_torsion_spring,
)
from beamdae.report.scene.joint_symbols import (
    draw_distance,
    draw_driver,
    draw_gear,
    draw_joint,
    draw_markers,
    draw_point_on_line,
    draw_prismatic,
    draw_rack_and_pinion,
    draw_revolute,
    draw_rolling_on_circle,
    draw_rolling_on_line,
    draw_skate,
    draw_sliding_on_beam,
    draw_translational_driver,
    draw_weld,
)
from beamdae.report.scene.load_arrows import (
    draw_distributed_force,
    draw_force,
    draw_force_law,
    draw_moment,
    draw_moving_force,
)
from beamdae.report.scene.scene_builder import SceneBuilder

# A function may use any field of the built-in parts with its symbol, such as `a` and `direction`.
_SYMBOLS: dict[str, Callable[[Any, SceneBuilder], int | None]] = {
    "marker": draw_markers,
    # Joints.
    "joint": draw_joint,
    "hinge": draw_revolute,
    "weld": draw_weld,
    "slot": draw_point_on_line,
    "slider": draw_prismatic,
    "link": draw_distance,
    "driver": draw_driver,
    "translational driver": draw_translational_driver,
    "gear": draw_gear,
    "rack and pinion": draw_rack_and_pinion,
    "rolling on line": draw_rolling_on_line,
    "rolling on circle": draw_rolling_on_circle,
    "skate": draw_skate,
    "sleeve": draw_sliding_on_beam,
    # Springs, dampers and contacts.
    "spring-damper": draw_spring_damper,
    "torsion spring": draw_torsion_spring,
    "bushing": draw_bushing,
    "contact": draw_contact,
    # Loads.
    "force": draw_force,
    "moment": draw_moment,
    "force law": draw_force_law,
    "distributed force": draw_distributed_force,
    "moving force": draw_moving_force,
}


# Symbols with a support at each point of the ground.
_SUPPORTED = ("joint", "hinge", "link", "driver", "spring-damper", "torsion spring", "bushing")


def require_symbol(owner: str, name: object) -> str:
    """Return the name of a symbol; raise an error if there is none of this name."""
    return require_choice(owner, "symbol", name, tuple(_SYMBOLS))


def draw_symbol(part: Part, builder: SceneBuilder) -> None:
    """Add the symbol of a part.

    Raises
    ------
    BeamdaeError
        If the symbol of the part does not exist.
    """
    symbol = require_symbol(part.name, part.symbol)
    if symbol in _SUPPORTED:
        for attachment in part.attachments:
            builder.add_support(attachment)
    row = _SYMBOLS[symbol](part, builder)
    if row is not None:
        builder.add_name(row)
