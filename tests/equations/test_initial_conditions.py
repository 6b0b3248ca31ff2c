"""Starts by name and in equilibrium, and changes of the start made by joints."""

import json

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, driven, hinged, rectangle
from numpy.testing import assert_allclose
from scipy.optimize import brentq, minimize_scalar

import beamdae as bd


def slider_crank(rod_y=0.0, **start):
    """Return a slider-crank with a crank of 1 m and a rod of 2 m, both rigid with 1 kg."""
    mech = bd.Mechanism(gravity=EARTH, **start)
    crank = mech.add(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)))
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.1, center=(2.0, 0.0)))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(1.0, 0.0), rod.at(1.0, 0.0)))
    mech.add(bd.PointOnLine("guide", mech.ground.at(3.0, 0.0), rod.at(3.0, 0.0)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_prescribed_positions_and_velocities_are_kept_and_others_follow():
    angle, rate = 0.7, 5.0
    start = {"crank.angle": angle, "crank.angle_dot": rate}
    rod = -np.arcsin(np.sin(angle) / 2.0)
    rod_rate = -np.cos(angle) * rate / (2.0 * np.cos(rod))
    for mech, argument in ((slider_crank(), start), (slider_crank(start=start), None)):
        solution = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 2e-3, start=argument)
        names = solution.equations.q_names
        q, v = dict(zip(names, solution.q[0], strict=True)), solution.v[0]
        # Joints are closed to 1e-11 of 3 m.
        assert_allclose((q["crank.angle"], q["rod.angle"]), (angle, rod), atol=1e-10)
        assert_allclose(v[[2, 5]], (rate, rod_rate), atol=1e-8)
        assert solution.start.request == "crank.angle = 0.7, crank.angle_dot = 5"
        assert not solution.start.warning


def test_equilibrium_under_gravity():
    """The crank hangs down; the rod connects its pin at (0, -1) with the guide."""
    equations = bd.equations_of_motion(slider_crank(start="equilibrium"))
    assert_allclose(equations.q0[2], -np.pi / 2.0, atol=1e-9)
    assert_allclose(equations.q0[5], np.pi / 6.0, atol=1e-9)
    assert_allclose(equations.v0, 0.0, atol=0.0)


def test_a_cantilever_starts_in_equilibrium_with_the_analytic_sag():
    steel = bd.Material(E=2e11, nu=0.3, rho=7800.0)
    section = rectangle(0.02, material=steel)
    mech, beam = clamped_beam(section, 4, gravity=9.81, start="equilibrium")
    mech.observe("tip", beam.end)
    solution = bd.simulate(mech, bd.Radau(1e-6), 0.01)
    y = solution.columns["tip.y [m]"]
    weight = 7800.0 * section.area * 9.81
    # The expected deflection omits shear, which adds 0.03 %.
    assert_allclose(y[0], -weight / (8.0 * section.EI), rtol=1e-3)
    assert_allclose(y, y[0], rtol=1e-6)


@pytest.mark.slow(reason="half a second")
def test_a_coordinate_without_equilibrium_is_named():
    mech = bd.Mechanism(gravity=EARTH, start="equilibrium")
    mech.add(bd.RigidBody("stone", 1.0, 1.0))
    with pytest.raises(bd.BeamdaeError, match=r"stone\.y: no equilibrium .* moves without limit"):
        bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ("equilibrum", "start must be 'as drawn', 'equilibrium', bd.rotation"),
        ({"crank.angle": "x"}, r"start\['crank.angle'\] must be a number"),
        ({"crank.angel": 1.0}, "did you mean 'crank.angle'"),
        ({"crank.angle": 0.3, "rod.angle": 1.0}, "cannot be closed with .*rod.angle = 1"),
        ({"crank.angle_dot": 1.0, "rod.angle_dot": 1.0}, "do not allow .*rod.angle_dot = 1"),
    ],
)
def test_impossible_starts_are_rejected(start, words):
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.simulate(slider_crank(), t_end=0.1, start=start)


def test_positions_without_admissible_velocities_are_rejected():
    """At the dead center, the slider cannot move, but its driver begins with 1 m/s."""
    mech = slider_crank()
    pin = (mech.ground.at(3.0, 0.0), mech.parts["rod"].at(3.0, 0.0))
    mech.add(bd.TranslationalDriver("pull", *pin, lambda t: -t))
    with pytest.raises(bd.BeamdaeError, match=r"pull.*depend on each other .* change the start"):
        bd.simulate(mech, t_end=0.1, start={})


class FourBar:
    """Four-bar near the dead center of its coupler, in closed form on the branch of its drawing."""

    points = np.array([(0.0, 0.0), (0.05, 0.21), (0.715, 0.45), (0.62, 0.02)])
    names = ("crank", "coupler", "rocker")

    def __init__(self, size=1.0, mirrored=False, masses=(1.0, 1.0, 1.0)):
        self.points = size * self.points * ((1.0, -1.0) if mirrored else (1.0, 1.0))
        self.masses, self.sign = masses, -1.0 if mirrored else 1.0

    def mechanism(self, motor=None):
        mech = bd.Mechanism(gravity=EARTH)
        bodies = [mech.ground]
        for k, (name, mass) in enumerate(zip(self.names, self.masses, strict=True)):
            ends = (tuple(x) for x in self.points[k : k + 2])
            bodies.append(mech.add(bd.RigidBody.rod(name, *ends, mass=mass)))
        bodies.append(mech.ground)
        for k, point in enumerate(self.points):
            mech.add(bd.Revolute(f"pin {k}", bodies[k].at(*point), bodies[k + 1].at(*point)))
        if motor is not None:
            hub = [bodies[k].at(*self.points[3]) for k in (4, 3)]
            mech.add(bd.Driver("motor", *hub, law=motor))
        return mech

    def angles(self, crank):
        """Return the rotations of the bars from the drawing if the crank turns by `crank`."""
        o, a, b, c = self.points @ (1.0, 1j)
        pin = o + (a - o) * np.exp(1j * crank)
        base, rod, rocker = c - pin, abs(b - a), abs(c - b)
        cosine = (abs(base) ** 2 + rod**2 - rocker**2) / (2.0 * abs(base) * rod)
        head = pin + rod * base / abs(base) * np.exp(1j * self.sign * np.arccos(cosine))
        return crank, np.angle((head - pin) / (b - a)), np.angle((head - c) / (b - c))

    def dead_center(self, bar):
        """Return the crank angle near the drawing at which the rotation of a bar is least."""
        return minimize_scalar(
            lambda x: self.sign * self.angles(x)[bar], bounds=(-0.6, 0.6), options={"xatol": 1e-9}
        ).x

    def led_to(self, bar, value):
        """Return the rotations on the side of the dead center on which the drawing lies."""
        end = -2.0 * np.sign(self.dead_center(bar))
        return self.angles(brentq(lambda x: self.angles(x)[bar] - value, 0.0, end, xtol=1e-14))


FOUR_BARS = [
    FourBar(),
    FourBar(size=1e-3),
    FourBar(size=1e3, masses=(0.01, 3.0, 0.5)),
    FourBar(mirrored=True, masses=(0.5, 1.0, 1.0)),
]


@pytest.mark.parametrize("bars", FOUR_BARS)
@pytest.mark.parametrize("value", [1e-3, 0.05, 0.1, 0.2, 0.35])
def test_starts_stay_on_the_branch_of_the_drawing(bars, value):
    """Starts near a dead center turned the crank by up to 23 turns, or were refused."""
    value *= bars.sign
    q = bd.equations_of_motion(bars.mechanism(), {"coupler.angle": value}).q0
    # The joints are closed to 1e-12; near the dead center, the crank turns ten times as far.
    assert_allclose(q[2::3], bars.led_to(1, value), atol=1e-9)


@pytest.mark.parametrize("bars", FOUR_BARS)
@pytest.mark.parametrize("beyond", [1e-3, 0.1, 3.0])
def test_starts_beyond_reach_state_the_value_that_can_be_reached(bars, beyond):
    reach = bars.angles(bars.dead_center(1))[1]
    start = {"coupler.angle": reach - bars.sign * beyond}
    with pytest.raises(bd.BeamdaeError, match=r"coupler\.angle can be led only to") as error:
        bd.equations_of_motion(bars.mechanism(), start)
    stated = float(str(error.value).split("led only to ")[1].split()[0])
    # The path ends at 1e-6 of the requested change.
    assert_allclose(stated, reach, atol=1e-5 * (abs(reach) + beyond))


@pytest.mark.parametrize("bars", FOUR_BARS)
@pytest.mark.parametrize("value", [-0.25, -0.1, 0.3, 0.8])
def test_drivers_lead_all_analyses_from_the_drawing(bars, value):
    end = bars.sign * (2.0 if value > 0.0 else -0.85)  # before the dead centers of the rocker
    crank = brentq(lambda x: bars.angles(x)[2] - bars.sign * value, 0.0, end, xtol=1e-14)
    expected = bars.angles(crank)
    mech = bars.mechanism(motor=bars.sign * value)
    static = bd.equilibrium(mech)
    run = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 1e-3)
    about = bd.equations_of_motion(mech, "equilibrium").q0
    for q in (static.q[-1], run.q[0], about):
        assert_allclose(q[2::3], expected, atol=1e-9)


def test_large_changes_of_the_start_are_reported(tmp_path):
    """A driver rotates the crank by 0.5 rad from the drawing."""
    mech, _ = driven(bd.RigidBody("crank", 1.0, 0.1, center=(0.5, 0.0)), 0.5)
    with pytest.warns(
        bd.BeamdaeWarning,
        match="crank: drivers begin beside the reference configuration, .* lambda t: speed",
    ):
        solution = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-2), 0.05)
    change = solution.start.largest
    assert change.part == "crank"
    assert change.displacement > 0.2
    record = json.loads(solution.to_csv(tmp_path / "run.csv").with_suffix(".json").read_text())
    assert record["start"]["asked"] == "as drawn"
    assert record["start"]["changed by the joints"][0]["part"] == "crank"
    prescribed = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-2), 0.05, start={"crank.angle": 0.5})
    assert not prescribed.start.warning
    assert_allclose(prescribed.q, solution.q, atol=1e-9)


def arm(angle, law=None, gravity=9.81):
    """Return an arm of 1 m on a hinge, drawn at this angle from the downward direction."""
    center = (0.5 * np.sin(angle), -0.5 * np.cos(angle))
    bar = bd.RigidBody("arm", 1.0, 0.1, center=center)
    mech, bar = hinged(bar, gravity) if law is None else driven(bar, law, gravity)
    mech.observe("arm", bar.at(*center))
    return mech


@pytest.mark.parametrize(
    ("analyze", "law"),
    [
        (bd.equilibrium, 0.5),
        (lambda mech: bd.linearize(mech, about="equilibrium"), 0.5),
        (bd.linearize, 0.5),
        (lambda mech: bd.linearize(mech, about=bd.rotation(2.0)), lambda t: 0.5 + 2.0 * t),
    ],
)
def test_regression_gaps_are_reported_by_statics_and_modes(analyze, law):
    """Equilibria and modes of drawings whose joints are not closed had no warning."""
    gravity = 0.0 if callable(law) else 9.81
    with pytest.warns(bd.BeamdaeWarning, match="drivers begin beside the reference"):
        analyze(arm(0.2, law, gravity))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("start", "law"),
    [("equilibrium", 0.5), (bd.rotation(2.0), lambda t: 0.5 + 2.0 * t)],
)
def test_regression_gaps_of_drawings_are_reported_with_all_starts(start, law):
    """With start="equilibrium", the changes were zero and there was no warning."""
    mech = arm(0.2, law)
    drawn = bd.check(mech, predict=False)
    findings = bd.check(mech, predict=False, start=start)
    assert "which displaces this part by 0.25 m" in findings.start.warning
    assert findings.start.warning == drawn.start.warning
    assert findings.start.warning in findings.warnings
    assert findings.start.changes[0].displacement == drawn.start.changes[0].displacement
    assert max(x.position for x in findings.residuals) == 0.5
    assert "closing the joints moves arm by 0.25 m" in str(findings)
    with pytest.warns(bd.BeamdaeWarning, match="drivers begin beside"):
        run = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-3), 2e-3, start=start)
    assert run.start.changes[0].displacement == findings.start.changes[0].displacement


def test_regression_inactive_joints_do_not_act_on_equilibria():
    """The run started at the position of a driver that an event activates later."""
    mech = arm(0.2)
    bar = mech.parts["arm"]
    lock = mech.add(bd.Driver("lock", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), law=0.5))
    mech.deactivate(lock)
    for start, angle in (("equilibrium", -0.2), ({"arm.angle": 0.3}, 0.3)):
        q = bd.equations_of_motion(mech, start).q0
        assert_allclose(q[2], angle, atol=1e-9)
    findings = bd.check(mech, predict=False)
    assert findings.start.changes[0].displacement == 0.0
    assert findings.mobility == 1


@pytest.mark.parametrize("travel", [3e-4, 0.1])
def test_regression_preloads_by_drivers_are_no_gaps_of_the_drawing(travel):
    """A leaf stretched by a driver had "the joints are not closed"; large travels warn."""
    section = rectangle(2.5e-4, 0.008)
    mech, leaf = clamped_beam(section, curve=0.06, name="leaf")
    mech.add(bd.Prismatic("slide", mech.ground.at(0.06, 0.0), leaf.end, (1.0, 0.0)))
    mech.add(bd.TranslationalDriver("pull", mech.ground.at(0.06, 0.0), leaf.end, travel))
    mech.observe("middle", leaf.at(0.03))
    result = bd.equilibrium(mech)
    has_warning = any("drivers begin beside" in x for x in result.warnings)
    assert has_warning == (travel > 0.01)


# Velocities that are given as zero differ from velocities that are not given.

SPEED = 2.0


def double_pendulum(**second):
    """Two rods of 1 m; the first one turns at `SPEED`."""
    mech = bd.Mechanism()
    first = bd.RigidBody.rod("a", (0.0, 0.0), (1.0, 0.0), mass=1.0, angular_velocity=SPEED)
    first = mech.add(first)
    second = mech.add(bd.RigidBody.rod("b", (1.0, 0.0), (2.0, 0.0), mass=1.0, **second))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), first.at(0.0, 0.0)))
    mech.add(bd.Revolute("joint", first.at(1.0, 0.0), second.at(1.0, 0.0)))
    mech.observe("tip", second.at(2.0, 0.0))
    return mech


@bd.model(t_end=0.02)
def pendulum(speed=0.0):
    return double_pendulum(angular_velocity=speed)


def start_speed(mech):
    run = bd.simulate(mech, bd.Radau(1e-8), 1e-3)
    return run["tip.angle_dot"].iloc[0], run


def test_regression_zero_angular_velocity_is_kept():
    # Least kinetic energy of the second rod: -1.5 SPEED.
    assert start_speed(double_pendulum())[0] == pytest.approx(-1.5 * SPEED)
    values = [start_speed(double_pendulum(angular_velocity=w))[0] - w for w in (-1e-6, 0.0, 1e-6)]
    assert np.max(np.abs(values)) < 1e-9


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_derivative_by_a_velocity_that_is_zero():
    run = bd.sensitivities(pendulum, "speed", bd.GeneralizedAlpha(2e-3), output_step=1e-2)
    assert run.columns.observed["speed"]["tip.angle_dot [rad/s]"][0] == pytest.approx(1.0)


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_regression_beams_keep_a_given_zero(formulation):
    crank = bd.RigidBody.rod("crank", (0.0, 0.0), (1.0, 0.0), mass=1.0, angular_velocity=SPEED)
    mech, crank = hinged(crank)
    steel = rectangle(0.02)
    line = bd.Line((1.0, 0.0), (2.0, 0.0))
    beam = bd.Beam("rod", line, steel, 2, formulation=formulation, angular_velocity=0.0)
    beam = mech.add(beam)
    mech.add(bd.Revolute("joint", crank.at(1.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    speed, run = start_speed(mech)
    assert speed == pytest.approx(0.0, abs=1e-6)
    assert run["tip.y_dot"].iloc[0] == pytest.approx(SPEED, rel=1e-6)


def test_regression_contradicting_zeros_have_a_warning():
    motion = {"velocity": (0.0, 0.0), "angular_velocity": SPEED}
    mech, _ = hinged(bd.RigidBody.rod("rod", (0.0, 0.0), (1.0, 0.0), mass=1.0, **motion))
    with pytest.warns(bd.BeamdaeWarning, match=r"rod: the joints do not allow .* rod\.y_dot"):
        bd.simulate(mech, bd.Radau(1e-6), 1e-3)


def test_regression_rounding_errors_of_given_zeros_have_no_warning():
    """A pendulum that translates with its base turned at 1e-12 rad/s "instead of 0 rad/s"."""
    mech = bd.Mechanism()
    base = mech.add(bd.RigidBody("base", mass=1.0, inertia=0.01))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), base.at(0.0, 0.0), (0.0, 1.0)))
    shaker = bd.sine(0.02, 60.0)
    ends = (mech.ground.at(0.0, 0.0), base.at(0.0, 0.0))
    mech.add(bd.TranslationalDriver("shaker", *ends, shaker, (0.0, 1.0)))
    rod = bd.RigidBody.rod("rod", (0.0, 0.0), (0.06, 0.29), mass=0.1, angular_velocity=0.0)
    mech.add(bd.Revolute("hinge", base.at(0.0, 0.0), mech.add(rod).at(0.0, 0.0)))
    mech.observe("tip", rod.at(0.06, 0.29))
    speed, run = start_speed(mech)
    assert abs(speed) < 1e-9
    assert not any("the joints do not allow" in x for x in run.warnings)
