"""Modes about steady rotations, Campbell diagrams, and starts in steady rotation."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import (
    ALLOY,
    STEEL,
    clamped_beam,
    driven,
    driven_blade,
    hinged_beam,
    rectangle,
    rotor_on_a_bearing,
)
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.linear_dynamics.linearization import linearize_about
from beamdae.equations.starts.steady_rotation import RotatingCoordinates

SOFT = bd.Material(E=1e8, nu=0.3, rho=1000.0)
STRIP = rectangle(0.01, material=SOFT)


def particle_in_rotor(stiffness=(50.0, 80.0), damping=0.0, offset=(0.0, 0.0), shift=(0.0, 0.0)):
    """Return a small body on a cross of springs in a rotating disk, and the disk."""
    mech = bd.Mechanism()
    x, y = shift
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.3, center=shift))
    bob = mech.add(bd.RigidBody("bob", 2.0, 0.1, center=(x + offset[0], y + offset[1])))
    mech.add(bd.Revolute("axle", mech.ground.at(x, y), disk.at(x, y)))
    hub = disk.at(x + offset[0], y + offset[1])
    mech.add(bd.Bushing("cross", hub, bob.at(*bob.center), *stiffness, 1e4, damping, damping, 0.0))
    return mech, disk


def with_driver(mech, disk, law=0.0):
    at = disk.center
    mech.add(bd.Driver("motor", mech.ground.at(*at), disk.at(*at), law=law))
    return mech


def roots(speed, kx=50.0, ky=80.0, m=2.0):
    """Return the roots of x'' - 2 W y' - W^2 x + kx/m x = 0, y'' + 2 W x' - W^2 y + ky/m y = 0."""
    a, b = kx / m - speed**2, ky / m - speed**2
    values = np.roots([1.0, 0.0, a + b + 4.0 * speed**2, 0.0, a * b])
    upper = values[(values.imag > 1e-9) | ((abs(values.imag) <= 1e-9) & (abs(values.real) > 0))]
    return np.array(sorted(upper, key=abs))


# The particle is unstable at speeds between the square roots of kx / m and ky / m.
@pytest.mark.parametrize("speed", [0.0, 1.0, -3.0, 20.0])
def test_particle_in_a_rotor_has_the_roots_of_its_equation(speed):
    modes = bd.modes(with_driver(*particle_in_rotor()), about=bd.rotation(speed), n=2)
    assert_allclose(modes.eigenvalues, roots(speed), rtol=1e-9, atol=1e-9)
    assert modes.kinds == ("vibration",) * 2


def test_particle_in_a_rotor_is_unstable_between_its_frequencies():
    modes = bd.modes(with_driver(*particle_in_rotor()), about=bd.rotation(5.6), n=2)
    expected = roots(5.6)
    assert "unstable" in modes.kinds
    assert_allclose(np.max(modes.growth_rates), np.max(expected.real), rtol=1e-9)
    assert "unstable" in modes.warnings[0]


@pytest.mark.slow(reason="half a second")
def test_internal_damping_is_unstable_above_the_critical_speed():
    """Internal damping of a rotor (Kimball 1924): Re l changes sign at W = sqrt(k / m)."""

    def growth(speed):
        mech = with_driver(*particle_in_rotor((50.0, 50.0), damping=0.4))
        return np.max(bd.modes(mech, about=bd.rotation(speed), n=2).growth_rates)

    assert growth(4.99) < 0.0 < growth(5.01)


def damped_rotor():
    """Return a disk on a damped shaft, on a hub in a damped bearing."""
    mech, at = bd.Mechanism(), (0.0, 0.0)
    hub = mech.add(bd.RigidBody("hub", 0.5, 0.01, center=at))
    disk = mech.add(bd.RigidBody("disk", 2.0, 0.1, center=at))
    mech.add(bd.Bushing("shaft", hub.at(*at), disk.at(*at), 800.0, 800.0, 50.0, 6.0, 6.0, 1.0))
    bearing = mech.ground.at(*at), hub.at(*at)
    mech.add(bd.Bushing("bearing", *bearing, 3000.0, 3000.0, 0.0, 10.0, 10.0))
    return mech


@pytest.mark.parametrize("speed", [10.0, 50.0, -50.0])
def test_dampers_on_the_ground_act_on_absolute_velocities(speed):
    """Poles of modes contained no force c W x of the bearing, those of runs and matrices do."""
    mass, shaft = np.diag([0.5, 2.0]), np.array([[1.0, -1.0], [-1.0, 1.0]])
    bearing = np.diag([1.0, 0.0])
    # z = x + i y in the rotating frame, where absolute velocities are z' + i W z.
    damping = 2j * speed * mass + 6.0 * shaft + 10.0 * bearing
    stiffness = -(speed**2) * mass + 800.0 * shaft + (3000.0 + 10j * speed) * bearing
    inverse = np.linalg.inv(mass)
    lower = [-inverse @ stiffness, -inverse @ damping]
    expected = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], lower]))
    expected = np.sort_complex(expected.real + 1j * np.abs(expected.imag))
    mech = damped_rotor()
    modes = bd.modes(mech, bd.rotation(speed), n=None).eigenvalues
    distances = np.abs(np.subtract.outer(expected, modes)).min(axis=1)
    assert_allclose(distances, 0.0, atol=1e-7)
    linear = bd.linearize(mech, bd.rotation(speed))
    poles = np.linalg.eigvals(linear.A)
    distances = np.abs(np.subtract.outer(linear.poles, poles)).min(axis=1)
    assert_allclose(distances, 0.0, atol=1e-4)


def test_rotating_free_body_drifts():
    """In the rotating frame a straight motion is a spiral: l = +- i W; the angle is free."""
    mech = bd.Mechanism()
    mech.add(bd.RigidBody("body", 2.0, 0.1, center=(0.0, 0.0)))
    modes = bd.modes(mech, about=bd.rotation(3.0))
    assert modes.kinds[0] == "free motion"
    # The error of double roots is the square root of rounding.
    assert_allclose(modes.eigenvalues[1:], 3.0j, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (4.0, -1.0)])
def test_eccentric_particle_moves_out_to_its_equilibrium_radius(shift):
    """The radius is r = k r0 / (k - m W^2)."""
    speed, r0 = 3.0, 0.2
    mech = with_driver(*particle_in_rotor(offset=(r0, 0.0), shift=shift))
    lin = linearize_about("modes", mech, bd.rotation(speed, shift))
    q = dict(zip(lin.equations.q_names, lin.state.q, strict=True))
    radius = 50.0 * r0 / (50.0 - 2.0 * speed**2)
    assert_allclose([q["bob.x"] - shift[0], q["bob.y"] - shift[1]], [radius, 0.0], atol=1e-10)
    modes = bd.modes(mech, about=bd.rotation(speed, shift), n=2).eigenvalues
    assert_allclose(modes, roots(speed), rtol=1e-8)


def about_the_center(model, center=(0.0, 0.0), speed=3.0):
    modes = bd.modes(model, about=bd.rotation(speed, center), n=1)
    return [x for x in modes.warnings if x.startswith("rotation: the center")]


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize(
    ("shift", "center", "described"),
    [
        ((0.5, 0.2), (0.0, 0.0), "center (0, 0) is not at axle, which is at (0.5, 0.2)"),
        ((0.0, 0.0), (0.15, 0.0), "center (0.15, 0) is not at axle, which is at (0, 0)"),
    ],
)
def test_regression_rotors_with_their_bearing_off_the_center_have_a_warning(
    shift, center, described
):
    """A blade on a hub had 66 Hz for 44 Hz without a word."""
    mech = with_driver(*particle_in_rotor(offset=(0.1, 0.3), shift=shift))
    (text,) = about_the_center(mech, center)
    assert described in text
    assert "pass center=({:g}, {:g}),".format(*shift) in text
    with pytest.warns(bd.BeamdaeWarning, match=r"at 2 rad/s, rotation: the center"):
        bd.campbell(mech, [0.0, 2.0], n=1, center=center)
    assert not about_the_center(mech, shift)
    assert not about_the_center(mech, center, speed=0.0)


@pytest.mark.slow(reason="a quarter of a second")
def test_mechanisms_on_a_turntable_have_no_warning_of_the_center():
    hinged, _ = particle_in_rotor(offset=(0.1, 0.0), shift=(0.5, 0.0))
    assert not about_the_center(hinged)
    two = with_driver(*particle_in_rotor(offset=(0.1, 0.0), shift=(0.5, 0.0)))
    wheel = two.add(bd.RigidBody("wheel", 1.0, 0.3, center=(-0.5, 0.0)))
    axle = two.ground.at(-0.5, 0.0), wheel.at(-0.5, 0.0)
    two.add(bd.Revolute("other axle", *axle))
    assert not about_the_center(two)
    crank, disk = particle_in_rotor(offset=(0.1, 0.0), shift=(0.5, 0.0))
    block = crank.add(bd.PointMass("block", 0.1, at=(2.0, 0.0)))
    crank.add(bd.Distance("rod", disk.at(0.6, 0.3), block.point))
    crank.add(bd.PointOnLine("guide", crank.ground.at(0.0, 0.0), block.point, (1.0, 0.0)))
    assert not about_the_center(with_driver(crank, disk))


def test_forces_that_do_not_rotate_are_rejected():
    heavy, disk = particle_in_rotor()
    heavy.gravity = np.array([0.0, -9.81])
    with pytest.raises(bd.BeamdaeError, match=r"the forces on this coordinate do not rotate"):
        bd.modes(with_driver(heavy, disk), about=bd.rotation(2.0))
    tied, disk = particle_in_rotor()
    tied.add(bd.Spring("stay", tied.ground.at(1.0, 0.0), disk.at(0.5, 0.0), stiffness=3.0))
    with pytest.raises(bd.BeamdaeError, match="do not rotate with the mechanism"):
        bd.modes(with_driver(tied, disk), about=bd.rotation(2.0))
    loaded, disk = particle_in_rotor()
    loaded.add(bd.Force("push", disk.at(0.5, 0.0), (0.0, 1.0)))
    with pytest.raises(bd.BeamdaeError, match="do not rotate with the mechanism"):
        bd.modes(with_driver(loaded, disk), about=bd.rotation(2.0))


@pytest.mark.slow(reason="many speeds")
def test_speed_beyond_the_critical_one_has_no_reachable_steady_state():
    """Beyond W = sqrt(k / m) a steady state exists again, but no path leads to it."""
    with pytest.raises(bd.BeamdaeError, match=r"no steady state was found at 5\.1 rad/s"):
        bd.modes(with_driver(*particle_in_rotor(offset=(0.2, 0.0))), about=bd.rotation(5.1))


def test_follower_loads_are_part_of_the_steady_state():
    """A follower force rotates with the disk, so that a steady state exists."""
    mech, disk = particle_in_rotor(offset=(0.2, 0.0))
    mech.add(bd.Force("jet", disk.at(0.5, 0.0), (0.0, 1.0), axes="body"))
    assert len(bd.modes(with_driver(mech, disk), about=bd.rotation(2.0))) == 3


def arm(radius=0.1, bent=False):
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01))
    line = bd.Line((radius, 0.0), (radius + 0.6, 0.0))
    curve = bd.Arc(radius=0.5, length=0.6, start=(radius, 0.0), angle=0.3) if bent else line
    beam = mech.add(bd.Beam("beam", curve, STRIP, elements=4))
    mech.add(bd.Revolute("axle", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("root", hub.at(radius, 0.0), beam.start))
    mech.observe("bend", beam.section_forces(0.0))
    return mech, hub, beam


@pytest.mark.parametrize(("speed", "is_named"), [(50.0, True), (-5.0, True), (1e-3, False)])
def test_regression_equilibria_of_turning_mechanisms_have_a_warning(speed, is_named):
    """They ignored centrifugal forces without a word: no stress for hundreds of MPa."""
    mech, hub, _ = arm()
    path = bd.equilibrium(with_driver(mech, hub, lambda t: speed * t))
    turning = [x for x in path.warnings if "drivers turn hub" in x]
    assert len(turning) == is_named
    assert all(f"start=bd.rotation({speed:g})" in x for x in turning)


def test_regression_equilibria_do_not_start_in_rotation():
    mech, hub, _ = arm()
    with_driver(mech, hub, lambda t: 5.0 * t)
    for analyze in (bd.equilibrium, bd.buckling):
        with pytest.raises(bd.BeamdaeError, match="must not be a steady rotation"):
            analyze(mech, start=bd.rotation(5.0))


@pytest.mark.slow(reason="a run of a rotating beam")
@pytest.mark.parametrize("bent", [False, True])
def test_nonlinear_run_of_a_rotating_arm_matches_its_modes(bent):
    """After a small deflection of a rotating arm, its root moment is a sum of modes."""
    speed = 20.0
    mech, hub, _ = arm(bent=bent)
    mech.add(bd.Driver("motor", mech.ground.at(0, 0), hub.at(0, 0), law=lambda t: speed * t))
    lin = linearize_about("modes", mech, bd.rotation(speed))
    e, frame = lin.equations, RotatingCoordinates.from_equations(lin.equations)
    modes = bd.modes(mech, about=bd.rotation(speed), n=2)
    sizes = np.array([2e-6, 0.4e-6])
    z = (sizes @ modes.shapes).real
    rate = ((sizes * modes.eigenvalues) @ modes.shapes).real + speed * (frame.generator @ z)
    equations = replace(bd.equations_of_motion(mech), q0=lin.state.q + z, v0=lin.state.v + rate)
    solution = bd.simulate(equations, bd.Radau(1e-9), 0.15, output_step=1e-3)
    assert solution.status.success
    model = bd.linearize(mech, about=bd.rotation(speed), inputs=[])
    moment = solution.columns["bend.M [N m]"] - model.output_values[2]
    states = [e.q_names.index(s.name) for s in model.states[: len(model.states) // 2]]
    by_x, by_rate = np.split(model.C[2], 2)
    moments = modes.shapes[:, states] @ by_x
    moments = moments + modes.eigenvalues * (modes.shapes[:, states] @ by_rate)
    expected = ((sizes * moments) @ np.exp(np.outer(modes.eigenvalues, solution.t))).real
    # The error, of second order in amplitudes of 1e-5 of the length, depends on the signs of the
    # modes relative to each other.
    assert_allclose(moment, expected, rtol=0.0, atol=2e-4 * np.max(np.abs(expected)))


def blade_on_hub(material, **options):
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=5.0, inertia=0.05))
    section = rectangle(0.01, 0.05, material=material)
    line = bd.Line((0.1, 0.0), (0.7, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements=2, **options))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law=0.0))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), blade.start))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("options", [{}, {"strain": "exact"}, {"formulation": "exact"}])
def test_regression_speeds_that_no_metal_bears_are_stated_in_rpm(options):
    """6000 rpm, passed as 6000 rad/s, caused no warning, or one about the strain measure."""
    with pytest.warns(bd.BeamdaeWarning) as caught:
        bd.campbell(blade_on_hub(bd.Material.of("steel"), **options), [0.0, 6000.0], n=1)
    first = str(caught[0].message)
    assert first.startswith("at 6000 rad/s, blade: the largest strain is ")
    assert first.endswith("speeds are in rad/s (6000 rpm are 628.3 rad/s).")


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize(
    ("material", "speed"),
    [
        # Strains of 0.35 %, as in fast blades of titanium.
        (bd.Material.of("steel"), 628.0),
        # Rubber may be stretched by 9 %.
        (bd.Material(E=5e6, nu=0.45, rho=1100.0), 40.0),
    ],
    ids=["steel", "rubber"],
)
@pytest.mark.filterwarnings("error")
def test_rotations_within_the_strength_have_no_warning(material, speed):
    bd.campbell(blade_on_hub(material, formulation="exact"), [0.0, speed], n=1)


@pytest.mark.slow(reason="a quarter of a second")
def test_free_rotation_has_no_resonance_at_rest():
    table = bd.campbell(rotor_on_a_bearing(), [-1.0, 0.0, 1.0, 3.0], n=3).resonances()
    assert sorted(table["multiple"]) == [3, 4]
    assert (table["frequency [Hz]"] > 0.0).all()


@pytest.mark.slow(reason="two seconds")
def test_resonances_of_a_campbell_diagram():
    mech = rotor_on_a_bearing()
    diagram = bd.campbell(mech, [1.0, 7.0, 3.0], n=3)
    table = diagram.resonances()
    # 10 - speed = k speed, and 10 + speed = k speed.
    expected = sorted(
        [(10.0 / (k + 1), k) for k in (1, 2, 3, 4)] + [(10.0 / (k - 1), k) for k in (3, 4)]
    )
    # Speeds that are equal up to rounding are ordered by the multiple.
    actual = sorted(zip(table["speed [rad/s]"].round(9), table["multiple"], strict=True))
    np.testing.assert_allclose(actual, expected, rtol=1e-9)
    np.testing.assert_allclose(
        table["frequency [Hz]"], table["multiple"] * table["speed [rad/s]"] / (2.0 * np.pi)
    )
    with pytest.raises(bd.BeamdaeError, match="multiples must"):
        diagram.resonances([0])
    axis = diagram.plot().figure.axes[0]
    assert len(axis.lines[-1].get_xdata()) == len(table)
    assert {"mode 1", "mode 2"} <= {x.get_text() for x in axis.figure.legends[0].get_texts()}


@pytest.mark.slow(reason="half a second and more")
def test_regression_pictures_and_pages_show_chosen_engine_orders(tmp_path):
    diagram = bd.campbell(rotor_on_a_bearing(), [1.0, 3.0, 7.0], n=3, multiples=(2, 6))
    assert set(diagram.resonances()["multiple"]) == {2, 6}

    def labels(plot):
        texts = {text.get_text() for text in plot.figure.axes[0].texts}
        return {x for x in texts if x.endswith("\u00d7")}

    assert labels(diagram.plot()) == {"2\u00d7", "6\u00d7"}
    page = diagram.page(tmp_path / "a.html").read_text()
    assert "6\u00d7" in page or "6\\u00d7" in page
    assert not diagram.resonances([]).size
    with pytest.raises(bd.BeamdaeError, match="campbell: multiples must"):
        bd.campbell(rotor_on_a_bearing(), [1.0], multiples=[0])


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("speeds", [[0.0, 60.0, 120.0], [0.0, 100.0, 200.0], [0.0, 250.0]])
def test_regression_resonances_of_stiffened_blades_between_few_speeds(speeds):
    """Interpolation of the frequencies was up to 4 % off, of their squares up to 0.7 %."""
    mech = driven_blade(0.0, elements=3, section=rectangle(0.003, 0.03, material=ALLOY))
    first = bd.campbell(mech, speeds, n=1).resonances([1])["speed [rad/s]"]
    fine = bd.campbell(mech, np.linspace(80.0, 90.0, 6), n=1).resonances([1])["speed [rad/s]"]
    assert_allclose(first, fine, rtol=1e-6)


@pytest.mark.slow(reason="half a second and more")
def test_regression_resonances_do_not_depend_on_the_given_speeds():
    """Whirl with 10 - W and 10 + W was interpolated as stiffening between two speeds."""
    mech = rotor_on_a_bearing()
    table = bd.campbell(mech, [9.0, 1.0], n=3).resonances([3])
    assert_allclose(table["speed [rad/s]"], [2.5, 5.0], rtol=1e-6)
    # At rest, whirl in both directions has the same frequency and any shape.
    table = bd.campbell(mech, [-4.9, 5.1], n=3).resonances([3])
    assert_allclose(np.sort(table["speed [rad/s]"]), [-2.5, 2.5, 5.0], rtol=1e-6)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("speeds", [[1.0, 9.0], [0.0, 7.0]])
def test_regression_resonances_on_both_sides_of_an_instability(speeds):
    """One resonance was listed for both modes, and those of the first mode were missing."""
    table = bd.campbell(with_driver(*particle_in_rotor()), speeds, n=2).resonances([1, 2])
    # A root l = i k W: (25 - (1 + k^2) W^2) (40 - (1 + k^2) W^2) = 4 k^2 W^4.
    expected = [(1.842922, 1, 2), (2.773501, 1, 1), (5.719681, 2, 2)]
    actual = table[["speed [rad/s]", "mode", "multiple"]]
    assert_allclose(actual.to_numpy(), expected, rtol=1e-6)


@pytest.mark.slow(reason="a quarter of a second")
def test_modes_that_cannot_be_followed_are_named():
    """A mode grows at 5.6 rad/s; up to 30 rad/s, halvings do not resolve where this ends."""
    diagram = bd.campbell(with_driver(*particle_in_rotor()), [0.0, 5.6, 30.0], n=2)
    assert "mode 1 was not followed from 5.6 to 6.3625 rad/s" in diagram.warnings[-1]


@pytest.mark.slow(reason="a quarter of a second")
def test_campbell_diagram_follows_modes_through_crossings():
    mech = with_driver(*particle_in_rotor())
    diagram = bd.campbell(mech, [0.0, 1.0, 2.0, 3.0], n=2)
    assert diagram.eigenvalues.shape == (4, 2)
    for speed, values in zip(diagram.speeds, diagram.eigenvalues, strict=True):
        assert_allclose(np.sort(values.imag), np.sort(roots(speed).imag), rtol=1e-8)
    # Between the two frequencies a vibration splits into growth and decay; growth is followed.
    unstable = bd.campbell(mech, [0.0, 3.0, 5.6], n=2)
    assert_allclose(np.max(unstable.eigenvalues[-1].real), np.max(roots(5.6).real), rtol=1e-8)
    assert "at 5.6 rad/s, the state is unstable" in unstable.warnings[0]
    table = diagram.table()
    assert list(table)[:3] == ["speed [rad/s]", "mode 1 [Hz]", "mode 2 [Hz]"]
    assert_allclose(table["mode 1 [Hz]"], diagram.frequencies[:, 0])


@pytest.mark.parametrize("about", ["reference", "equilibrium"])
@pytest.mark.parametrize("analysis", [bd.modes, bd.linearize])
@pytest.mark.parametrize(("speed", "is_reported"), [(0.0, False), (0.1, False), (20.0, True)])
def test_regression_modes_at_rest_of_turning_mechanisms_have_a_warning(
    analysis, about, speed, is_reported
):
    """Modes at rest were those of a model whose driver turned at 6000 rpm, without a remark."""
    mech = with_driver(*particle_in_rotor(), law=lambda t: speed * t)
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        analysis(mech, about=about)
    sentences = [str(x.message) for x in issued]
    assert [x.startswith("drivers turn disk at 20 rad/s") for x in sentences] == [
        True
    ] * is_reported
    # The remedy.
    if is_reported:
        assert "about=bd.rotation(20)" in sentences[0]
        assert bd.modes(mech, about=bd.rotation(speed)).warnings[1:] == ()


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("analysis", [bd.modes, bd.linearize])
@pytest.mark.parametrize(("speed", "is_reported"), [(0.1, False), (20.0, True)])
def test_regression_turning_mechanisms_may_have_states(analysis, speed, is_reported):
    """An integrator of power ended modes: "undamped modes are not supported with states"."""
    mech = with_driver(*particle_in_rotor(), law=lambda t: speed * t)
    power = mech.sensor("power", mech.parts["cross"].power)
    mech.state("work", power, unit="J")
    # A slow state, at 0.01 rad/s, is no slow vibration.
    mech.state("filter", lambda x, t: 0.01 * (power - x), unit="W")
    result = analysis(mech)
    assert any(x.startswith("drivers turn disk at 20") for x in result.warnings) == is_reported
    if analysis is bd.modes:
        expected = bd.modes(with_driver(*particle_in_rotor(), law=lambda t: speed * t))
        vibrations = result.eigenvalues[result.eigenvalues.imag > 0.0]
        assert_allclose(vibrations, expected.eigenvalues, rtol=1e-9)


@pytest.mark.parametrize(("gravity", "is_reported"), [(0.0, True), (9.81, False)])
def test_modes_at_rest_of_bodies_with_given_rotations_have_a_warning(gravity, is_reported):
    """Given velocities of an oscillation do not last."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    arm, tip = (
        mech.add(
            bd.RigidBody(
                name, 1.0, 0.3, center=(0.0, y), velocity=(-2.0 * y, 0.0), angular_velocity=2.0
            )
        )
        for name, y in (("arm", -1.0), ("tip", -1.5))
    )
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), arm.at(0.0, 0.0)))
    mech.add(bd.Bushing("mount", arm.at(0.0, -1.5), tip.at(0.0, -1.5), 90.0, 90.0, 90.0))
    modes = bd.modes(mech)
    assert (
        any(x.startswith("given velocities turn arm at 2") for x in modes.warnings) == is_reported
    )


# Starts in steady rotation: runs and periodic motions of turning beams.

SPEED = 5.0  # [rad/s]


def driven_beam(gravity=0.0, **settings):
    """Return a beam whose root is driven at a constant speed."""
    section = rectangle(0.002, damping=1e-4)
    mech, beam = hinged_beam(section, 2, gravity=gravity, **settings)
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), beam.start, lambda t: SPEED * t))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.parametrize("settings", [{"strain": "exact"}, {"formulation": "exact"}])
def test_turning_beam_stays_in_steady_rotation(settings):
    solution = bd.simulate(
        driven_beam(**settings), bd.Radau(1e-5), t_end=0.1, start=bd.rotation(SPEED)
    )
    radius = np.hypot(solution["tip.x"], solution["tip.y"])
    # Stretch of a uniform rod: rho W^2 L^3 / (3 E).
    stretch = STEEL.rho * SPEED**2 / (3.0 * STEEL.E)
    np.testing.assert_allclose(radius - 1.0, stretch, rtol=1e-4)


@pytest.mark.slow(reason="half a second and more")
def test_periodic_motion_of_a_turning_beam():
    period = 2.0 * np.pi / SPEED
    mechanism = driven_beam(strain="exact")
    motion = bd.periodic(mechanism, period, start=bd.rotation(SPEED), settle=0)
    assert motion.status.success
    assert motion.stable
    # Modes of the damped beam in steady rotation: multipliers exp(lambda T).
    modes = bd.modes(mechanism, bd.rotation(SPEED), 1)
    growth = -2.0 * np.pi * modes.frequencies[0] * modes.damping_ratios[0]
    assert np.abs(motion.multipliers[0]) == pytest.approx(np.exp(growth * period), rel=1e-4)


@pytest.mark.parametrize("settings", [{}, {"strain": "exact"}, {"formulation": "exact"}])
def test_driver_sets_a_whole_beam_in_motion(settings):
    # If only the root turned, the tip would lag behind by 2.2 rad.
    solution = bd.simulate(driven_beam(**settings), bd.Radau(1e-5), t_end=0.1)
    angle = np.arctan2(solution["tip.y"], solution["tip.x"])
    np.testing.assert_allclose(angle, SPEED * solution.t, rtol=0.0, atol=1e-6)
    # The beam is drawn without stretch, which oscillates up to twice its steady value.
    radius = np.hypot(solution["tip.x"], solution["tip.y"])
    assert np.max(np.abs(radius - 1.0)) < 2.1 * STEEL.rho * SPEED**2 / (3.0 * STEEL.E)


@pytest.mark.slow(reason="half a second and more")
def test_periodic_motion_of_a_driven_beam_as_drawn():
    motion = bd.periodic(driven_beam(strain="exact"), 2.0 * np.pi / SPEED)
    assert motion.status.success
    assert motion.stable


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_driver_sets_a_flexible_slider_crank_in_motion(unit):
    crank_length, rod_length, speed = 0.1 * unit, 0.4 * unit, 30.0
    section = rectangle(0.004 * unit, 0.02 * unit)
    mech = bd.Mechanism()
    axle = mech.ground.at(0.0, 0.0)
    crank = mech.add(bd.Beam("crank", bd.Line((0.0, 0.0), (0.0, crank_length)), section))
    pin = (0.0, crank_length)
    end = (np.sqrt(rod_length**2 - crank_length**2), 0.0)
    rod = mech.add(bd.Beam("rod", bd.Line(pin, end), section, formulation="exact"))
    mech.add(bd.Revolute("axle", axle, crank.start))
    mech.add(bd.Driver("motor", axle, crank.start, lambda t: speed * t))
    mech.add(bd.Revolute("crank pin", crank.end, rod.start))
    mech.add(bd.PointOnLine("guide", axle, rod.end, (1.0, 0.0)))
    mech.observe("middle", rod.at(0.5 * rod_length))
    mech.observe("slider", rod.end)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    # Velocities of a rigid slider-crank: the rod, its upper end above the axle, translates.
    for name in ("middle", "slider"):
        velocity = [solution[f"{name}.{x}"].iloc[0] for x in ("x_dot", "y_dot")]
        np.testing.assert_allclose(velocity, [-speed * crank_length, 0.0], atol=1e-9 * unit)


def test_given_velocities_are_stopped_by_joints():
    # A moving rod that a wall stops at one end: only this end stops at once.
    mech, beam = clamped_beam(rectangle(0.02), 4, velocity=(-1.0, 0.0))
    mech.observe("end", beam.end)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    assert solution["end.x_dot"].iloc[0] == pytest.approx(-1.0, abs=0.2)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_bodies_apart_do_not_change_how_a_driven_beam_starts():
    """A velocity of 1e-9 m/s of another body let the beam whip."""
    mech = driven_beam(strain="exact")
    mech.add(bd.PointMass("apart", 1.0, at=(5.0, 0.0), velocity=(1e-9, 0.0)))
    alone, together = (bd.simulate(x, t_end=0.1) for x in (driven_beam(strain="exact"), mech))
    np.testing.assert_allclose(together["tip.y"], alone["tip.y"], atol=1e-4)
    assert together["apart.x"].iloc[-1] == pytest.approx(5.0 + 1e-10, abs=1e-13)


@pytest.mark.slow(reason="a quarter of a second")
def test_drivers_that_bend_a_beam():
    # Both ends turn in opposite directions: the beam has no rigid motion.
    section = rectangle(0.02)
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, formulation="exact"))
    for name, point, x, rate in (("left", beam.start, 0.0, 0.5), ("right", beam.end, 1.0, -0.5)):
        support = mech.ground.at(x, 0.0)
        mech.add(bd.PointOnLine(f"{name} guide", support, point, (1.0, 0.0)))
        mech.add(bd.Driver(name, support, point, lambda t, rate=rate: rate * t))
    mech.observe("left", beam.start)
    solution = bd.simulate(mech, t_end=1e-6, output_step=1e-6)
    assert solution.status.success


@pytest.mark.slow(reason="a quarter of a second")
def test_weight_acts_as_at_the_start():
    solution = bd.simulate(driven_beam(9.81, strain="exact"), t_end=0.01, start=bd.rotation(SPEED))
    assert solution.status.success
    assert solution["tip.y"].iloc[0] < -1e-3


def test_mechanism_with_a_start_in_rotation():
    section = rectangle(0.02)
    mech = bd.Mechanism(start=bd.rotation(2.0, center=(0.5, 0.0)))
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, formulation="exact"))
    mech.observe("end", beam.start)
    solution = bd.simulate(mech, t_end=0.5 * np.pi)
    # Half a revolution of a free beam about its center.
    assert solution["end.x"].iloc[-1] == pytest.approx(1.0, abs=1e-4)
    assert solution["end.y"].iloc[-1] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    "start", [bd.rotation(4.0), bd.rotation(SPEED, (0.1, 0.0)), bd.rotation(SPEED, (-5.0, 3.0))]
)
def test_rotation_that_contradicts_a_joint_is_rejected(start):
    with pytest.raises(bd.BeamdaeError, match=r"does not allow a rotation at .* (use|turns all)"):
        bd.simulate(driven_beam(strain="exact"), t_end=0.1, start=start)


@pytest.mark.parametrize("joint", [bd.Weld, bd.Revolute])
def test_regression_rotations_that_joints_prevent_do_not_name_a_driver(joint):
    """The remedy was to use the speed of the driver, although there was none."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)))
    mech.add(joint("root", mech.ground.at(0.1, 0.0), hub.at(0.1, 0.0)))
    with pytest.raises(bd.BeamdaeError, match=r"about the center of their Revolute; .*run_up"):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(30.0))


def test_slider_cranks_have_no_rotation_as_one_body():
    mech = bd.Mechanism()
    origin = mech.ground.at(0.0, 0.0)
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.0, 0.1), mass=1.0))
    block = mech.add(bd.PointMass("block", 1.0, at=(0.4, 0.0)))
    mech.add(bd.Revolute("bearing", origin, crank.at(0.0, 0.0)))
    mech.add(bd.PointOnLine("guide", origin, block.point, (1.0, 0.0)))
    mech.add(bd.Distance("rod", crank.at(0.0, 0.1), block.point))
    mech.add(bd.Driver("motor", origin, crank.at(0.0, 0.0), lambda t: 6.0 * t))
    with pytest.raises(bd.BeamdaeError, match=r"such as slider-cranks, .* bd.run_up"):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(6.0))


def test_regression_rotations_of_rotors_on_guided_bases_do_not_blame_the_driver():
    """The remedy was to use the speed of the driver, which the rotation had."""
    mech = bd.Mechanism()
    origin = mech.ground.at(0.0, 0.0)
    base = mech.add(bd.RigidBody("base", 5.0, 0.1, center=(0.0, 0.0)))
    foot = base.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", origin, foot, (0.0, 1.0)))
    shaking = bd.TranslationalDriver(
        "shaker", origin, foot, lambda t: 1e-3 * np.sin(90.0 * t), direction=(0.0, 1.0)
    )
    mech.add(shaking)
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)))
    mech.add(bd.Revolute("axle", foot, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", foot, hub.at(0.0, 0.0), lambda t: 60.0 * t))
    message = (
        r"start: .* does not allow .* turns all parts as one body, .* bd.run_up .* start=\{...\}"
    )
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(60.0))
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.simulate(mech, t_end=0.1, start=bd.rotation(60.0, (0.1, 0.0)))
    assert bd.simulate(mech, t_end=1e-3, start={"hub.angle_dot": 60.0}).status.success


@pytest.mark.parametrize("typed", [1256.64, 1256.637, 1256.637061])
def test_regression_speeds_rounded_to_six_digits_are_those_of_the_driver(typed):
    """A speed of 1256.637 for 12000 rpm was rejected, without the speed of the driver."""
    speed = 12000.0 * np.pi / 30.0
    mech, hub = driven(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)), lambda t: speed * t)
    mech.observe("hub", hub.at(0.1, 0.0))
    run = bd.simulate(mech, t_end=1e-4, start=bd.rotation(typed))
    assert run["hub.angle_dot"].iloc[0] == pytest.approx(speed, rel=1e-12)
    with pytest.raises(
        bd.BeamdaeError, match=r"at 1257 rad/s .* speed of the drivers, 1256\.637061"
    ):
        bd.simulate(mech, t_end=1e-4, start=bd.rotation(1257.0))
