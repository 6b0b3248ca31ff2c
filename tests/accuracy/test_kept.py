"""Beams that the companion does not refine are named beside the errors."""

from mechanisms import cantilever

import beamdae as bd
from beamdae.beams.floating_frame.kinematics import FloatingFrame


def test_beams_that_keep_their_mesh_are_named_in_the_table():
    mech = cantilever(2, load=(0.0, -1.0), kinematics=FloatingFrame)
    run = bd.simulate(mech, bd.Radau(), 0.01)
    (status,) = set(run.errors.table()["status"])
    assert status == "measured; beam is not refined: its kinematics are custom ones"
