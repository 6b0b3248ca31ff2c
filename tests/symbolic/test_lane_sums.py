"""Sums with lanes are the sums at the inputs of each lane."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.equations.formulations.step_equations import (
    evaluate_matrices,
    evaluate_matrix_at_state,
    formulate_step,
    set_lane,
)
from beamdae.linear.lane_operations import LANES
from beamdae.symbolic.sums.lane_sums import create_lane_sum

COEFFICIENTS = np.array([30.0, 800.0, 1e-3])


def follower_beam() -> bd.Mechanism:
    """Return a beam with a follower force whose law is a sine."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=70e9, nu=0.3, rho=2700.0)
    section = bd.Section.rectangle(alloy, width=0.03, height=0.003, damping=1e-3)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.2)), section, elements=3))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", on=beam.end, law=(bd.sine(2.0, 3.0), 0.0), axes="body"))
    return mech


@pytest.mark.parametrize("model", [follower_beam, "four_bar", "slider_crank"])
def test_lanes_are_matrices_at_their_states_and_times(model):
    mech = bd.load_model(f"example:{model}")() if isinstance(model, str) else model()
    form = formulate_step(bd.equations_of_motion(mech), False)
    e, plan = form.equations, form.sums[2]
    random = np.random.default_rng(0)
    states = 0.1 * random.uniform(-1.0, 1.0, (LANES, 3 * e.n + e.m))
    times = random.uniform(0.1, 0.2, LANES)
    single, lanes = form.matrix_buffers(False), create_lane_sum(plan, 4 * e.n + 2 * e.m, False, e.p)
    entries, expected = np.full(LANES * form.pattern.nnz, np.nan), np.zeros(form.pattern.nnz)
    for lane, (t, row) in enumerate(zip(times, states, strict=True)):
        set_lane(lanes, lane, t, row, e.n, COEFFICIENTS[2])
    evaluate_matrices(lanes, 0.15, COEFFICIENTS, entries)
    for lane, (t, row) in enumerate(zip(times, states, strict=True)):
        evaluate_matrix_at_state(single, t, 0.15, COEFFICIENTS, row, expected)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(entries[lane::LANES], expected, rtol=0, atol=1e-15 * scale)
