"""Periodic motions in small working calls."""

from __future__ import annotations

from dataclasses import replace

import beamdae as bd
from robustness.world import Base, World, itself

_PERIOD = 0.01


def _shaken(world: World) -> bd.Mechanism:
    """The hinged bar, held by a spring and shaken."""
    mech, hinge = world.mech, world.mech.parts["hinge"]
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, 1e4))
    mech.add(bd.TorsionDamper("damper", hinge.a, hinge.b, 100.0))
    mech.add(bd.Moment("shaking", world.bar.at(0.0, 0.0), bd.sine(1.0, frequency=1.0 / _PERIOD)))
    return mech


def _family(world: World) -> bd.Model:
    """The same over the frequency."""

    @bd.model(t_end=_PERIOD)
    def shaken(frequency=100.0, name="bob"):
        mech = bd.Mechanism()
        bob = mech.add(bd.PointMass(name, 1.0, at=(1.0, 0.0)))
        mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), bob.point, (1.0, 0.0)))
        mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), bob.point, 1e4, 100.0))
        mech.add(bd.Force("shaking", bob.point, (bd.sine(1.0, frequency=frequency), 0.0)))
        mech.observe("bob", bob.point)
        return mech

    return shaken


PERIODIC: dict[str, Base] = {
    "periodic": Base(
        lambda w: {
            "model": _shaken(w),
            "period": _PERIOD,
            "integrator": w.integrator,
            "start": {"bar.angle": 0.0},
            "begin": 0.0,
            "settle": 1,
            "tolerance": 1e-3,
        },
        lambda w, motion: motion.amplitudes(),
    ),
    "frequency_response": Base(
        lambda w: {
            "model": _family(w),
            "parameter": "frequency",
            "between": (100.0, 101.0),
            "period": lambda frequency: 1.0 / frequency,
            "integrator": replace(w.integrator, time_limit=1.0),
            "step": 0.5,
            "longest_step": 1.0,
            "settle": 1,
            "tolerance": 1e-3,
            "most_points": 4,
            "begin": 0.0,
        },
        lambda w, response: response.table(),
    ),
    "FrequencyResponse.plot": Base(
        lambda w: {"column": "bob.x [m]"},
        itself,
        lambda w, column: bd.frequency_response(
            _family(w), "frequency", (100.0, 101.0), step=0.5, settle=1
        ).plot(column),
    ),
    "FrequencyResponse.peaks": Base(
        lambda w: {"column": "bob.x [m]"},
        itself,
        lambda w, column: bd.frequency_response(
            _family(w), "frequency", (100.0, 101.0), step=0.5, settle=1
        ).peaks(column),
    ),
}
