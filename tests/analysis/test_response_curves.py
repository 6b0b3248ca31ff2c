"""Response curves of beams on drivers against linear models; steps that reverse; peaks."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from mechanisms import free_ball, rectangle
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import beamdae as bd
from beamdae.accuracy.errors import Errors
from beamdae.analysis.periodic.monodromy import LinearizationError
from beamdae.analysis.periodic.period_map import PeriodRun
from beamdae.report.pictures.analysis_plots import create_response_figure
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status

AMPLITUDE = 1e-4  # m or rad
RUNS = bd.Radau(1e-5)
BLADE_RESONANCE = 13.92  # Hz
BLADE_ACCELERATION = 5e-3  # m/s^2
UNIT_LENGTH = SimpleNamespace(length=1.0)  # equations of a mechanism of 1 m


def run_with_columns(columns):
    """Return a run of a mechanism of 1 m with these observed columns, without further steps."""
    return SimpleNamespace(
        columns=columns,
        warnings=(),
        equations=UNIT_LENGTH,
        _column_ranges={k: (x.min(), x.max()) for k, x in columns.items()},
        _column_means={k: x.mean() for k, x in columns.items()},
    )


def shaken_strip(law, rotates=False, damping=2e-4, elements=2, strain="exact"):
    """Return a damped strip whose first section is driven, with its first resonance at 41 Hz."""
    mech = bd.Mechanism()
    section = rectangle(0.006, 0.05, damping=damping)
    line = bd.Line((0.0, 0.0), (0.35, 0.0))
    beam = mech.add(bd.Beam("strip", line, section, elements, strain))
    base = mech.ground.at(0.0, 0.0)
    if rotates:
        mech.add(bd.Revolute("pin", base, beam.start))
        mech.add(bd.Driver("shaker", base, beam.start, law))
    else:
        mech.add(bd.Prismatic("guide", base, beam.start, direction=(0.0, 1.0)))
        mech.add(bd.TranslationalDriver("shaker", base, beam.start, law, direction=(0.0, 1.0)))
    mech.observe("tip", beam.deflection(0.35))
    return mech


@bd.model(t_end=0.5)
def pushed_mass(frequency=40.0):
    """Return a mass on a damped spring under a periodic force."""
    mech, mass = free_ball((1.0, 0.0), name="mass", spring=(4e4, 20.0))
    mech.add(bd.Force("push", mass.point, (bd.sine(1.0, frequency), 0.0)))
    return mech


@bd.model(t_end=0.5)
def constant_travel(frequency=40.0):
    """Return a strip on a shaker with a constant amplitude of the travel."""
    return shaken_strip(bd.sine(AMPLITUDE, frequency))


@bd.model(t_end=0.5)
def constant_acceleration(frequency=40.0):
    """Return a strip on a shaker with a constant amplitude of the acceleration."""
    return shaken_strip(bd.sine(AMPLITUDE * (40.0 / frequency) ** 2, frequency))


@bd.model(t_end=0.5)
def cosine_travel(frequency=40.0):
    """Return a strip on a shaker that begins at its largest travel."""
    return shaken_strip(bd.sine(AMPLITUDE, frequency, 0.5 * np.pi))


@bd.model(t_end=0.5)
def constant_rotation(frequency=40.0):
    """Return a strip whose root rotates with a constant amplitude."""
    return shaken_strip(bd.sine(AMPLITUDE, frequency), rotates=True)


@bd.model(t_end=0.5)
def lightly_damped(frequency=40.0):
    """Return a strip with a damping ratio of 0.26 % on a shaker with a constant acceleration."""
    return shaken_strip(bd.sine(0.1266 / frequency**2, frequency), damping=2e-5)


@bd.model(t_end=0.5)
def amplified_travel(amplitude=AMPLITUDE):
    """Return a strip on a shaker at 40 Hz."""
    return shaken_strip(bd.sine(amplitude, 40.0))


def shaken_blade(damping_ratio, elements=2):
    """Return a model of a steel blade of 0.6 m on a shaker with a constant acceleration."""

    @bd.model(t_end=1.0)
    def blade(frequency=20.0):
        mech = bd.Mechanism()
        damping = damping_ratio / (np.pi * BLADE_RESONANCE)
        section = rectangle(0.006, 0.05, damping=damping)
        beam = mech.add(bd.Beam("blade", bd.Line((0.0, 0.0), (0.6, 0.0)), section, elements))
        base, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
        law = bd.sine(BLADE_ACCELERATION / (2.0 * np.pi * frequency) ** 2, frequency)
        mech.add(bd.Prismatic("guide", base, beam.start, direction=up))
        mech.add(bd.TranslationalDriver("shaker", base, beam.start, law, direction=up))
        mech.observe("tip", beam.deflection(0.6))
        return mech

    return blade


def linear_half_range(frequencies, rotates=False):
    """Return the half range of the tip relative to the root for a travel of AMPLITUDE."""
    mech = shaken_strip(bd.sine(AMPLITUDE, 40.0), rotates)
    linear = bd.linearize(mech, inputs=["shaker"], outputs=["tip"])
    row = [output.name for output in linear.outputs].index("tip.transverse")
    by_acceleration = np.abs(linear.frequency_response(frequencies)[:, row, 0])
    return by_acceleration * AMPLITUDE * (2.0 * np.pi * np.asarray(frequencies)) ** 2


@pytest.mark.parametrize(("unit", "turn"), [("Hz", 1.0), ("kHz", 1e-3), ("rpm", 60.0)])
def test_the_unit_of_a_frequency_gives_the_period(unit, turn):
    """Parameters in rpm had the period of a frequency in Hz, without a word."""

    @bd.model(t_end=0.5)
    def pushed(speed=bd.param(40.0, unit)):
        return pushed_mass(frequency=speed / turn)

    response = bd.frequency_response(pushed, "speed", (38.0 * turn, 38.5 * turn), max_points=2)
    assert response.points[0].solution.t[-1] == pytest.approx(1.0 / 38.0)


def test_the_period_over_other_quantities_is_required():
    @bd.model(t_end=0.5)
    def pushed(force=bd.param(1.0, "N")):
        return pushed_mass()

    with pytest.raises(bd.BeamdaeError, match=r"force \[N\] is not a frequency; pass period="):
        bd.frequency_response(pushed, "force", (1.0, 2.0))


SLOW = pytest.mark.slow(reason="twenty periodic motions of a beam")


@pytest.mark.slow(reason="ten accurate runs of a beam")
def test_regression_first_steps_beside_a_superharmonic_resonance_of_a_wide_range():
    """The one-sided derivative turned the tangent; steps of 1e-3 of the first one were rejected."""
    ends = (0.5 * BLADE_RESONANCE, 20.0 * BLADE_RESONANCE)
    model = shaken_blade(damping_ratio=2e-3)
    response = bd.frequency_response(model, "frequency", ends, settle=5, step=0.01, max_points=2)
    assert response.points[1].parameter > ends[0] + 0.1


@pytest.mark.slow(reason="eighty periodic motions of a beam")
def test_regression_response_of_a_blade_over_two_resonances():
    """With Radau(1e-5), the curve of four elements ended at 7.6 Hz: "turns too sharply"."""
    model = shaken_blade(damping_ratio=2e-3, elements=4)
    ends = (0.5 * BLADE_RESONANCE, 6.6 * BLADE_RESONANCE)
    response = bd.frequency_response(model, "frequency", ends, integrator=RUNS)
    assert response.status.sentence == "reached the end of the range"
    assert response.folds == []
    assert len(response.points) < 110
    frequencies, sizes = response.curve("tip.transverse")
    linear = bd.linearize(model(), inputs=["shaker"], outputs=["tip"])
    row = [x.name for x in linear.outputs].index("tip.transverse")
    expected = BLADE_ACCELERATION * np.abs(linear.frequency_response(frequencies)[:, row, 0])
    np.testing.assert_allclose(sizes, expected, rtol=1e-3)
    assert len(response.peaks("tip.transverse")) == 2


def test_regression_a_failed_response_has_a_table_with_its_columns(monkeypatch):
    """The table had no columns, and its CSV file no header."""
    module = "beamdae.analysis.periodic.periodic_continuation"
    incomplete = SimpleNamespace(relative_deviation=1.0, monodromy=lambda: np.diag([0.9, 0.9]))
    monkeypatch.setattr(f"{module}.settle_and_solve", lambda *_: SimpleNamespace(run=incomplete))
    with pytest.warns(bd.BeamdaeWarning, match=r"use bd\.linearize\(\.\.\.\)\.frequency_resp"):
        response = bd.frequency_response(pushed_mass, "frequency", (40.0, 41.0))
    table = response.table()
    assert table.empty
    sizes = ["mass.x mean [m]", "mass.x half range [m]", "mass.x largest magnitude [m]"]
    assert list(table)[:5] == ["frequency", "period [s]", *sizes]
    assert list(table)[-3:] == ["stable", "largest multiplier", "fold"]


@SLOW
@pytest.mark.parametrize(
    ("model", "ends"),
    [
        (constant_travel, (38.0, 44.0)),
        (constant_acceleration, (44.0, 38.0)),
        (cosine_travel, (38.0, 44.0)),
        (constant_rotation, (38.0, 44.0)),
    ],
)
def test_regression_response_to_a_driver_is_that_of_the_linear_model(model, ends):
    response = bd.frequency_response(
        model, "frequency", ends, integrator=RUNS, settle=0, step=0.1, max_step=0.5
    )
    assert response.status.sentence == "reached the end of the range"
    assert response.folds == []
    frequencies, sizes = response.curve("tip.transverse")
    assert np.all(np.diff(frequencies) * (ends[1] - ends[0]) > 0.0)
    # Curves ended at the first point beyond the range.
    assert frequencies[-1] == ends[1]
    rotates = model is constant_rotation
    expected = linear_half_range(frequencies, rotates)
    grid = np.linspace(38.0, 44.0, 6001)
    on_grid = linear_half_range(grid, rotates)
    if model is constant_acceleration:
        expected, on_grid = expected * (40.0 / frequencies) ** 2, on_grid * (40.0 / grid) ** 2
    # Motions are periodic to 1e-3 of their amplitude.
    np.testing.assert_allclose(sizes, expected, rtol=2e-3)
    ((frequency, size),) = response.peaks("tip.transverse")
    # With these long steps, parabolas through three points are less accurate than the points; the
    # resonance is 2 Hz wide.
    assert frequency == pytest.approx(grid[np.argmax(on_grid)], abs=0.1)
    assert size == pytest.approx(np.max(on_grid), rel=1e-2)


@SLOW
def test_regression_short_steps_do_not_run_backward():
    # The second step ran backward, beyond the start of the range.
    response = bd.frequency_response(
        lightly_damped, "frequency", (37.0, 45.0), integrator=RUNS, max_step=0.5
    )
    assert response.status.sentence == "reached the end of the range"
    assert np.all(np.diff([point.parameter for point in response.points]) > 0.0)
    ((frequency, size),) = response.peaks("tip.transverse")
    assert frequency == pytest.approx(40.92, abs=0.1)
    assert size == pytest.approx(0.02299, rel=1e-2)


@SLOW
def test_regression_response_over_the_amplitude_of_a_driver_is_proportional():
    response = bd.frequency_response(
        amplified_travel,
        "amplitude",
        (AMPLITUDE, 3.0 * AMPLITUDE),
        lambda amplitude: 1.0 / 40.0,
        RUNS,
        max_step=0.5,
    )
    assert response.status.success
    assert response.peaks("tip.transverse") == response.folds == []
    amplitudes, sizes = response.curve("tip.transverse")
    assert np.all(np.diff(amplitudes) > 0.0)
    expected = amplitudes / AMPLITUDE * linear_half_range([40.0])
    np.testing.assert_allclose(sizes, expected, rtol=2e-3)


def test_regression_unsolvable_linearized_equations_are_no_first_motion(monkeypatch):
    """The error began with the name of another function."""

    def fail(*_, **__):
        raise LinearizationError("periodic: the equations linearized at t = 0 s cannot be solved.")

    monkeypatch.setattr(PeriodRun, "monodromy", fail)
    with pytest.warns(bd.BeamdaeWarning, match=r"^frequency_response: frequency = 40: the equ"):
        response = bd.frequency_response(pushed_mass, "frequency", (40.0, 41.0), settle=1)
    assert response.status.kind == "failed"
    assert not response.points


@pytest.mark.slow(reason="a second")
def test_response_with_other_parameters():
    @bd.model(t_end=1.0)
    def pushed(frequency=40.0, force=1.0):
        mech, mass = free_ball(name="mass")
        mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 1e3, 50.0))
        mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
        mech.add(bd.Force("push", mass.point, (bd.sine(force, frequency), 0.0)))
        return mech

    def follow(**parameters):
        return bd.frequency_response(
            pushed, "frequency", (40.0, 41.0), step=1.0, max_step=1.0, parameters=parameters
        )

    sizes = [follow(force=force).curve("mass.x")[1][0] for force in (1.0, 2.0)]
    assert sizes[1] == pytest.approx(2.0 * sizes[0], rel=1e-3)
    with pytest.raises(bd.BeamdaeError, match="contains 'frequency', the parameter to follow"):
        follow(frequency=40.0)


@pytest.mark.slow(reason="thirty motions")
def test_regression_a_curve_that_returns_to_the_start_has_failed():
    """Duffing's oscillator on the branch of large amplitudes, under a decreasing force."""

    @bd.model(t_end=1.0)
    def duffing(force=0.3):
        t, x, v = (ca.SX.sym(name) for name in "txv")
        push = force * ca.sin(1.45 * t) - 0.1 * v - x - 0.5 * x**3
        return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=push, q0=[-2.0], v0=[0.0])

    period = 2.0 * np.pi / 1.45
    with pytest.warns(bd.BeamdaeWarning, match="and returned to the start of the range; begin"):
        response = bd.frequency_response(duffing, "force", (0.3, 0.01), lambda force: period)
    assert response.status.kind == "failed"
    (fold,) = response.folds
    assert f"folds back at force = {fold:.6g} and" in response.status.sentence
    assert [x.stable for x in response.points].count(True) > 5
    assert not response.points[-1].stable


def boundaries_of_mathieu(sign, brackets):
    """Return a where multipliers of x'' + 0.1 x' + (a - 2 cos 2 t) x = 0 are 1 or -1."""

    def excess(a):
        ends = [
            solve_ivp(
                lambda t, y: [y[1], -(a - 2.0 * np.cos(2.0 * t)) * y[0] - 0.1 * y[1]],
                (0.0, np.pi),
                start,
                method="DOP853",
                rtol=1e-11,
                atol=1e-11,
            ).y[:, -1]
            for start in ([1.0, 0.0], [0.0, 1.0])
        ]
        return 1.0 - sign * (ends[0][0] + ends[1][1]) + np.linalg.det(ends)

    return [brentq(excess, *x, xtol=1e-9) for x in brackets]


@pytest.mark.slow(reason="curves of small systems")
@pytest.mark.parametrize(
    ("kind", "ends", "expected"),
    [
        ("torus point", (0.05, -0.05), lambda: [-np.log(1.001) / np.pi]),
        (
            "period doubling",
            (-0.3, 2.2),
            lambda: boundaries_of_mathieu(-1.0, [(-0.2, -0.1), (1.8, 1.9)]),
        ),
        (
            "branch point",
            (3.0, 4.6),
            lambda: boundaries_of_mathieu(1.0, [(4.0, 4.1), (4.2, 4.3)]),
        ),
    ],
)
def test_critical_points_of_motions_are_those_of_their_multipliers(kind, ends, expected):
    """A damper that becomes negative, up to the margin of stability; and Mathieu's equation."""
    is_forced = kind == "torus point"
    period = 2.0 * np.pi if is_forced else np.pi

    @bd.model(t_end=1.0)
    def excited(size=0.05):
        t, x, v = (ca.SX.sym(name) for name in "txv")
        force = ca.sin(t) - size * v - 0.3 * x
        if not is_forced:
            force = -(size - 2.0 * ca.cos(2.0 * t)) * x - 0.1 * v
        return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])

    response = bd.frequency_response(excited, "size", ends, lambda size: period, settle=1)
    assert response.status.success
    assert response.folds == []
    assert [name for name, _ in response.critical_points] == [kind] * len(expected())
    found = [value for _, value in response.critical_points]
    # Motions are periodic to 1e-6, and points are located to a thousandth of a step.
    assert found == pytest.approx(expected(), abs=1e-4)


def test_peaks_of_monotonic_curves_are_between_their_points():
    rows = [(0.0, 0.0), (9.9, 1.0), (10.0, 0.999), (10.1, 0.998)]
    runs = [run_with_columns({"x [m]": np.array([x, -x])}) for _, x in rows]
    points = tuple(
        ResponsePoint(p, 1.0, run, np.zeros(0)) for (p, _), run in zip(rows, runs, strict=True)
    )
    response = FrequencyResponse("speed", points, Status("ok", "done"))
    ((value, _),) = response.peaks("x")
    assert 0.0 <= value <= 10.0


def test_regression_warnings_of_motions_are_those_of_the_response():
    """Pages and commands dropped them; of those that differ only in numbers, one is kept."""
    texts = ("link: the error is 1.2 %.", "link: the error is 3 %.", "arm: the error is 2 %.")
    points = tuple(
        ResponsePoint(
            k,
            1.0,
            SimpleNamespace(model_warnings=(text,), row_warnings=()),
            np.ones(1),
        )
        for k, text in enumerate(texts)
    )
    response = FrequencyResponse("speed", points, Status("ok", "reached the end"))
    vars(response)["errors"] = Errors.unchecked((), np.zeros(0), "none of these is a motion")
    assert response.warnings == ("speed = 0: " + texts[0], "speed = 2: " + texts[2])


@SLOW
def test_regression_number_of_points_does_not_depend_on_the_mesh():
    """The length was a sum over coordinates: 176 points instead of 58 with two elements."""
    counts = []
    for elements in (1, 4):

        @bd.model(t_end=1.0)
        def shaken(frequency=40.0, elements=elements):
            return shaken_strip(bd.sine(AMPLITUDE, frequency), elements=elements)

        response = bd.frequency_response(
            shaken, "frequency", (38.0, 44.0), integrator=RUNS, settle=0
        )
        counts.append(len(response.points))
    # The steps are limited by amplitudes, and by the curvature in the space of all states.
    assert counts[1] == pytest.approx(counts[0], rel=0.25)
    assert max(counts) < 60


@SLOW
def test_regression_number_of_points_hardly_depends_on_the_amplitude():
    """By energy, tangents turned with the axial displacements of bending: 66 instead of 29."""

    def follow(amplitude):
        @bd.model(t_end=1.0)
        def shaken(frequency=40.0):
            # Green's strains stiffen the strip with the amplitude.
            law = bd.sine(amplitude, frequency)
            return shaken_strip(law, damping=5e-5, strain="green")

        return bd.frequency_response(shaken, "frequency", (40.5, 43.0), settle=3)

    small, large = (follow(amplitude) for amplitude in (1e-5, 2e-3))
    assert large.status.success
    assert large.folds
    assert len(large.points) < 1.6 * len(small.points)


def test_regression_columns_of_rounding_errors_do_not_shift_peaks():
    """A constant acceleration and rounding errors put a peak 3 % above the curve."""
    frequencies = np.array([44.317, 44.388, 44.45275, 44.48581, 44.53545, 44.60747])
    ratio = frequencies / 44.5
    sizes = 0.01 / np.sqrt((1.0 - ratio**2) ** 2 / 4e-6 + ratio**2)
    noise = np.random.default_rng(0).uniform(size=(2, len(sizes)))
    points = []
    for frequency, size, (one, other) in zip(frequencies, sizes, noise.T, strict=True):
        half_ranges = {
            "tip [m]": size,
            "base.ay [m/s^2]": 5.0 + 1e-6 * one,
            "base.angle_ddot [rad/s^2]": 1e-22 * other,
        }
        columns = {name: np.array([-x, x]) for name, x in half_ranges.items()}
        run = run_with_columns(columns)
        points.append(ResponsePoint(frequency, 1.0 / frequency, run, np.array([0.5])))
    response = FrequencyResponse("frequency", tuple(points), Status("ok", "complete"))
    assert response.varying_columns == ("tip [m]",)
    ((frequency, size),) = response.peaks("tip")
    assert frequency == pytest.approx(44.5, rel=1e-5)
    assert size == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("ratio", [1e-3, 1e-2, 5e-2])
def test_regression_peaks_of_few_points_are_not_extrapolated_far(ratio):
    """With points 4.6 half bandwidths apart, a peak was 29 times as large as the resonance."""
    for spacing, limit in ((1.0, 1.02), (4.6, 1.25), (7.3, 1.25)):
        for offset in np.linspace(-0.5, 0.5, 11):
            frequencies = 1.0 + ratio * spacing * (np.arange(-2, 3) + offset)
            sizes = 1.0 / np.hypot(1.0 - frequencies**2, 2.0 * ratio * frequencies)
            points = []
            for frequency, size in zip(frequencies, sizes, strict=True):
                columns = {"tip [m]": np.array([-size, size])}
                run = run_with_columns(columns)
                points.append(ResponsePoint(frequency, 1.0 / frequency, run, np.array([0.5])))
            response = FrequencyResponse("frequency", tuple(points), Status("ok", "complete"))
            for _, size in response.peaks("tip"):
                assert sizes.max() <= size <= limit * 0.5 / ratio


def test_regression_velocities_at_rest_have_no_peaks():
    """A point on a bearing had 22 peaks of 1e-35 m/s because no other column was in m/s."""
    noise = np.random.default_rng(0).uniform(size=9)
    points = []
    for speed, x in zip(np.linspace(176.0, 192.0, 9), noise, strict=True):
        size = 1.0 / np.hypot(1.0 - (speed / 184.0) ** 2, 0.02)
        sizes = {"tip [m]": 1e-4 * size, "hub.x_dot [m/s]": 1e-35 * x, "hub.ax [m/s^2]": 1e-10 * x}
        sizes["slow [rad/s]"] = 1e-9 * size
        columns = {name: np.array([-y, y]) for name, y in sizes.items()}
        run = run_with_columns(columns)
        points.append(ResponsePoint(speed, 2.0 * np.pi / speed, run, np.array([0.5])))
    response = FrequencyResponse("speed", tuple(points), Status("ok", "complete"))
    assert list(response.peak_table()["observed"]) == ["tip [m]", "slow [rad/s]"]
    figure = create_response_figure(response, "blade")
    labels = [axis.get_ylabel() for axis in figure.axes if axis.get_visible()]
    assert labels == ["tip, half range [m]", "slow, half range [rad/s]"]


def sine_response(mean, factor):
    """Return the response of a linear resonance and of the magnitude of its column."""
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, 201)
    points = []
    for speed in np.linspace(0.9, 1.1, 9):
        values = mean + factor / np.hypot(1.0 - speed**2, 0.04) * np.sin(phase)
        columns = {"stress [Pa]": values, "largest [Pa]": np.abs(values)}
        solution = run_with_columns(columns)
        points.append(ResponsePoint(speed, 1.0, solution, np.ones(1)))
    return FrequencyResponse("speed", tuple(points), Status("ok", "reached the end"))


@pytest.mark.parametrize("mean", [0.0, 30.0])
def test_regression_responses_state_the_largest_magnitude(mean):
    """The half range of a largest stress was half of the stress, without a remark."""
    response = sine_response(mean, 1.0)
    peaks = response.peak_table().set_index("observed")
    expected = mean + 1.0 / 0.04
    assert peaks["largest magnitude"].to_list() == pytest.approx([expected, expected], rel=2e-3)
    assert peaks["half range"]["stress [Pa]"] == pytest.approx(25.0, rel=2e-3)
    table = response.table()
    for name in ("stress", "largest"):
        largest = table[f"{name} largest magnitude [Pa]"].max()
        assert largest == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_fixed_steps_find_periodic_motions_of_driven_beams():
    """Velocities violate the constraints at the end of a run: the deviation stayed at 2e-5."""
    motion = bd.periodic(constant_travel(), 1.0 / 40.0, bd.GeneralizedAlpha(2e-4), settle=20)
    assert motion.status.sentence == "repeats after one period"
    # Fixed steps of 1/125 period shift the resonance.
    half_range = motion.amplitudes()["half range"]["tip.transverse [m]"]
    assert half_range == pytest.approx(linear_half_range([40.0])[0], rel=2e-2)
