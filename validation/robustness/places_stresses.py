"""Section forces and stresses in small working calls."""

from __future__ import annotations

from typing import Any

import beamdae as bd
from robustness.world import OUTPUT_STEP, Base, World, itself


def _forces(world: World, **given: Any) -> bd.SectionForces:
    """Of a beam that falls."""
    beam = world.beam
    solution = world.run()
    return solution.section_forces(**{"beam": beam, **given})


def _resting(world: World) -> bd.Equilibrium:
    """A beam that is held, under its weight."""
    beam = world.beam
    world.mech.add(bd.Weld("clamp", world.mech.ground.at(*beam.start.point), beam.start))
    return bd.equilibrium(world.mech, loads=["gravity"], step=1.0)


STRESSES: dict[str, Base] = {
    "Solution.section_forces": Base(
        lambda w: {"beam": "beam", "t": [0.0, OUTPUT_STEP], "s": [0.0, 0.5]},
        lambda w, forces: forces.table(),
        lambda w, **given: _forces(w, **given),
    ),
    "Solution.diagram": Base(
        lambda w: {"beam": "beam", "what": "M", "t": OUTPUT_STEP},
        itself,
        lambda w, **given: (w.beam, w.run())[1].diagram(**given),
    ),
    "Equilibrium.section_forces": Base(
        lambda w: {"beam": "beam", "s": [0.0, 0.5]},
        lambda w, forces: forces.table(),
        lambda w, **given: _resting(w).section_forces(**given),
    ),
    "Equilibrium.diagram": Base(
        lambda w: {"beam": "beam", "what": "M"},
        itself,
        lambda w, **given: _resting(w).diagram(**given),
    ),
    "SectionForces.stress": Base(
        lambda w: {"offset": "top"}, itself, lambda w, offset: _forces(w).stress(offset)
    ),
    "SectionForces.safety": Base(
        lambda w: {"yield_stress": 235e6},
        itself,
        lambda w, yield_stress: _forces(w).safety(yield_stress),
    ),
    "SectionForces.diagram": Base(
        lambda w: {"what": "M", "t": OUTPUT_STEP},
        itself,
        lambda w, **given: _forces(w).diagram(**given),
    ),
}
