"""Continued runs: in memory, from a checkpoint, and joined."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball, hinged_body
from numpy.testing import assert_allclose, assert_array_equal
from test_events import HIT, falling, pendulum

import beamdae as bd

RUNS, COARSE = integrators(1e-7, 1e-4), integrators(1e-7, 1e-2)


def slider():
    """A rigid bar driven from one side with a breakpoint on the way."""
    mech, bar = hinged_body(1.0, 0.1, (0.5, 0.0), name="bar", gravity=9.81)
    mech.add(bd.Moment("motor", bar.at(0.5, 0.0), bd.piecewise((0.5, 5.0), 3.0)))
    mech.observe("tip", bar.at(1.0, 0.0))
    return mech


def test_interrupted_run_continues():
    def stop(t):
        if t > 0.5:
            raise KeyboardInterrupt

    with pytest.warns(bd.BeamdaeWarning, match="interrupted"):
        first = bd.simulate(pendulum(), bd.Ida(1e-7), 2.0, progress=stop, partial="return")
    assert 0.5 < first.trajectory.end < 2.0
    later = bd.simulate(pendulum(), bd.Ida(1e-7), 2.0, start=first)
    assert later.status.sentence == "reached the end"


def test_run_continues_after_a_stop_event(tmp_path):
    stopped = bd.simulate(falling(HIT), bd.Ida(1e-6), 5.0)
    path = stopped.save(tmp_path / "impact.json")
    for start in (stopped, path):
        later = bd.simulate(falling(HIT), bd.Ida(1e-6), 1.0, start=start)
        assert later.status.sentence == "reached the end"
        assert later.event_records == ()
        both = stopped.followed_by(later)
        assert_allclose(both.q[-1, 1], 2.0 - 0.5 * 9.81, atol=1e-5)
        assert [one.name for one in both.event_records] == ["impact"]


def pushed_beyond_a_line():
    """A mass of 1 kg at 1 m/s up to x = 1 m at t = 1 s, then pushed by 0.5 N."""
    mech, ball = free_ball(velocity=(1.0, 0.0))
    push = mech.add(bd.Force("push", ball.point, (0.5, 0.0)))
    mech.deactivate(push)
    mech.when("ball.x", 1.0, "up", bd.activate(push), "pushed")
    mech.when("ball.x", 1.0, "up", "record", "seen")
    return mech


@pytest.mark.parametrize("off", [-1.1e-16, 0.0, 2.2e-16])
@COARSE
def test_event_at_the_end_of_a_run_happens_once(integrator, off, tmp_path):
    """At the end of the first run the quantity is on its value up to rounding, on either side."""
    first = bd.simulate(pushed_beyond_a_line(), integrator, 1.0 + off)
    start = first.save(tmp_path / "end.json") if off == 0.0 else first
    later = bd.simulate(pushed_beyond_a_line(), integrator, 2.0, start=start)
    both = first.followed_by(later)
    assert sorted(one.name for one in both.event_records) == ["pushed", "seen"]
    assert_allclose(both.q[-1, 0], 2.25, atol=1e-9)


@COARSE
def test_run_stopped_right_after_its_start(integrator):
    """The pilot run moves by rounding errors only."""
    mech, _ = free_ball(velocity=(1.0, 0.0))
    mech.when("ball.x", 1.0, "up", "stop", "end")
    first = bd.simulate(mech, integrator, 1.0 - 1e-13)
    later = bd.simulate(mech, integrator, 2.0, start=first)
    assert [one.name for one in first.followed_by(later).event_records] == ["end"]


def test_checkpoint_of_another_model_is_rejected(tmp_path):
    first = bd.simulate(slider(), bd.Radau(), 0.1)
    path = first.save(tmp_path / "end.json")
    with pytest.raises(bd.BeamdaeError, match="begins at t = 0 s"):
        first.followed_by(first)
    with pytest.raises(bd.BeamdaeError, match=r"coordinate 1 is 'bar\..*' in the start and 'x' in"):
        bd.simulate(pendulum(), bd.Radau(), 1.0, start=path)
    with pytest.raises(bd.BeamdaeError, match=r"t_end = 0\.1 s must be later than the start"):
        bd.simulate(slider(), bd.Radau(), 0.1, start=path)


INCOMPLETE = "the file is not a complete saved run"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda text: "[1]", INCOMPLETE),
        (lambda text: "", INCOMPLETE),
        (lambda text: text[: len(text) // 2], INCOMPLETE),
        (lambda text: text[:-3], INCOMPLETE),
        (lambda text: 50 * "[", INCOMPLETE),
        (lambda text: bytes(range(256)).decode("latin1"), INCOMPLETE),
    ],
)
def test_damaged_run_is_rejected(tmp_path, change, sentence):
    path = bd.simulate(slider(), bd.Radau(), 0.1).save(tmp_path / "end.run")
    text = path.read_bytes().decode("latin1")
    assert change(text) != text
    path.write_bytes(change(text).encode("latin1"))
    with pytest.raises(bd.BeamdaeError, match=sentence):
        bd.simulate(slider(), bd.Radau(), 1.0, start=path)


def test_a_saved_run_is_a_start(tmp_path):
    path = bd.simulate(slider(), bd.Radau(), 0.1).save(tmp_path / "run.zip")
    starts = path, bd.load(path, slider())
    runs = [bd.simulate(slider(), bd.Radau(), 0.2, start=start) for start in starts]
    assert runs[0].t[0] == 0.1
    assert_array_equal(runs[0].q, runs[1].q)


@pytest.mark.slow(reason="a quarter of a second")
def test_end_of_a_failed_or_pilot_run_causes_a_warning(tmp_path):
    def halted(t):
        raise KeyboardInterrupt

    # The steps are too long for Newton's iteration where the mass falls into the center.
    mech, mass = free_ball((1.0, 0.0), name="mass", velocity=(-1.0, 0.0))
    ends = (mass.point, mech.ground.at(0.0, 0.0))

    def pull(a, b, t):
        return [-3.0 * a.position / (a.position @ a.position) ** 1.5, 0.0 * a.position]

    mech.add(bd.ForceLaw("pull", ends, pull))
    failed_run = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 2.0)
    assert failed_run.status.kind == "failed"
    stopped_pilot = bd.simulate(pendulum(), bd.Radau(), 2.0, progress=halted, partial="return")
    for first, model in ((failed_run, mech), (stopped_pilot, pendulum())):
        path = first.save(tmp_path / "end.json")
        for start in (first, path):
            end = first.trajectory.end + 1e-3
            with pytest.warns(bd.BeamdaeWarning, match="the run resumes from an unreliable state"):
                later = bd.simulate(model, bd.Radau(), end, start=start)
            assert "unreliable state" in later.warnings[0]
            # A run from an unreliable state is not reported as successful.
            both = first.followed_by(later)
            assert both.status.kind == ("failed" if first is failed_run else "ok")
    with pytest.warns(bd.BeamdaeWarning, match="max_steps"):
        limited = bd.simulate(pendulum(), bd.Radau(max_steps=30), 2.0)
    assert bd.simulate(pendulum(), bd.Radau(), 2.0, start=limited).warnings == ()


def test_other_parameters_are_rejected_or_reported(tmp_path):
    @bd.model(t_end=1.0)
    def falling_model(gravity=-9.81):
        return falling(gravity=gravity)

    @bd.model(t_end=1.0)
    def thrown_on_the_moon(gravity=-1.62):
        return falling(gravity=gravity)

    first = bd.simulate(falling_model, bd.Radau(), 0.5)
    path = first.save(tmp_path / "end.json")
    other = r"other parameters \(gravity was -9\.81\)"
    with pytest.raises(
        bd.BeamdaeError, match=f"thrown_on_the_moon: the start belongs to a run with {other}"
    ):
        bd.simulate(thrown_on_the_moon, bd.Radau(), start=path)
    with pytest.warns(bd.BeamdaeWarning, match=other):
        later = bd.simulate(thrown_on_the_moon, bd.Radau(), start=path, accept_changes=True)
    assert_allclose(later.a[-1, 1], -1.62, rtol=1e-9)
    assert "the earlier run had other parameters" in later.metadata()["warnings"][0]


def driven_ball(law, mass=1.0):
    """A mechanism without named parameters."""
    mech, ball = free_ball(mass=mass)
    mech.add(bd.Force("push", ball.point, (law, 0.0)))
    return mech


@pytest.mark.parametrize(
    "other",
    [
        driven_ball(lambda t: np.cos(t)),
        driven_ball(lambda t: 1.0000001 * np.sin(t)),
        driven_ball(lambda t: np.sin(t), mass=2.0),
        driven_ball(bd.piecewise((5.0, lambda t: np.sin(t)), 0.0)),
    ],
    ids=["formula", "number in a formula", "mass", "breakpoint"],
)
def test_other_formulas_and_numbers_are_rejected(tmp_path, other):
    first = bd.simulate(driven_ball(lambda t: np.sin(t)), bd.Radau(), 0.5)
    path = first.save(tmp_path / "end.json")
    watched = driven_ball(lambda t: np.sin(t))
    watched.observe("ball", watched.part("ball").point)
    for same in (driven_ball(lambda t: np.sin(t)), watched):
        assert bd.simulate(same, bd.Radau(), 1.0, start=path).warnings == ()
    for start in (first, path):
        with pytest.raises(bd.BeamdaeError, match="a run with other numbers or formulas; use the"):
            bd.simulate(other, bd.Radau(), 1.0, start=start)


def pushed_by_samples(law):
    """Return a mass pushed by the force that `law` returns every .1 s."""
    mech, mass = free_ball(name="mass")
    force = mech.input("force", unit="N")
    mech.add(bd.Force("push", mass.point, (force, 0.0)))
    mech.add(bd.Controller("count", 0.1, [], [force], law, state=[0.0]))
    return mech


@pytest.mark.parametrize("method", [bd.Radau(1e-7), bd.GeneralizedAlpha(0.01)], ids=type)
@pytest.mark.parametrize("time", [0.05, 0.25])
def test_interrupted_laws_leave_samples_that_are_continued(method, time):
    interrupts = []

    def count(sample):
        if interrupts and sample.t > interrupts[0]:
            raise KeyboardInterrupt
        sample.state[0] += 1.0
        return sample.state[0]

    whole = bd.simulate(pushed_by_samples(count), method, 0.45, 0.05)
    interrupts.append(time)
    with pytest.warns(bd.BeamdaeWarning, match="interrupted"):
        first = bd.simulate(pushed_by_samples(count), method, 0.45, 0.05, partial="return")
    interrupts.clear()
    later = bd.simulate(pushed_by_samples(count), method, 0.45, 0.05, start=first)
    assert first.trajectory.end < time + 0.1
    assert_allclose(later.q[-1], whole.q[-1], rtol=1e-7, atol=1e-12)
