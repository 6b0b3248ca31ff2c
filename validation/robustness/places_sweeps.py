"""Sweeps in small working calls, and what is asked of them."""

from __future__ import annotations

from typing import Any

import beamdae as bd
from robustness.places_solutions import deep
from robustness.world import OUTPUT_STEP, T_END, Base, World


def _returning(values: Any) -> Any:
    def few() -> Any:
        return values

    return few


def _decorated(world: World, over: Any) -> bd.SweepResults:
    return bd.sweep(world.swing, integrator=world.integrator, t_end=T_END)(_returning(over))()


def _swept(world: World) -> bd.SweepResults:
    return bd.sweep(world.swing, {"mass": [1.0, 2.0]}, integrator=world.integrator, t_end=T_END)


def _kept(world: World, folder: Any, **given: Any) -> bd.SweepResults:
    found: list[bd.SweepResults] = []
    deep(world, lambda path: found.append(bd.sweep(**given, folder=path)), folder)
    return found[0]


def _table(world: World, found: bd.SweepResults) -> Any:
    return found.table


def _drawn(world: World, names: Any, x: Any) -> None:
    _swept(world).plot(names, x=x)


SWEEPS: dict[str, Base] = {
    "sweep": Base(
        lambda w: {
            "model": w.swing,
            "over": {"mass": [1.0, 2.0]},
            "of": ("bob.x",),
            "outputs": {"rows": lambda run: len(run.t)},
            "integrator": w.integrator,
            "t_end": T_END,
            "output_step": OUTPUT_STEP,
            "time_limit": 10.0,
            "folder": "sweep",
            "jobs": 1,
            "scheduler": None,
            "progress": lambda standing: None,
        },
        _table,
        _kept,
    ),
    "sweep values": Base(
        lambda w: {"mass": [1.0, 2.0], "spin": (1,)},
        _table,
        lambda w, **over: bd.sweep(w.swing, over, t_end=T_END, integrator=w.integrator),
    ),
    "sweep combinations": Base(lambda w: {"over": [{"mass": 1.0}]}, _table, _decorated),
    "sweep.plot": Base(lambda w: {"names": "bob.x max", "x": "mass"}, lambda w, _: None, _drawn),
    "sweep.run": Base(
        lambda w: {"mass": 2.0},
        lambda w, run: run.table(),
        lambda w, **given: _swept(w).run(**given),
    ),
}
