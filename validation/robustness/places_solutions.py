"""Public names that look at a solution in small working calls."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import beamdae as bd
from robustness.world import KNEE, Base, World, itself

SOLUTIONS: dict[str, Base] = {
    "error_estimate": Base(lambda w: {"solution": w.solution}, itself),
    "verify": Base(lambda w: {"solution": w.solution, "by": bd.Radau(1e-4)}, itself),
    "load": Base(
        lambda w: {"path": "run.beamdae", "model": w.mech},
        itself,
        lambda w, **given: _kept(w, **given),
    ),
    "Solution.save": Base(
        lambda w: {"path": "run.beamdae"}, itself, lambda w, path: deep(w, w.solution.save, path)
    ),
    "Solution.difference": Base(
        lambda w: {"other": w.solution}, itself, lambda w, other: w.solution.difference(other)
    ),
    "draw": Base(lambda w: {"mechanism": w.mech}, itself),
    "plot": Base(lambda w: {"solutions": [w.solution], "labels": ["run"]}, itself),
    "animate": Base(
        lambda w: {
            "solution": (w.beam, w.solution)[1],
            "path": w.folder / "run.gif",
            "speed": 1.0,
            "frames": 3,
            "color": "M",
            "trail": True,
        },
        itself,
    ),
    "Solution.observe": Base(
        lambda w: {"name": "middle", "what": w.bar.at(*KNEE)},
        itself,
        lambda w, **given: w.solution.observe(**given),
    ),
    "Solution.__getitem__": Base(
        lambda w: {"name": "bar.angle"}, itself, lambda w, name: w.solution[name]
    ),
    "Solution.to_csv": Base(
        lambda w: {"path": Path("run.csv")},
        itself,
        lambda w, path: deep(w, w.solution.to_csv, path),
    ),
}


def _kept(world: World, path: Any, model: Any) -> Any:
    file = world.solution.save("run.beamdae")
    try:
        return bd.load(path, model)
    finally:
        file.unlink()


def deep(world: World, write: Callable[[Any], object], path: Any) -> None:
    """Write two folders down: relative paths may lead up."""
    (world.folder / "deep").mkdir(parents=True)
    with chdir(world.folder / "deep"):
        write(path)
