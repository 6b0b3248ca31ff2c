"""What is told of events that happened."""

import beamdae as bd
from beamdae.results.occurrences import happened


def test_what_happened_is_told_with_the_time():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    mech.observe("ball", ball.point)
    mech.when("ball.y", crosses=1.0, name="half way", do="record")
    mech.when("ball.x", crosses=9.0, name="never", do="record")
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), 0.5)
    # sqrt(2 h / g), h = 1 m
    assert happened(solution.occurred) == "half way at 0.4515 s"
    assert happened(solution.occurred * 3) == "half way 3 times from 0.4515 s"
    assert happened(()) == "none"
