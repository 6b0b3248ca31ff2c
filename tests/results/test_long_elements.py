"""Warnings of runs in which long elements of beams shift the phase of vibrations."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.diagnostics.meshes import forced_vibrations
from beamdae.results.diagnostics.meshes.forced_vibrations import _Vibration
from beamdae.results.run_checks import BEAMS, skip_error_estimates

SECTION = bd.Section.rectangle(bd.Material(E=210e9, nu=0.3, rho=7850.0), width=0.02, height=0.01)
LENGTH = 1.0


@pytest.fixture(autouse=True)
def _unrepeated_runs():
    """Runs of few elements that are repeated with halved ones need no estimates."""
    with skip_error_estimates(BEAMS):
        yield


def frequency(beta):
    """Natural frequency [Hz] of bending with the wave number beta / length."""
    return beta**2 / (2.0 * np.pi * LENGTH**2) * (SECTION.EI / SECTION.rhoA) ** 0.5


def pulse(duration, force):
    """Force that rises, stays and falls within `duration` [s]."""
    return bd.table(
        duration * np.array([0.0, 0.2, 0.8, 1.0]), [0.0, force, force, 0.0], kind="linear"
    )


def cantilever(elements, formulation="floating frame", load=None, section=SECTION):
    """Cantilever that a pulse at its tip excites, mainly in modes 1 and 2."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, load or pulse(0.5 / frequency(4.694), 5.0))))
    mech.observe("tip", beam.end)
    return mech


def simulate(mech, periods=100, rate=4.694):
    """Simulate these periods of a mode; 100 steps per period of mode 2 hardly shift its phase."""
    t_end = periods / frequency(rate)
    return bd.simulate(mech, bd.GeneralizedAlpha(t_end / 10_000), t_end, output_step=t_end / 2000)


def warnings_of(run):
    return [x for x in run.warnings if "elements are too long for its vibration" in x]


def error_of_half_range(coarse, fine, header):
    """Largest difference of two runs relative to half the range of a column."""
    exact = fine.columns[header]
    return np.max(np.abs(coarse.columns[header] - exact)) / (0.5 * np.ptp(exact))


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_regression_phase_errors_by_long_elements_are_estimated(formulation):
    """100 periods of the second mode with two elements were off by 30 % without a word."""
    coarse = simulate(cantilever(2, formulation))
    fine = simulate(cantilever(8, formulation))
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    match = re.match(
        r"beam: .* about (\S+) % of half the range of tip\.angle_dot .*elements=(\d+)\.$", message
    )
    assert match
    error = error_of_half_range(coarse, fine, "tip.angle_dot [rad/s]")
    assert 0.7 < float(match[1]) / (100.0 * error) < 1.3
    assert 6 <= int(match[2]) <= 9


@pytest.mark.slow(reason="a fifth of a second")
def test_phase_errors_of_damped_vibrations_do_not_accumulate():
    damped = bd.Section.rectangle(SECTION.material, width=0.02, height=0.01, damping=1e-4)
    load = bd.sine(10.0, frequency=1.3 * frequency(4.694))
    assert not warnings_of(simulate(cantilever(3, load=load, section=damped), periods=200))


@pytest.mark.slow(reason="a fifth of a second")
def test_slow_motions_have_no_warning():
    """A run of half a period of a soft cantilever contains no vibration, but has wave numbers."""
    soft = bd.Section.rectangle(SECTION.material, width=0.02, height=5e-4)
    ramp = bd.run_up(20.0, 0.1)
    run = bd.simulate(
        cantilever(3, "exact", ramp, soft), bd.GeneralizedAlpha(1e-4), 0.1, output_step=1e-3
    )
    assert np.ptp(run["tip.y"]) > 0.05
    assert not warnings_of(run)


@pytest.mark.slow(reason="a quarter of a second")
def test_rigid_rotations_are_no_vibrations():
    """A blade that spins freely at five times its first frequency hardly vibrates."""
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.2, mass=20.0))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    line = bd.Line((0.2, 0.0), (0.2 + LENGTH, 0.0))
    blade = mech.add(bd.Beam("blade", line, SECTION, 2))
    mech.add(bd.Weld("root", hub.at(0.2, 0.0), blade.start))
    mech.observe("tip", blade.end)
    speed = 5.0 * 2.0 * np.pi * frequency(1.875)
    run = bd.simulate(mech, bd.GeneralizedAlpha(2e-4), 2.0, start=bd.rotation(speed))
    assert np.ptp(run["tip.x"]) > 2.0
    assert not warnings_of(run)


def shaken_beam(elements, frequency, axial=False, formulation="floating frame"):
    """Clamped beam with 2 % damping that a harmonic force maintains in vibration."""
    mech = bd.Mechanism()
    damping = 0.04 / (2.0 * np.pi * frequency)
    section = bd.Section.rectangle(SECTION.material, width=0.02, height=0.01, damping=damping)
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    force = bd.sine(10.0, frequency=frequency)
    mech.add(bd.Force("push", beam.end, (force, 0.0) if axial else (0.0, force)))
    mech.observe("tip", beam.end)
    return mech


def maintained(elements, frequency, **options):
    t_end = 60.0 / frequency
    step = 0.025 / frequency
    mech = shaken_beam(elements, frequency, **options)
    return bd.simulate(mech, bd.GeneralizedAlpha(step), t_end, output_step=2.0 * step)


AXIAL_RATE = 0.75 * (SECTION.EA / SECTION.rhoA) ** 0.5 / LENGTH  # second axial mode [Hz]


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize(
    ("rate", "axial", "coarse"),
    [
        (frequency(4.694), False, 2),
        (1.3 * frequency(4.694), False, 1),
        (frequency(7.855), False, 3),
        (AXIAL_RATE, True, 2),
    ],
)
def test_regression_amplitudes_of_maintained_vibrations_by_long_elements(
    rate, axial, coarse, formulation
):
    """Amplitudes were wrong by 7 to 70 %, with one element by 300 %, without a word."""
    run = maintained(coarse, rate, axial=axial, formulation=formulation)
    fine = maintained(10, rate, axial=axial, formulation=formulation)
    (message,) = warnings_of(run)
    assert not warnings_of(fine)
    match = re.match(
        r"beam: .* wrong by about (\S+) % of half the range of (\S+).* use elements=(\d+)\.$",
        message,
    )
    assert match
    (header,) = (x for x in run.columns if x.startswith(f"{match[2].rstrip(';')} ["))
    later = run.t >= 0.5 * run.t[-1]
    difference = np.abs(run.columns[header] - fine.columns[header])[later]
    error = np.max(difference) / (0.5 * np.ptp(run.columns[header]))
    assert 0.5 < float(match[1]) / (100.0 * error) < 2.5
    better = maintained(int(match[3]), rate, axial=axial, formulation=formulation)
    assert not warnings_of(better)
    difference = np.abs(better.columns[header] - fine.columns[header])[later]
    assert np.max(difference) < 0.02 * 0.5 * np.ptp(fine.columns[header])


@pytest.mark.slow(reason="a quarter of a second")
def test_maintained_vibrations_of_several_elements_per_wave_have_no_warning():
    for elements, rate in ((2, frequency(1.875)), (4, frequency(4.694)), (4, 20.0)):
        assert not warnings_of(maintained(elements, rate))


@pytest.mark.slow(reason="a quarter of a second")
def test_short_elements_are_examined_without_linearization(monkeypatch):
    """A bound of the error suffices: solving for the error took a third of the run's time."""
    solved, bounds = [], []
    measure, bound = _Vibration.measure, _Vibration.bound
    monkeypatch.setattr(
        _Vibration, "measure", lambda x, *a: solved.append(x.beam.name) or measure(x, *a)
    )

    def bound_and_record(vibration, half_ranges, observe):
        bounds.append(bound(vibration, half_ranges, observe))
        return bounds[-1]

    monkeypatch.setattr(_Vibration, "bound", bound_and_record)
    assert not warnings_of(maintained(5, frequency(1.875)))
    assert len(bounds) == 1
    assert not solved
    # Estimates that are needed do not exceed the bound.
    run = maintained(2, frequency(4.694))
    (message,) = warnings_of(run)
    estimate = float(re.search(r"about (\S+) %", message)[1]) / 100.0
    assert solved
    assert bounds[1] > estimate


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_largest_peaks_of_few_coordinates_are_selected(monkeypatch):
    """Selecting those of all coordinates for each unit took a tenth of the time of a case."""
    selected, counts = [], []
    select, bound = forced_vibrations._sum_largest, _Vibration.bound

    def select_and_record(factors, changes):
        sums = select(factors, changes)
        selected.append(len(sums))
        return sums

    def bound_and_record(vibration, *arguments):
        counts.append(vibration.amplitudes.shape[1])
        return bound(vibration, *arguments)

    monkeypatch.setattr(forced_vibrations, "_sum_largest", select_and_record)
    monkeypatch.setattr(_Vibration, "bound", bound_and_record)
    assert not warnings_of(maintained(5, frequency(1.875)))
    # Gradients of points need those of all coordinates, of one unit only.
    assert selected.count(counts[0]) <= 1


def test_the_largest_sum_of_selected_coordinates_is_exact():
    random = np.random.default_rng(3)
    changes, factors = random.exponential(size=(50, 200)), random.random(200)
    sums, where = forced_vibrations._sum_all(factors, changes), random.random(50) < 0.7
    expected = np.max(forced_vibrations._sum_largest(factors, changes)[where])
    assert forced_vibrations._largest_sum(factors, changes, sums, where) == expected


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_small_motions_of_points_are_bounded_without_linearization(monkeypatch):
    """Motions along the span, 1 % of those across, had their bound: the check took 6 ms, not 2."""
    solved = []
    measure = _Vibration.measure
    monkeypatch.setattr(
        _Vibration, "measure", lambda x, *a: solved.append(x.beam.name) or measure(x, *a)
    )
    run = bd.simulate(bd.load_model("example:shallow_arch")())
    assert np.ptp(run["quarter.x"]) < 0.02 * np.ptp(run["quarter.y"])
    assert not warnings_of(run)
    assert not solved


@pytest.mark.slow(reason="100 periods of two meshes")
def test_regression_axial_phase_errors_by_long_elements_are_estimated():
    """Free axial vibrations were off by 8 to 32 %, without a word."""

    def rod(elements):
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
        beam = mech.add(bd.Beam("beam", line, SECTION, elements))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Force("pull", beam.end, (pulse(0.5 / AXIAL_RATE, 100.0), 0.0)))
        mech.observe("tip", beam.end)
        t_end = 100.0 / AXIAL_RATE
        return bd.simulate(mech, bd.GeneralizedAlpha(t_end / 8000), t_end, output_step=t_end / 4000)

    coarse, fine = rod(2), rod(12)
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    later = fine.t >= 0.5 * fine.t[-1]
    exact = fine["tip.x"].to_numpy()
    error = np.max(np.abs(coarse["tip.x"].to_numpy() - exact)[later]) / (0.5 * np.ptp(exact))
    assert error > 0.1
    assert "tip.x" in message


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_recommended_numbers_of_elements_are_not_absurd():
    """After a sudden load, 22 elements were recommended, whose error was 32 % of half the range."""
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (LENGTH, 0.0)), SECTION, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("pull", beam.end, (1e4, 0.0)))
    mech.observe("tip", beam.end)
    mech.observe("middle", beam.stress(0.5 * LENGTH, "top"))
    run = bd.simulate(mech, bd.GeneralizedAlpha(0.01 / 8000), 0.01)
    (message,) = warnings_of(run)
    assert "rod: " in message
    assert "use more than elements=16, or suppress the fastest waves by material damping" in message


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_large_errors_have_a_lower_limit_of_the_number_of_elements():
    """Errors with one element hide further vibrations, which need more elements than computed."""
    mech, beam = kicked_cantilever(1, 1e-4)
    mech.observe("clamp", beam.section_forces(0.0))
    (message,) = warnings_of(bd.simulate(mech, bd.Ida(), 0.3))
    assert " is wrong by 100 % or more " in message
    assert re.search(r"; use at least elements=\d\.$", message)


def swinging_bow(elements):
    """Hinged beam of increasing curvature with two masses, released under gravity."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=69e9, nu=0.33, rho=2700.0)
    strip = bd.Section.rectangle(alloy, width=0.02, height=0.003, damping=1e-5)
    curve = bd.IntrinsicCurve(lambda s: 3.0 * s - 1.0, 0.9, angle=-0.2)
    beam = mech.add(bd.Beam("bow", curve, strip, elements))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointMass("end mass", 0.1, on=beam.end))
    mech.add(bd.PointMass("middle mass", 0.05, on=beam.at(0.45)))
    mech.observe("tip", beam.end)
    mech.observe("gauge", beam.stress(0.3, 0.0015))
    mech.observe("hinge", hinge.reaction)
    return mech


@pytest.mark.slow(reason="mesh of 8 elements as a reference")
def test_regression_stresses_and_rates_of_turning_beams():
    """A stress and a rate were off by 15 and 11 % of half their ranges, without a word."""
    coarse, fine = (bd.simulate(swinging_bow(n), bd.Ida(), 1.0) for n in (2, 8))
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    match = re.search(r" is about (\S+) % of half the range of gauge .*tip\.angle_dot", message)
    assert match
    error = error_of_half_range(coarse, fine, "gauge [Pa]")
    assert 0.6 < float(match[1]) / (100.0 * error) < 1.4


@pytest.mark.slow(reason="mesh of 12 elements as a reference")
def test_regression_vibrations_of_turning_beams_beside_drivers():
    """A lightly damped arm vibrates at rest after a driver has turned it: 20 % were not named."""

    def build(elements):
        mech = bd.Mechanism()
        hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.05, mass=1.0))
        mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
        line = bd.Line((0.05, 0.0), (0.85, 0.0))
        section = bd.Section.rectangle(SECTION.material, width=0.02, height=0.01, damping=1e-5)
        arm = mech.add(bd.Beam("arm", line, section, elements))
        mech.add(bd.Weld("root", hub.at(0.05, 0.0), arm.start))
        angle = bd.table([0.0, 0.04, 0.08], [0.0, 0.6, 1.2], kind="pchip")
        points = mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)
        mech.add(bd.Driver("motor", *points, angle))
        mech.observe("tip", arm.end)
        mech.observe("gauge", arm.stress(0.0, 0.005))
        return mech

    coarse, fine = (bd.simulate(build(n), bd.Radau(), 0.6) for n in (1, 12))
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    assert message.startswith("arm: the elements are too long for its vibration, and the phase")
    assert "gauge" in message
    assert error_of_half_range(coarse, fine, "gauge [Pa]") > 0.05


def kicked_cantilever(elements, damping):
    """Cantilever with an end mass that an input kicks."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(SECTION.material, width=0.02, height=0.005, damping=damping)
    line = bd.Line((0.0, 0.0), (0.6, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, elements))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.PointMass("mass", 0.05, on=beam.end))
    kick = mech.input("kick", default=pulse(2e-3, 50.0), unit="N")
    mech.add(bd.Force("push", beam.end, (0.0, kick)))
    mech.observe("tip", beam.end)
    mech.observe("gauge", beam.stress(0.0, 0.0025))
    return mech, beam


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_stresses_and_rates_of_vibrations_about_rest():
    """The stress at the clamp was off by 50 % of half its range; the angle alone was named."""
    coarse, fine = (bd.simulate(kicked_cantilever(n, 1e-4)[0], bd.Ida(), 0.3) for n in (1, 6))
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    assert "gauge" in message
    assert "tip.angle_dot" in message
    assert error_of_half_range(coarse, fine, "gauge [Pa]") > 0.1


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_vibrations_that_decay_in_the_first_half_of_a_run():
    """The rate of a damped arc under sudden weight was off by 20 % of half its range."""

    def build(elements):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        steel = SECTION.material
        strip = bd.Section.rectangle(steel, width=0.02, height=0.004, damping=1e-3)
        beam = mech.add(bd.Beam("arc", bd.Arc(0.4, 0.7, angle=0.2), strip, elements))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.PointMass("mass", 0.15, on=beam.end))
        mech.observe("tip", beam.end)
        return mech

    coarse, fine = (bd.simulate(build(n), bd.Ida(), 0.6) for n in (1, 4))
    (message,) = warnings_of(coarse)
    assert not warnings_of(fine)
    assert "tip.angle_dot" in message
    assert error_of_half_range(coarse, fine, "tip.angle_dot [rad/s]") > 0.1


@pytest.mark.slow(reason="half a second")
def test_regression_vibrations_between_events_that_switch_parts():
    """Runs whose events switch parts were not examined."""
    mech, beam = kicked_cantilever(1, 1e-4)
    stay = mech.add(bd.Revolute("stay", mech.ground.at(0.6, 0.0), beam.end))
    mech.deactivate(stay)
    mech.when("tip.y", crosses=1e-4, do=bd.deactivate(stay), name="pass")
    (message,) = warnings_of(bd.simulate(mech, bd.Ida(), 0.3))
    assert "whose amplitude or phase is wrong" in message
    assert "gauge" in message


@pytest.mark.parametrize("elements", [2, 4])
def test_regression_slow_periodic_motions_are_no_vibrations(elements):
    """Errors of the tension, quadratic in the bending, were "100 % or more" and 2 % of it."""
    aluminum = bd.Material.of("aluminum")
    section = bd.Section.rectangle(aluminum, width=0.03, height=0.003, damping=1e-4)

    def motion_of(elements):
        mech = bd.Mechanism()
        hub = mech.add(bd.RigidBody("hub", mass=4.0, inertia=0.02))
        center = mech.ground.at(0.0, 0.0)
        line = bd.Line((0.1, 0.0), (0.6, 0.0))
        mech.add(bd.Revolute("bearing", center, hub.at(0.0, 0.0)))
        blade = bd.Beam("blade", line, section, elements=elements, strain="exact")
        beam = mech.add(blade)
        mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), beam.start))
        angle = bd.sine(1.0 / (2.0 * np.pi * 9.5) ** 2, 9.5)
        mech.add(bd.Driver("motor", center, hub.at(0.0, 0.0), angle))
        mech.observe("root", beam.section_forces(0.0))
        return bd.periodic(mech, 1.0 / 9.5, bd.Radau(1e-7))

    motion, fine = motion_of(elements), motion_of(12)
    sizes = (x.amplitudes().loc["root.N [N]", "half range"] for x in (motion, fine))
    assert np.divide(*sizes) == pytest.approx(1.0, abs=5e-3)
    assert motion.warnings == ()
