"""Natural modes against closed forms, published values and Rayleigh-Ritz solutions."""

import warnings

import casadi as ca
import numpy as np
import pytest
from benchmarks import mode_closed_forms as closed_forms
from benchmarks.modes import (
    EISENBERGER,
    FORMULATIONS,
    WRIGHT,
    arch_section,
    ring,
    square_rubber,
    supported_beam,
)
from mechanisms import (
    EARTH,
    free_ball,
    hinged_beam,
    hinged_body,
    mass_on_rail,
    rectangle,
    rotor_on_a_bearing,
    symbols,
)
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import beamdae as bd
from beamdae.analysis.continuation import spectrum
from beamdae.analysis.eigenproblems import slow_motions
from beamdae.analysis.eigenproblems.eigensolution import _normalize
from beamdae.analysis.linear_dynamics.linearization import linearize_about

STEEL = bd.Material(E=2.0e11, nu=0.3, rho=7800.0)
STRIP = rectangle(0.002, 0.03, material=STEEL)


def oscillator(mass=2.0, stiffness=8.0, damping=0.0):
    mech, bob = mass_on_rail(mass, 1.0, name="bob")
    ends = (mech.ground.at(0.0, 0.0), bob.point)
    mech.add(bd.Spring("spring", *ends, stiffness, damping))
    return mech


def double_pendulum(up=False):
    """Return two bobs on massless rods in a straight line, hanging or upright."""
    sign = 1.0 if up else -1.0
    mech = bd.Mechanism(gravity=EARTH)
    last = mech.ground.at(0.0, 0.0)
    for k, (name, mass, y) in enumerate((("upper", 2.0, 1.0), ("lower", 0.5, 1.7))):
        bob = mech.add(bd.PointMass(f"bob {k}", mass, at=(0.0, sign * y)))
        mech.add(bd.Distance(name, last, bob.point))
        last = bob.point
    return mech


def cantilever(elements=8, gravity=(0.0, 0.0), damping=0.0, **settings):
    mech = bd.Mechanism(gravity=gravity)
    strip = rectangle(0.002, 0.03, damping=damping, material=STEEL)
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=elements, **settings))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


def timoshenko_cantilever(section, length, count):
    """Return angular frequencies [rad/s] of a Timoshenko cantilever.

    The deflection is sum a_k exp(r_k s), where r_k are the roots of r^4 + (a + b) r^2 + a b - c = 0
    (Han, Benaroya & Wei, JSV 225 (1999) 935); the determinant is that of the four end conditions.
    """
    ei, ga, m, j = section.EI, section.GA, section.rhoA, section.rhoI

    def determinant(w):
        a, b, c = m * w**2 / ga, j * w**2 / ei, m * w**2 / ei
        r = np.sqrt(np.roots([1.0, a + b, a * b - c]).astype(complex))
        r = np.array([r[0], -r[0], r[1], -r[1]])
        turn = r + a / r
        rows = np.array(
            [0 * r + 1, turn, turn * r * np.exp(r * length), (r - turn) * np.exp(r * length)]
        )
        rows /= np.max(np.abs(rows), axis=1)[:, None]
        # The determinant is real for real roots, imaginary for an imaginary pair.
        value = np.linalg.det(rows)
        return value.real if abs(value.real) > abs(value.imag) else value.imag

    thin = np.sqrt(ei / m) / length**2
    grid = thin * np.linspace(0.5, 1.3 * (np.pi * (count + 0.5)) ** 2, 4000)
    values = [determinant(w) for w in grid]
    roots = [
        brentq(determinant, *ends, xtol=1e-12 * ends[1])
        for *ends, f, g in zip(grid, grid[1:], values, values[1:], strict=False)
        if f * g < 0
    ]
    return np.array(roots[:count])


# Closed forms ------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.4, 7.9, 10.0])
def test_damped_oscillator_has_the_roots_of_its_equation(damping):
    modes = bd.modes(oscillator(damping=damping))
    roots = np.roots([2.0, damping, 8.0])
    expected = sorted(roots[roots.imag >= 0.0], key=abs)
    assert_allclose(modes.eigenvalues, expected, rtol=1e-12)
    kind = "vibration" if damping < 8.0 else "decay"
    assert modes.kinds == (kind,) * len(expected)
    if damping < 8.0:
        assert_allclose(modes.damping_ratios, damping / (2.0 * np.sqrt(16.0)), atol=1e-13)
        assert_allclose(modes.frequencies, expected[0].imag / (2.0 * np.pi))
    undamped = bd.modes(oscillator(damping=damping), damping=False)
    assert_allclose(undamped.eigenvalues, [2.0j], rtol=1e-13)


@pytest.mark.parametrize("about", ["reference", "equilibrium"])
def test_double_pendulum_has_the_roots_of_its_equation(about):
    """The equation is w^4 m1 l1 l2 - w^2 m (l1 + l2) g + m g^2 = 0 with m = m1 + m2."""
    modes = bd.modes(double_pendulum(), about=about)
    m1, m2, l1, l2, g = 2.0, 0.5, 1.0, 0.7, 9.81
    squares = np.roots([m1 * l1 * l2, -(m1 + m2) * (l1 + l2) * g, (m1 + m2) * g**2])
    assert_allclose(modes.eigenvalues, 1j * np.sqrt(np.sort(squares)), rtol=1e-10)
    assert not modes.warnings


def test_inverted_double_pendulum_grows_at_the_rates_of_the_same_roots():
    hanging, standing = bd.modes(double_pendulum()), bd.modes(double_pendulum(up=True))
    assert_allclose(standing.eigenvalues, np.abs(hanging.eigenvalues), rtol=1e-10)
    assert standing.kinds == ("unstable", "unstable")
    assert_allclose(standing.growth_rates, standing.eigenvalues.real)
    (warning,) = standing.warnings
    assert "unstable: 2 modes grow" in warning


@pytest.mark.slow(reason="16 elements, and the roots of a determinant")
@pytest.mark.parametrize("height", [0.002, 0.05])
def test_cantilever_matches_timoshenko_theory(height):
    section = rectangle(height, 0.03, material=STEEL)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=16))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    expected = timoshenko_cantilever(section, 0.5, 4)
    modes = bd.modes(mech, n=6).eigenvalues.imag
    nearest = modes[np.argmin(np.abs(modes[:, None] - expected), axis=0)]
    # The elements have order 6; the fourth mode has five of them per wave.
    assert_allclose(nearest, expected, rtol=2e-6)
    assert_allclose(nearest[:2], expected[:2], rtol=2e-8)
    if height < 0.01:
        # Euler-Bernoulli, cosh(x) cos(x) = -1; the height lowers w by 4 (h / L)^2 x^2 / 12.
        thin = np.array([1.875104068711961, 4.694091132974175]) ** 2
        thin *= np.sqrt(section.EI / section.rhoA) / 0.25
        assert_allclose(modes[:2], thin, rtol=2e-4)
        # Share of the mass in the first bending modes, from the table of Blevins: 0.6131.
        share = bd.modes(mech, n=2).effective_masses[:, 1] / (section.rhoA * 0.5)
        assert_allclose(share, [0.61308, 0.18830], rtol=1e-3)


@pytest.mark.slow(reason="all modes")
def test_effective_masses_add_up_to_the_moving_mass():
    modes = bd.modes(cantilever(2), n=None)
    total = STRIP.rhoA * 0.5
    # The mass fixed at the root, a fraction of the first element, does not contribute.
    assert_allclose(modes.effective_masses.sum(axis=0), total, rtol=0.07)
    assert_allclose(sum(modes.shares.values()), 1.0, rtol=1e-12)
    mass = modes._linearization.tangent.mass
    assert_allclose(modes.shapes.conj() @ (mass @ modes.shapes.T), np.eye(len(modes)), atol=1e-7)
    assert_allclose(modes.mac(modes), np.eye(len(modes)), atol=1e-7)


def test_errors_of_modes_with_states_that_move_no_mass_are_measured():
    """The integral of a saturated controller: `errors` ended with a ValueError of SciPy."""
    mech, beam = hinged_beam(STRIP, 2, 0.5)
    angle = mech.sensor("angle", beam.start, "angle")
    torque = bd.pid(mech, "servo", 1.0 - angle, kp=50.0, ki=10.0, kd=0.0, rate=0.0, limits=(-1, 1))
    mech.add(bd.Moment("motor", beam.start, torque))
    modes = bd.modes(mech, n=4)
    assert np.isfinite(modes.errors.total).all()


@pytest.mark.parametrize("damping", [3.0, 300.0])
def test_effective_masses_of_complex_modes_are_those_of_state_space_residues(damping):
    """A damper on one mass of two: magnitudes of complex shapes added up to a wrong mass."""
    mech, wall = bd.Mechanism(), (0.0, 0.0)
    masses = [mech.add(bd.PointMass(f"mass {k}", 3.0 - k, at=(k, 0.0))) for k in (1, 2)]
    for mass in masses:
        mech.add(
            bd.PointOnLine(f"rail of {mass.name}", mech.ground.at(*wall), mass.point, (1.0, 0.0))
        )
    mech.add(bd.Spring("left", mech.ground.at(*wall), masses[0].point, 30.0, damping))
    mech.add(bd.Spring("right", masses[0].point, masses[1].point, 40.0))
    modes = bd.modes(mech, n=None)
    mass, stiffness = np.diag([2.0, 1.0]), np.array([[70.0, -40.0], [-40.0, 40.0]])
    matrix = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-stiffness / [[2.0], [1.0]], np.zeros((2, 2))]]
    )
    matrix[2, 2] = -0.5 * damping
    values, right = np.linalg.eig(matrix)
    left, unit = np.linalg.inv(right), np.ones(2)
    parts = np.real(values * (unit @ mass @ right[:2]) * (left[:, 2:] @ unit))
    for value, found in zip(modes.eigenvalues, modes.effective_masses[:, 0], strict=True):
        expected = parts[int(np.argmin(np.abs(values - value)))] * (2.0 if value.imag else 1.0)
        assert_allclose(found, expected, rtol=1e-9)
    assert_allclose(modes.effective_masses.sum(axis=0), [3.0, 0.0], rtol=1e-9)


def test_effective_masses_in_rotations_are_not_stated():
    mech = rotor_on_a_bearing()
    assert np.isnan(bd.modes(mech, bd.rotation(0.0)).effective_masses).sum() == 0
    assert np.isnan(bd.modes(mech, bd.rotation(3.0)).effective_masses).all()


@pytest.mark.slow(reason="256 elements")
def test_light_damping_of_a_fine_mesh_is_resolved():
    """Rounding of the stiffness exceeds this damping of the lowest mode."""
    modes = bd.modes(cantilever(256, damping=1e-5, formulation="exact"), n=2)
    w = bd.modes(cantilever(16), n=2).eigenvalues.imag
    assert_allclose(modes.damping_ratios, 0.5 * 1e-5 * w, rtol=1e-4)


def test_material_damping_of_a_mode_grows_with_its_frequency():
    damped, free = bd.modes(cantilever(damping=1e-5), n=4), bd.modes(cantilever(), n=4)
    w = free.eigenvalues.imag
    assert_allclose(damped.damping_ratios, 0.5 * 1e-5 * w, rtol=1e-6)
    assert_allclose(np.abs(damped.eigenvalues), w, rtol=1e-7)


# Free motions -------------------------------------------------------------------------------


@pytest.mark.parametrize("excess", [-1e-12, 0.0, 1e-12])
def test_regression_signs_of_shapes_do_not_depend_on_rounding_errors(excess):
    """Of two coordinates of equal size and opposite sign, rounding made either one positive."""
    mech = bd.Mechanism()
    for name, x in (("left", 0.0), ("right", 1.0)):
        bob = mech.add(bd.PointMass(name, 2.0, at=(x, 0.0)))
        mech.add(bd.Spring(f"{name} spring", mech.ground.at(x - 1.0, 0.0), bob.point, 8.0))
    lin = linearize_about("modes", mech).linearized_equations
    shape = np.zeros((lin.equations.n, 1))
    shape[[0, 2], 0] = 1.0, -1.0 - excess
    for sign in (1.0, -1.0):
        shapes = _normalize(lin, np.array([2.0j]), sign * shape, 1).shapes
        assert_allclose(shapes[[0, 2], 0], [0.5, -0.5], rtol=1e-9)


def test_mass_on_a_damper_decays_without_oscillation():
    modes = bd.modes(oscillator(stiffness=0.0, damping=3.0))
    assert modes.kinds == ("free motion", "decay")
    assert_allclose(modes.eigenvalues, [0.0, -1.5], rtol=1e-12)
    assert_allclose(modes.damping_ratios, [0.0, 1.0])


def test_skate_constrains_the_lateral_velocity_only():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, center=(0.0, 0.0)))
    for name, x in (("front", 0.3), ("rear", -0.3)):
        mech.add(bd.Bushing(name, mech.ground.at(x, 0.0), body.at(x, 0.0), kx=50.0, ky=80.0))
    free = bd.modes(mech)
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    on_skate = bd.modes(mech)
    turn = np.sqrt(2.0 * 80.0 * 0.3**2 / 0.1)
    assert_allclose(free.eigenvalues.imag, np.sort([np.sqrt(50.0), np.sqrt(80.0), turn]), rtol=1e-9)
    assert_allclose(on_skate.eigenvalues.imag, np.sort([np.sqrt(50.0), turn]), rtol=1e-9)


def test_redundant_constraints_are_removed_or_rejected():
    def doubly_pinned(**settings):
        mech = cantilever(2)
        mech.redundant = settings.get("redundant", "refuse")
        mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), mech.part("beam").start))
        return mech

    with pytest.raises(bd.BeamdaeError, match="depend on each other"):
        bd.modes(doubly_pinned())
    reduced = bd.modes(doubly_pinned(redundant="minimum norm"), n=3)
    assert_allclose(reduced.eigenvalues, bd.modes(cantilever(2), n=3).eigenvalues, rtol=1e-9)


# The state ---------------------------------------------------------------------------------------


@pytest.mark.slow(reason="five equilibria")
def test_tip_load_changes_the_bending_frequency():
    """Tip load P on a strip: w^2 ~ 1 - P / Pcr (Blevins), Pcr = (pi / 2L)^2 EI."""
    critical = (0.5 * np.pi / 0.5) ** 2 * STRIP.EI
    squares = []
    for load in (-0.2, 0.0, 0.2, 0.999, 1.001):
        mech = cantilever(4)
        mech.add(bd.Force("load", mech.part("beam").end, (-load * critical, 0.0)))
        first = bd.modes(mech, about="equilibrium", n=1).eigenvalues[0]
        squares.append(-((first**2).real))
    tensile, unloaded, compressive, below, above = squares
    assert_allclose([tensile / unloaded, compressive / unloaded], [1.2, 0.8], rtol=0.02)
    # Shear and compression of the strip change the critical load by a fraction of 1e-5.
    assert below > 0.0 > above
    assert abs(below) < 2e-3 * unloaded


@pytest.mark.slow(reason="an equilibrium")
def test_reference_state_need_not_be_an_equilibrium():
    """A strip released from rest carries no weight yet: its modes are those without weight."""
    falling = bd.modes(cantilever(gravity=(0.0, -9.81)), n=3)
    free = bd.modes(cantilever(), n=3)
    assert "not an equilibrium" in falling.warnings[0]
    assert_allclose(falling.eigenvalues, free.eigenvalues, rtol=1e-3)
    at_rest = bd.modes(cantilever(gravity=(0.0, -9.81)), about="equilibrium", n=3)
    assert not at_rest.warnings


@pytest.mark.parametrize("angle", [0.4, 2.0])
def test_frequencies_off_an_equilibrium_do_not_depend_on_coordinates(angle):
    """A bob on a circle, in x and y and in another coordinate: w^2 = g / l cos(angle)."""
    t, q, v = symbols(2)
    bob = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(0.0, -9.81),
        names=("x", "y"),
        units=("m", "m"),
        constraints={"rod [N]": ca.sumsqr(q) - 1.0},
        q0=[np.sin(angle), -np.cos(angle)],
        v0=[0.0, 0.0],
    )
    # The coordinate is the square root of the angle.
    s = ca.SX.sym("s", 1)
    w = ca.SX.sym("w", 1)
    root_coordinate = bd.ConstrainedSystem(
        t=t,
        q=s,
        v=w,
        mass=[4.0 * s[0] ** 2],
        names=("s",),
        units=("-",),
        force=ca.vertcat(-9.81 * ca.sin(s[0] ** 2) * 2.0 * s[0] - 4.0 * s[0] * w[0] ** 2),
        q0=[np.sqrt(angle)],
        v0=[0.0],
    )
    for system in (bob, root_coordinate):
        modes = bd.modes(system)
        assert_allclose((modes.eigenvalues**2).real, [-9.81 * np.cos(angle)], rtol=1e-7)


@bd.model(t_end=1.0)
def hanging_load(mass=1.0, weight=9.81):
    """Mass on a spring that is drawn without the deflection by its weight."""
    return free_ball((0.0, 1.0), mass, "load", weight, spring=(100.0,))[0]


def test_regression_states_that_are_no_equilibria_issue_a_warning():
    """Only the result contained it, so that scripts used wrong poles without any message."""
    for analysis in (bd.modes, bd.linearize):
        with warnings.catch_warnings(record=True) as issued:
            warnings.simplefilter("default")
            for mass in (1.0, 2.0):
                result = analysis(hanging_load(mass=mass, weight=9.81 * mass))
            analysis(hanging_load(), about="equilibrium")
            analysis(hanging_load(weight=0.0))
        # The loop differs only in numbers.
        (warning,) = (x for x in issued if "accelerates" in str(x.message))
        assert warning.category is bd.BeamdaeWarning
        assert str(warning.message).startswith("load.y: ")
        assert result.warnings[0].startswith("load.y: ")
        assert repr(result).endswith("; 1 warning, see .warnings>")


def test_rejected_states_have_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(bd.BeamdaeError, match="not an equilibrium"):
            bd.mode_sensitivities(hanging_load, "mass")


def test_modes_about_positions_by_name():
    mech, bar = hinged_body(1.0, 0.25, (1.0, 0.0), name="bar")
    mech.add(bd.TorsionSpring("spring", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), stiffness=5.0))
    modes = bd.modes(mech, about={"bar.angle": 0.3})
    assert_allclose(modes.q[2], 0.3)
    assert_allclose(modes.eigenvalues, [2.0j], rtol=1e-8)
    assert "bar.angle" in modes.about


def test_modes_about_an_instant_of_a_run():
    mech = double_pendulum()
    solution = bd.simulate(mech, bd.Radau(1e-8), 0.2)
    modes = bd.modes(mech, about=solution.at(0.1))
    assert_allclose(modes.eigenvalues, bd.modes(mech).eigenvalues, rtol=1e-6)
    with pytest.raises(bd.BeamdaeError, match="within the run"):
        solution.at(0.3)
    with pytest.raises(bd.BeamdaeError, match="pass a solution of this model"):
        bd.modes(cantilever(), about=solution.at(0.1))


# Invariances ----------------------------------------------------------------------------


# With 3.4e-4 s, the fifth mode has 0.4 and the sixth mode 0.6 of the critical damping.
@pytest.mark.parametrize(
    ("damping", "counts", "rtol"),
    [(1e-5, [8], 1e-8), (0.0, [8], 1e-8), (3.4e-4, [5, 6], 1e-7)],
)
def test_dense_and_sparse_solvers_agree(damping, counts, rtol, monkeypatch):
    mech = cantilever(12, damping=damping)
    dense = [bd.modes(mech, n=n) for n in counts]
    for module in (slow_motions, spectrum):
        monkeypatch.setattr(module, "MAX_DENSE", 10)
    for n, expected in zip(counts, dense, strict=True):
        sparse = bd.modes(mech, n=n)
        # Rounding of the axial stiffness, 1e9 times that of the lowest mode, limits the agreement.
        assert_allclose(sparse.eigenvalues, expected.eigenvalues, rtol=rtol)
        is_vibration = expected.eigenvalues.imag > 0.0
        assert_allclose(np.diag(sparse.mac(expected))[is_vibration], 1.0, rtol=1e-9)


@pytest.mark.slow(reason="kernels of three formulations")
def test_formulations_of_a_beam_have_the_same_modes():
    expected = bd.modes(cantilever(12), n=4).eigenvalues
    for settings in ({"strain": "linear"}, {"strain": "nonlinear", "frame": "tangent"}):
        assert_allclose(bd.modes(cantilever(12, **settings), n=4).eigenvalues, expected, rtol=1e-7)


def test_invalid_arguments_are_rejected():
    for about in ("drawn", 3, None, ("reference",)):
        with pytest.raises(bd.BeamdaeError, match="about"):
            bd.modes(oscillator(), about=about)
    t, q, v = symbols(2)
    force, zero = ca.vertcat(-q[0], -q[1]), [0.0, 0.0]
    massless = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0, 0.0], force=force, q0=zero, v0=zero)
    with pytest.raises(bd.BeamdaeError, match="has no inertia"):
        bd.modes(massless)


def test_table_names_the_moving_parts():
    table = bd.modes(double_pendulum()).table()
    assert list(table["mode"]) == [1, 2]
    assert table["moves"][0] == "bob 1 56 %, bob 0 44 %"
    assert set(table["kind"]) == {"vibration"}


def two_beams(stiffness_ratios, formulation, damping=0.0):
    """Return a clamped beam with L/h = 100 that carries another one, of these relative moduli."""
    mech = bd.Mechanism()
    end = mech.ground.at(0.0, 0.0)
    for k, ratio in enumerate(stiffness_ratios):
        steel = bd.Material(210e9 * ratio, 0.3, 7800.0)
        section = rectangle(0.01, damping=damping, material=steel)
        line = bd.Line((float(k), 0.0), (k + 1.0, 0.0))
        beam = mech.add(bd.Beam(f"beam {k}", line, section, 4, formulation=formulation))
        mech.add(bd.Weld(f"joint {k}", end, beam.start))
        end = beam.end
    return mech


@pytest.mark.parametrize(
    ("stiffness_ratio", "hides"), [(1.0, False), (1e5, False), (1e8, True), (1e12, True)]
)
def test_frequencies_hidden_by_rounding_errors_of_stiff_beams_are_announced(stiffness_ratio, hides):
    """A strip carries an almost rigid link; its lowest mode is at 2.15 Hz."""
    mech = two_beams((1.0, stiffness_ratio), "exact")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        modes = bd.modes(mech, n=3)
    assert any("rounding errors of the stiffest parts" in str(w.message) for w in caught) == hides
    if not hides:
        assert np.all(modes.frequencies > 2.0)


@pytest.mark.parametrize("damping", [0.0, 1e-6])
@pytest.mark.parametrize("is_stiff_first", [False, True])
def test_regression_modes_of_floating_frames_do_not_depend_on_the_stiffness_contrast(
    damping, is_stiff_first
):
    """The null space of the joints mixed stiff and soft motions: 0 and 5 times the frequency."""
    order = -1 if is_stiff_first else 1
    moderate, extreme = (
        bd.modes(two_beams((1.0, ratio)[::order], "floating frame", damping), n=3).eigenvalues
        for ratio in (1e7, 1e12)
    )
    assert_allclose(extreme.imag, moderate.imag, rtol=1e-5)
    assert_allclose(extreme.real, moderate.real, rtol=1e-4)


def test_regression_free_motions_that_deform_a_beam_are_announced():
    """At a stiffness contrast of 1e10, the bound is below 5 % of the square of the second mode."""
    modes = bd.modes(two_beams((1.0, 1e10), "exact"), n=4)
    assert modes.kinds[0] == "free motion"
    assert any("rounding errors of the stiffest parts" in warning for warning in modes.warnings)
    free = bd.modes(free_strip(), n=4)
    assert free.kinds[0] == "free motion"
    assert not free.warnings


def free_strip():
    mech = bd.Mechanism()
    section = rectangle(1e-4)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    mech.add(bd.Beam("strip", line, section, 8, formulation="exact"))
    return mech


@pytest.mark.parametrize("damping", [0.0, 1e-5])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("ratio", [1e-5, 1e-4, 1e-3, 1e4])
def test_regression_modes_about_equilibria_do_not_depend_on_the_size_of_other_parts(
    ratio, formulation, damping
):
    """From 1:1e4 on, small beams had "no inertia", and loads of large ones were not balanced."""
    mech, steel = bd.Mechanism(), bd.Material.of("steel")
    for k, length in enumerate((1.0, ratio)):
        section = rectangle(0.01 * length, 0.02 * length, damping=damping, material=steel)
        line = bd.Line((2.0 * k, 0.0), (2.0 * k + length, 0.0))
        beam = mech.add(bd.Beam(f"beam {k}", line, section, 4, formulation=formulation))
        mech.add(bd.Weld(f"clamp {k}", mech.ground.at(2.0 * k, 0.0), beam.start))
        mech.add(bd.Force(f"load {k}", beam.end, (0.0, -0.1 * section.EI / length**2)))
    modes = bd.modes(mech, about="equilibrium", n=2)
    assert modes.warnings == ()
    # Of one beam of 1 m; the frequencies of similar beams are inverse to their lengths.
    assert_allclose(modes.frequencies * max(1.0, ratio), [8.361524, 52.324725], rtol=2e-6)


# Natural frequencies against published values and Rayleigh-Ritz solutions.


def ritz(speed):
    """Return flapping frequencies of a thin rotating cantilever, by the Rayleigh-Ritz method.

    Spin softening lowers w^2 in the plane of rotation only, by the square of the speed.
    """
    return np.hypot(closed_forms.rotating_cantilever(speed, 0.0, 3), speed)


@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0])
def test_waves_of_one_period_are_translations_of_a_spinning_ring(speed):
    """Bryan's formula for n = 1: seen from the ring, a resting ring circles at its speed."""
    waves = closed_forms.spinning_thin_ring(arch_section(), 1.0, 1, speed)
    assert_allclose(waves, speed)


def test_published_arch_frequencies_solve_its_equations():
    section, length = arch_section(), 0.5 * np.pi
    unit = length**2 * np.sqrt(section.rhoA / section.EI)
    exact = unit * closed_forms.hinged_arch(section, 1.0, length, np.array(EISENBERGER) / unit)
    assert_allclose(exact, EISENBERGER, rtol=0.0, atol=5.1e-4)


@pytest.mark.parametrize("speed", WRIGHT)
def test_published_frequencies_of_rotating_arms_match_ritz(speed):
    assert_allclose(ritz(speed), WRIGHT[speed], rtol=2e-5)


@pytest.mark.slow(reason="rings of two heights")
def test_ring_converges_to_the_thin_ring():
    """The effects of shear, rotary inertia and axial strain grow with the height squared."""
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    deviations = []
    for height in (0.02, 0.01):
        section = rectangle(height, material=steel)
        frequency = bd.modes(ring(section, 1.0, 16), n=5).eigenvalues[3].imag
        deviations.append(1.0 - frequency / closed_forms.thin_ring(section, 1.0, 2))
    # The mesh error is 4e-6 of the frequency.
    assert_allclose(deviations[0] / deviations[1], 4.0, rtol=0.2)


@pytest.mark.slow(reason="512 elements")
@pytest.mark.parametrize("formulation", FORMULATIONS.values())
def test_twenty_modes_of_a_fine_mesh_match_the_closed_form(formulation):
    """512 elements with the sparse solver; rounding of their stiffness leaves ten digits."""
    many = bd.modes(supported_beam(512, formulation), n=20).eigenvalues.imag
    expected = closed_forms.supported_beam(square_rubber(), 2.0, 20)
    assert_allclose(many, expected, rtol=1e-8)
