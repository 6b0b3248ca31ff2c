"""Beams that the companion does not refine are named beside the errors."""

from mechanisms import cantilever

import beamdae as bd


def test_beams_that_keep_their_mesh_are_named_in_the_table():
    floating_frame = type(cantilever(2).parts["beam"].kinematics)
    mech = cantilever(2, load=(0.0, -1.0), kinematics=floating_frame)
    run = bd.simulate(mech, bd.Radau(), 0.01)
    (status,) = set(run.errors.table()["status"])
    assert status == "measured; beam is not refined: its kinematics are custom ones"
