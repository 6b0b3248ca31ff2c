"""Text of event records, and drift of joints that events switch off."""

from dataclasses import replace

from mechanisms import free_ball

import beamdae as bd


def test_events_are_formatted_with_their_first_time():
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    mech.when("ball.y", crosses=1.0, name="half way", do="record")
    mech.when("ball.x", crosses=9.0, name="never", do="record")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 0.5)
    missing = "never did not occur (closest 0 m at 0 s, needed 9 m)"
    # sqrt(2 h / g), h = 1 m
    assert f"half way at 0.4515 s, {missing}" in solution._repr_html_()
    thrice = replace(solution, event_records=solution.event_records * 3)
    assert f"half way 3 times from 0.4515 s, {missing}" in thrice._repr_html_()


def test_regression_reports_name_events_that_did_not_occur():
    """A stop that was missed by 0.7 m, or in the other direction, was not in the report."""
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    mech.when("ball.y", crosses=0.0, name="floor")
    mech.when("ball.y", crosses=1.0, direction="up", name="return", do="record")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 0.5)
    # 2 m - g t^2 / 2
    assert (
        "floor did not occur (closest 0.7738 m at 0.5 s, needed 0 m), "
        "return did not occur (crossed only downward)"
    ) in solution._repr_html_()


def test_regression_deactivated_joints_have_no_drift():
    mech, bob = free_ball((1.0, 0.0), name="bob", gravity=9.81)
    string = mech.add(bd.Distance("string", mech.ground.at(0.0, 0.0), bob.point))
    mech.when("bob.x", direction="down", do=bd.deactivate(string), name="cut")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 1.5)
    (cut_record,) = solution.event_records
    drift = solution.drift
    # Between steps, the error of the dense output is a few times rtol.
    assert drift["drift.position"].max() < 1e-4
    assert drift["drift.position"][solution.t < cut_record.t].max() > 0.0
    assert (drift[solution.t > cut_record.t] == 0.0).all(axis=None)
