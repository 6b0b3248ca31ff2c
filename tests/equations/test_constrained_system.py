"""Constrained systems stated in CasADi expressions."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import rope_swing, symbols
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import beamdae as bd


def system(**changes):
    """Return a particle on the unit circle under gravity; `changes` replace arguments."""
    t, q, v = symbols(2)
    statement = {
        "t": t,
        "q": q,
        "v": v,
        "mass": [2.0, 2.0],
        "force": ca.vertcat(0.0, -2.0 * 9.81),
        "constraints": ca.sumsqr(q) - 1.0,
        "q0": [1.0, 0.0],
        "v0": [0.0, 0.0],
    }
    for name, value in changes.items():
        statement[name] = value(t, q, v) if callable(value) else value
    return bd.ConstrainedSystem(**statement)


def run(model, t_end=0.5):
    solution = bd.simulate(model, bd.GeneralizedAlpha(step=1e-2, newton_tolerance=1e-9), t_end)
    assert solution.status.success, solution.status.sentence
    return solution


def test_it_moves_like_the_same_mechanism_of_parts():
    parts, stated_system = run(rope_swing(length=1.0, mass=2.0)), run(system())
    # Newton's tolerance of 1e-9 in 50 steps.
    assert_allclose(stated_system.q, parts.q, rtol=0.0, atol=1e-7)
    assert_allclose(stated_system.v, parts.v, rtol=0.0, atol=1e-6)


def test_the_mass_may_be_a_diagonal_a_list_or_a_matrix():
    expected = run(system()).q
    for mass in (ca.DM([2.0, 2.0]), 2.0 * ca.DM.eye(2), 2.0 * ca.SX.eye(2)):
        assert_allclose(run(system(mass=mass)).q, expected, rtol=0.0, atol=1e-14)


def test_mx_symbols_are_supported():
    t, q, v = ca.MX.sym("t"), ca.MX.sym("q", 2), ca.MX.sym("v", 2)
    model = system(t=t, q=q, v=v, constraints=ca.sumsqr(q) - 1.0)
    assert_allclose(run(model).q, run(system()).q, rtol=0.0, atol=1e-14)


def test_constraints_may_depend_on_time():
    # The radius grows as 1 + t; a bead that moves outward at this rate keeps its direction.
    growing = system(
        force=ca.vertcat(0.0, 0.0),
        constraints=lambda t, q, v: ca.norm_2(q) - (1.0 + t),
        v0=[1.0, 0.0],
    )
    solution = run(growing)
    assert_allclose(solution.q[:, 0], 1.0 + solution.t, rtol=0.0, atol=1e-12)
    assert_allclose(solution.q[:, 1], 0.0, rtol=0.0, atol=1e-12)


def test_sign_of_the_multiplier():
    # At rest, M q'' + G^T lam = f becomes G^T lam = f.
    hanging = run(system(q0=[0.0, -1.0]), t_end=0.1)
    gradient = 2.0 * hanging.q
    assert_allclose(hanging.lam * gradient, [[0.0, -2.0 * 9.81]] * len(hanging.t), atol=1e-9)


def test_the_start_is_made_consistent():
    solution = run(system(q0=[1.2, 0.0], v0=[0.3, 0.7]), t_end=0.01)
    assert_allclose(solution.q[0], [1.0, 0.0], rtol=0.0, atol=1e-12)
    assert_allclose(solution.v[0], [0.0, 0.7], rtol=0.0, atol=1e-12)


def test_coordinates_and_observed_expressions_are_columns():
    named = system(names=("x", "turn"), units=("m", "rad"), observe={"height": 1.0})
    solution = run(named, t_end=0.01)
    assert list(solution.observed.columns) == ["x [m]", "turn [rad]", "height [-]"]
    names = "t [s]", "x [m]", "turn [rad]", "x_dot [m/s]", "turn_dot [rad/s]"
    assert tuple(solution.coordinates())[:5] == names
    solution = run(system(observe=lambda t, q, v: {"speed": ca.norm_2(v), "late": 2.0 * t}))
    columns = solution.observed
    assert list(columns.columns) == ["q0 [-]", "q1 [-]", "speed [-]", "late [-]"]
    assert_allclose(columns["speed [-]"], np.linalg.norm(solution.v, axis=1), rtol=1e-12)
    assert_allclose(columns["late [-]"], 2.0 * solution.t, rtol=1e-12)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (lambda x: ca.vertcat(x, 2.0 * x), r"g0.*g1.*depend on each other.*remove 1"),
        (lambda x: x + 2.0, r"constraint\.g0.*t = 0"),
    ],
    ids=["dependent", "impossible"],
)
def test_constraints_that_determine_no_motion_are_named(row, words):
    stated = system(constraints=lambda t, q, v: row(ca.sumsqr(q) - 1.0))
    with pytest.raises(bd.BeamdaeError, match=words):
        bd.simulate(stated, bd.Ida(), 1.0)


def test_regression_scales_follow_from_units_and_not_from_names():
    """An angle in a coordinate named psi was scaled as a length."""
    scales = {
        units: system(names=("psi", "phi"), units=units, q0=[0.0, 5.0]).equations.position_scales
        for units in (("rad", "m"), ("m", "rad"), ("rad", "rad"), ())
    }
    assert_allclose(scales[("rad", "m")], [1.0, 5.0])
    # The length starts at zero: its scale is 1.
    assert_allclose(scales[("m", "rad")], [1.0, 1.0])
    assert_allclose(scales[("rad", "rad")], [1.0, 1.0])
    assert_allclose(scales[()], [5.0, 5.0])


def test_regression_energies_balance_if_the_mass_depends_on_position():
    """A free particle in polar coordinates has constant energy; the imbalance was 0.9."""
    t, q, v = symbols(2)
    r = q[0]
    free = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=ca.vertcat(2.0, 2.0 * r**2),
        force=ca.vertcat(2.0 * r * v[1] ** 2, -4.0 * r * v[0] * v[1]),
        q0=[1.0, 0.0],
        v0=[-0.5, 0.8],
        units=("m", "rad"),
    )
    solution = bd.simulate(free, bd.GeneralizedAlpha(step=1e-3, newton_tolerance=1e-9), 3.0)
    kinetic = solution.energies["energy.kinetic [J]"]
    # The steps lose energy of order h^2.
    assert_allclose(kinetic, kinetic[0], rtol=1e-5)
    assert_allclose(solution.energies["energy.work_of_loads [J]"], 0.0, atol=1e-5 * kinetic[0])
    assert solution.quality.energy_imbalance < 1e-5
    # A straight line at constant speed.
    x = solution.q[:, 0] * np.cos(solution.q[:, 1])
    assert_allclose(x, 1.0 - 0.5 * solution.t, atol=1e-5)


@pytest.mark.parametrize(
    "integrator", [bd.Ida(1e-5), bd.Radau(1e-5), bd.GeneralizedAlpha(rtol=1e-5)]
)
def test_rtol_is_relative_to_the_scales(integrator):
    """A coordinate with 1e-6 of the amplitude of the other has the same relative accuracy."""
    t, q, v = symbols(2)
    rates = np.array([3.0, 5.0])
    model = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=-ca.vertcat(*(rates**2)) * q,
        q0=[1.0, 1e-6],
        v0=[0.0, 0.0],
        scales=[1.0, 1e-6],
    )
    solution = bd.simulate(model, integrator, 2.0)
    assert "amplitudes" not in solution.integrator
    exact = np.array([1.0, 1e-6]) * np.cos(rates * solution.t[:, None])
    assert np.all(np.abs(solution.q - exact).max(axis=0) < 100e-5 * np.array([1.0, 1e-6]))


def test_constraints_may_be_named_and_their_reactions_observed():
    lam = ca.SX.sym("lam")

    hanging = system(
        q0=[0.0, -1.0],
        constraints=lambda t, q, v: {"rod [N]": ca.norm_2(q) - 1.0},
        lam=lam,
        observe=lambda t, q, v: {"pull.y [N]": -lam * q[1] / ca.norm_2(q)},
    )
    solution = run(hanging, t_end=0.1)
    assert solution.coordinates().columns[-1] == "lam.constraint.rod [N]"
    # The weight of 2 kg; Newton's method converges to 1e-9 of the motion.
    assert_allclose(solution.observed["pull.y [N]"], 2.0 * 9.81, rtol=1e-9)


def oscillator(m, c, k):
    """Return a mass on a spring and damper under gravity, with its numbers as parameters."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("v")
    mass, damper, spring = (ca.SX.sym(name) for name in ("m", "c", "k"))
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=mass,
        force=-spring * q - damper * v - 9.81 * mass,
        q0=[0.1],
        v0=[0.0],
        units=("m",),
        parameters={mass: m, damper: c, spring: k},
        strain_energy=0.5 * spring * q**2,
        gravity_energy=9.81 * mass * q,
        dissipated_power=damper * v**2,
    )


@pytest.mark.parametrize("integrator", [bd.Ida(1e-7), bd.Radau(1e-7), bd.GeneralizedAlpha(1e-3)])
def test_energies_equal_the_stated_potentials(integrator):
    m, c, k = 2.0, 3.0, 100.0
    solution = bd.simulate(oscillator(m, c, k), integrator, 2.0)
    ledger, x, v = solution.energies, solution.q[:, 0], solution.v[:, 0]
    # Energies are interpolated between steps, with errors of 1e-7 of 4 J.
    assert_allclose(ledger["energy.kinetic [J]"], 0.5 * m * v**2, rtol=0.0, atol=1e-6)
    assert_allclose(ledger["energy.strain [J]"], 0.5 * k * x**2, rtol=0.0, atol=1e-6)
    assert_allclose(ledger["energy.gravity [J]"], 9.81 * m * x, rtol=0.0, atol=1e-6)
    exchanged_energy = np.ptp(ledger["energy.gravity [J]"])
    # All forces have a potential or dissipate: loads do no work.
    assert_allclose(ledger["energy.work_of_loads [J]"], 0.0, atol=1e-12 * exchanged_energy)
    total = 0.5 * m * v**2 + 0.5 * k * x**2 + 9.81 * m * x
    dissipated = ledger["energy.dissipated [J]"]
    # Steps of generalized-alpha of 1 ms: (omega h)^2 / 12 = 4e-6.
    assert_allclose(total[0] - total, dissipated, rtol=0.0, atol=1e-5 * exchanged_energy)
    assert solution.quality.energy_imbalance < 1e-5


def test_the_power_of_a_time_dependent_potential_counts_as_work_of_loads():
    t, q, v = symbols()
    foot = ca.sin(3.0 * t)
    model = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0],
        force=-20.0 * (q - foot),
        q0=[0.0],
        v0=[0.0],
        strain_energy=10.0 * (q - foot) ** 2,
    )
    solution = bd.simulate(model, bd.Radau(1e-8), 3.0)
    times, x = solution.t, solution.q[:, 0]
    # Power of the spring force at the moving end.
    power = -20.0 * (x - np.sin(3.0 * times)) * 3.0 * np.cos(3.0 * times)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(times))])
    # Error of the trapezoidal rule with 1000 rows: (3 omega h)^2 / 12 of 40 J.
    assert_allclose(solution.energies["energy.work_of_loads [J]"], work, rtol=0.0, atol=1e-3)
    assert solution.quality.energy_imbalance < 1e-7


def free_mass(value, **settings):
    """Return a free mass under the force u(t)."""
    t, q, v, u = (ca.SX.sym(name) for name in ("t", "q", "v", "u"))
    start = {"q0": [0.0], "v0": [0.0], "parameters": {u: value}}
    return bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=u, **start, **settings)


@pytest.mark.parametrize("integrator", [bd.Ida(1e-6), bd.Radau(1e-6), bd.GeneralizedAlpha(1e-3)])
def test_a_parameter_may_be_a_law_with_breakpoints(integrator):
    pushed = free_mass(bd.piecewise((0.5, 1.0), 0.0))
    assert pushed.equations.breakpoints == (0.5,)
    solution = bd.simulate(pushed, integrator, 1.0)
    x = np.where(solution.t < 0.5, 0.5 * solution.t**2, 0.125 + 0.5 * (solution.t - 0.5))
    # Steps end at the jump and constant accelerations are exact: the error is the tolerance.
    assert_allclose(solution.q[:, 0], x, rtol=0.0, atol=1e-6)


def test_time_scale_and_breakpoints_of_laws_are_used():
    assert free_mass(bd.sine(1.0, 5.0)).equations.time_scale == 0.2
    assert free_mass(bd.sine(1.0, 5.0), time_scale=0.1).equations.time_scale == 0.1
    both = free_mass(bd.piecewise((0.5, 1.0), 0.0), breakpoints=(0.25, 0.5))
    assert both.equations.breakpoints == (0.25, 0.5)


@pytest.mark.parametrize("pole", [0.7, 0.7123])
def test_a_pole_of_a_law_is_detected_at_samples_and_between(pole):
    with pytest.raises(bd.BeamdaeError, match=f"^u: the law becomes infinite near t = {pole}"):
        bd.simulate(free_mass(lambda t: 1.0 / (t - pole)), bd.Ida(), 1.0)


def test_parameters_in_constraints_and_columns():
    t, q, v = ca.MX.sym("t"), ca.MX.sym("q", 2), ca.MX.sym("v", 2)
    length, turn = ca.MX.sym("length"), ca.MX.sym("turn")
    arm = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=[0.0, 0.0],
        constraints={"arm [N]": q - length * ca.vertcat(ca.cos(turn), ca.sin(turn))},
        q0=[2.0, 0.0],
        v0=[0.0, 0.0],
        parameters={length: 2.0, turn: bd.run_up(3.0, 0.5)},
        observe={"turn [rad]": turn, "far [-]": ca.norm_2(q) / length},
    )
    assert arm.equations.lam_names == ("constraint.arm0", "constraint.arm1")
    solution = bd.simulate(arm, bd.Radau(1e-6), 1.0)
    assert_allclose(solution.observed["turn [rad]"].iloc[-1], 3.0 * (1.0 - 0.25), rtol=1e-12)
    assert_allclose(solution.observed["far [-]"], 1.0, rtol=1e-6)
    # The work of the drive is m v^2 / 2 at 6 m/s.
    assert_allclose(solution.energies["energy.work_of_drivers [J]"].iloc[-1], 18.0, rtol=1e-5)


def test_velocity_constraints_follow_position_constraints():
    lam = ca.SX.sym("lam")
    wheel = system(
        mass=[2.0, 3.0],
        force=lambda t, q, v: ca.vertcat(10.0 + t, 0.0),
        # A wheel of 0.5 m with angle q1 rolls without slip on a moving belt.
        constraints=None,
        velocity_constraints=lambda t, q, v: {"grip [N]": v[0] - 0.5 * v[1] - t},
        lam=lam,
        observe={"grip [N]": lam},
        q0=[0.0, 0.0],
    )
    solution = run(wheel, t_end=1.0)
    t = solution.t
    # 2 x'' + lam = 10 + t, 3 a'' - lam / 2 = 0, x'' - a'' / 2 = 1.
    angular_acceleration = (10.0 + t - 2.0) / 7.0
    assert_allclose(solution.lam[:, 0], 6.0 * angular_acceleration, rtol=1e-6)
    assert_allclose(solution.observed["grip [N]"], 6.0 * angular_acceleration, rtol=1e-6)
    assert solution.equations.lam_names == ("constraint.grip",)
    both = system(velocity_constraints=lambda t, q, v: v[0] - t * v[1])
    assert both.equations.lam_names == ("constraint.g0", "constraint.h0")


@pytest.mark.parametrize("row", [lambda v, q: v[0] ** 2, lambda v, q: q[0]])
def test_velocity_constraints_must_be_linear_in_velocities(row):
    with pytest.raises(
        bd.BeamdaeError, match="velocity_constraints must depend on v linearly; use"
    ):
        _ = system(velocity_constraints=lambda t, q, v: row(v, q)).equations


@pytest.mark.parametrize("rtol", [1e-4, 1e-5])
def test_regression_bodies_of_a_system_pass_singular_positions(rtol):
    """Bars that hardly rotate had a tiny tolerance: at 1e-4, the run ended at the first position.

    Two parallelograms side by side pass their singular positions twice per revolution.
    """
    t, q, v = (ca.SX.sym(x, n) for x, n in (("t", 1), ("q", 15), ("v", 15)))
    bodies = "upright 0", "upright 1", "upright 2", "bar 0", "bar 1"

    def point(body, dx, dy):
        x, y, angle = (q[3 * body + k] for k in range(3))
        c, s = ca.cos(angle), ca.sin(angle)
        return ca.vertcat(x + c * dx - s * dy, y + s * dx + c * dy)

    feet = [point(k, 0.0, -0.5) - ca.vertcat(k, 0.0) for k in range(3)]
    pins = [
        end
        for k in range(2)
        for end in (
            point(k, 0.0, 0.5) - point(3 + k, -0.5, 0.0),
            point(3 + k, 0.5, 0.0) - point(k + 1, 0.0, 0.5),
        )
    ]
    starts = [(k, 0.5, 0.0, 1.5, 0.0, -3.0) for k in range(3)]
    starts += [(k + 0.5, 1.0, 0.0, 3.0, 0.0, 0.0) for k in range(2)]
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0, 1.0 / 12.0] * 5,
        force=ca.vertcat(*[ca.vertcat(0.0, -9.81, 0.0)] * 5),
        constraints=ca.vertcat(*feet, *pins),
        q0=[x for start in starts for x in start[:3]],
        v0=[x for start in starts for x in start[3:]],
        names=tuple(f"{body}.{x}" for body in bodies for x in ("x", "y", "angle")),
        units=("m", "m", "rad") * 5,
    )
    solution = bd.simulate(system, bd.Radau(rtol), 4.0, 0.04)
    assert solution.status.success, solution.status.sentence
    # All uprights have the same angle from the vertical: 3 theta'' = 3.5 g sin(theta).
    theta = solve_ivp(
        lambda _, y: [y[1], 3.5 / 3.0 * 9.81 * np.sin(y[0])],
        (0.0, 4.0),
        [0.0, 3.0],
        "DOP853",
        solution.t,
        rtol=1e-12,
        atol=1e-12,
    ).y[0]
    assert_allclose(solution.q[:, 0], 0.5 * np.sin(theta), rtol=0.0, atol=100.0 * rtol * 0.5)
