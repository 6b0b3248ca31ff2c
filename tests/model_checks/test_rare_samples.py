"""Warnings about sampled controllers that take hardly any sample in a run."""

from __future__ import annotations

import pytest

import beamdae as bd


def sampled_stage(every: float) -> bd.Mechanism:
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point, direction=(1.0, 0.0)))
    x = mech.sensor("x", stage.point, "x")
    force = mech.input("F", unit="N")
    mech.add(bd.Force("coil", stage.point, (force, 0.0)))
    mech.add(bd.Controller("pid", every, [x], [force], lambda s: 0.1 - s.reads[0]))
    mech.observe("stage", stage.point)
    return mech


def rare_samples(mech: bd.Mechanism, t_end: float = 0.08) -> list[str]:
    run = bd.simulate(mech, bd.Radau(1e-3), t_end=t_end, output_step=0.01)
    return [x for x in run.warnings if "unit of every" in x]


@pytest.mark.parametrize(
    ("every", "count"), [(0.2, "once"), (200.0, "once"), (0.08, "once"), (0.04, "twice")]
)
def test_regression_controllers_that_hardly_sample_have_a_warning(every: float, count: str) -> None:
    """A sampling interval in ms held the first force during the whole run silently."""
    assert rare_samples(sampled_stage(every)) == [
        f"pid: samples only {count} in this run, because every={every:g} s and the run takes "
        "0.08 s; check the unit of every."
    ]


def test_three_samples_and_runs_that_stop_early_have_no_warning() -> None:
    assert rare_samples(sampled_stage(0.03)) == []
    mech = sampled_stage(0.02)
    mech.when("stage.x_dot", 1e-3)
    assert rare_samples(mech) == []
