"""Natural modes against closed forms, and what must not matter to them."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import beamdae as bd

STEEL = bd.Material(E=2.0e11, nu=0.3, rho=7800.0)
STRIP = bd.Section.rectangle(STEEL, width=0.03, height=0.002)


def oscillator(mass=2.0, stiffness=8.0, damping=0.0):
    mech = bd.Mechanism()
    bob = mech.add(bd.PointMass("bob", mass, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    ends = (mech.ground.at(0.0, 0.0), bob.point)
    mech.add(bd.SpringDamper("spring", *ends, stiffness, damping))
    return mech


def double_pendulum(turn=0.0, shift=(0.0, 0.0), backwards=False, lengths=(1.0, 0.7), up=False):
    """Two bobs on massless rods: of rigid bodies of no size, one below the other."""
    c, s = np.cos(turn), np.sin(turn)
    down = np.array([s, -c]) * (-1.0 if up else 1.0)
    mech = bd.Mechanism(gravity=(9.81 * s, -9.81 * c))
    at = [np.array(shift) + x * down for x in (0.0, lengths[0], sum(lengths))]
    order = (1, 0) if backwards else (0, 1)
    masses = (2.0, 0.5)
    bobs = {k: mech.add(bd.PointMass(f"bob {k}", masses[k], at=tuple(at[k + 1]))) for k in order}
    mech.add(bd.Distance("upper", mech.ground.at(*at[0]), bobs[0].point))
    mech.add(bd.Distance("lower", bobs[0].point, bobs[1].point))
    return mech


def cantilever(elements=8, gravity=(0.0, 0.0), damping=0.0, **settings):
    mech = bd.Mechanism(gravity=gravity)
    strip = bd.Section.rectangle(STEEL, width=0.03, height=0.002, damping=damping)
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=elements, **settings))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


def timoshenko_cantilever(section, length, count):
    """Angular frequencies of a clamped-free Timoshenko beam, by its characteristic equation.

    Of y = sum a_k exp(r_k s) with r^2 the roots of r^4 + (a + b) r^2 + a b - c = 0 (Han, Benaroya
    & Wei, JSV 225 (1999) 935); the determinant is that of the four end conditions.
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
        # Real roots make a real determinant, with an imaginary pair an imaginary one.
        found = np.linalg.det(rows)
        return found.real if abs(found.real) > abs(found.imag) else found.imag

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
def test_a_damped_oscillator_has_the_roots_of_its_equation(damping):
    found = bd.modes(oscillator(damping=damping))
    roots = np.roots([2.0, damping, 8.0])
    known = sorted(roots[roots.imag >= 0.0], key=abs)
    assert_allclose(found.eigenvalues, known, rtol=1e-12)
    kind = "vibration" if damping < 8.0 else "decay"
    assert found.kinds == (kind,) * len(known)
    if damping < 8.0:
        assert_allclose(found.damping_ratios, damping / (2.0 * np.sqrt(16.0)), atol=1e-13)
        assert_allclose(found.frequencies, known[0].imag / (2.0 * np.pi))
    undamped = bd.modes(oscillator(damping=damping), damping=False)
    assert_allclose(undamped.eigenvalues, [2.0j], rtol=1e-13)


@pytest.mark.parametrize("about", ["reference", "equilibrium"])
def test_a_double_pendulum_has_the_roots_of_its_equation(about):
    """w^4 m1 l1 l2 - w^2 m (l1 + l2) g + m g^2 = 0, m = m1 + m2."""
    found = bd.modes(double_pendulum(), about=about)
    m1, m2, l1, l2, g = 2.0, 0.5, 1.0, 0.7, 9.81
    squares = np.roots([m1 * l1 * l2, -(m1 + m2) * (l1 + l2) * g, (m1 + m2) * g**2])
    assert_allclose(found.eigenvalues, 1j * np.sqrt(np.sort(squares)), rtol=1e-10)
    assert not found.warnings


def test_upside_down_it_falls_at_the_rates_of_the_same_roots():
    hanging, standing = bd.modes(double_pendulum()), bd.modes(double_pendulum(up=True))
    assert_allclose(standing.eigenvalues, np.abs(hanging.eigenvalues), rtol=1e-10)
    assert standing.kinds == ("unstable", "unstable")
    assert_allclose(standing.growth_rates, standing.eigenvalues.real)
    (told,) = standing.warnings
    assert "unstable: 2 modes grow" in told


@pytest.mark.slow(reason="16 elements, and the roots of a determinant")
@pytest.mark.parametrize("height", [0.002, 0.05])
def test_a_cantilever_is_that_of_timoshenko(height):
    section = bd.Section.rectangle(STEEL, width=0.03, height=height)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=16))
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    known = timoshenko_cantilever(section, 0.5, 4)
    found = bd.modes(mech, n=6).eigenvalues.imag
    nearest = found[np.argmin(np.abs(found[:, None] - known), axis=0)]
    # Order 6 of the elements, of which the fourth mode has five a wave.
    assert_allclose(nearest, known, rtol=2e-6)
    assert_allclose(nearest[:2], known[:2], rtol=2e-8)
    if height < 0.01:
        # Euler-Bernoulli, cosh(x) cos(x) = -1: the height makes it 4 (h / L)^2 x^2 / 12 less.
        thin = np.array([1.875104068711961, 4.694091132974175]) ** 2
        thin *= np.sqrt(section.EI / section.rhoA) / 0.25
        assert_allclose(found[:2], thin, rtol=2e-4)
        # Share of the mass in the first bending mode, over the table of Blevins: 0.6131.
        share = bd.modes(mech, n=2).effective_masses[:, 1] / (section.rhoA * 0.5)
        assert_allclose(share, [0.61308, 0.18830], rtol=1e-3)


@pytest.mark.slow(reason="all modes")
def test_effective_masses_add_up_to_the_mass():
    found = bd.modes(cantilever(2), n=None)
    total = STRIP.rhoA * 0.5
    # But for what is fixed with the root, a share of the first element.
    assert_allclose(found.effective_masses.sum(axis=0), total, rtol=0.07)
    assert_allclose(sum(found.shares.values()), 1.0, rtol=1e-12)
    mass = found._linearization.tangent.mass
    assert_allclose(found.shapes.conj() @ (mass @ found.shapes.T), np.eye(len(found)), atol=1e-7)
    assert_allclose(found.mac(found), np.eye(len(found)), atol=1e-7)


@pytest.mark.slow(reason="256 elements")
def test_light_damping_of_many_elements_is_told():
    """Rounding of the stiffness is more than this damping of the lowest mode."""
    found = bd.modes(cantilever(256, damping=1e-5, formulation="exact"), n=2)
    w = bd.modes(cantilever(16), n=2).eigenvalues.imag
    assert_allclose(found.damping_ratios, 0.5 * 1e-5 * w, rtol=1e-4)


def test_material_damping_of_a_mode_grows_with_its_frequency():
    damped, free = bd.modes(cantilever(damping=1e-5), n=4), bd.modes(cantilever(), n=4)
    w = free.eigenvalues.imag
    assert_allclose(damped.damping_ratios, 0.5 * 1e-5 * w, rtol=1e-6)
    assert_allclose(np.abs(damped.eigenvalues), w, rtol=1e-7)


# What moves freely -------------------------------------------------------------------------------


@pytest.mark.parametrize(("elements", "damping"), [(4, 0.0), (40, 1e-6)])
def test_a_free_beam_moves_as_a_rigid_body_three_ways(elements, damping):
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(STEEL, width=0.03, height=0.002, damping=damping)
    mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.5, 0.2)), strip, elements=elements))
    found = bd.modes(mech, n=5)
    assert found.kinds == ("free motion",) * 3 + ("vibration",) * 2
    assert_allclose(found.eigenvalues[:3], 0.0, atol=0.0)
    # cosh(x) cos(x) = 1
    known = np.array([4.730040744862704, 7.853204624095838]) ** 2
    known *= np.sqrt(strip.EI / strip.rhoA) / np.hypot(0.5, 0.2) ** 2
    # Shear and rotary inertia of a height of 0.002 m; at four elements the mesh.
    assert_allclose(np.abs(found.eigenvalues[3:]), known, rtol=1e-3)


def test_what_only_a_damper_holds_decays():
    mech = bd.Mechanism()
    bob = mech.add(bd.PointMass("bob", 2.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), bob.point))
    mech.add(bd.Damper("damper", mech.ground.at(0.0, 0.0), bob.point, damping=3.0))
    found = bd.modes(mech)
    assert found.kinds == ("free motion", "decay")
    assert_allclose(found.eigenvalues, [0.0, -1.5], rtol=1e-12)
    assert_allclose(found.damping_ratios, [0.0, 1.0])


def test_a_skate_holds_velocities_across_and_nothing_else():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 2.0, 0.1, center=(0.0, 0.0)))
    for name, x in (("front", 0.3), ("rear", -0.3)):
        mech.add(
            bd.Bushing(
                name,
                mech.ground.at(x, 0.0),
                body.at(x, 0.0),
                kx=50.0,
                ky=80.0,
                ktheta=0.0,
                cx=0.0,
                cy=0.0,
                ctheta=0.0,
            )
        )
    free = bd.modes(mech)
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    held = bd.modes(mech)
    turn = np.sqrt(2.0 * 80.0 * 0.3**2 / 0.1)
    assert_allclose(free.eigenvalues.imag, np.sort([np.sqrt(50.0), np.sqrt(80.0), turn]), rtol=1e-9)
    assert_allclose(held.eigenvalues.imag, np.sort([np.sqrt(50.0), turn]), rtol=1e-9)


def test_redundant_constraints_are_spared_or_refused():
    def twice(**settings):
        mech = cantilever(2)
        mech.redundant = settings.get("redundant", "refuse")
        mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), mech.part("beam").start))
        return mech

    with pytest.raises(bd.BeamdaeError, match="depend on each other"):
        bd.modes(twice())
    spared = bd.modes(twice(redundant="minimum norm"), n=3)
    assert_allclose(spared.eigenvalues, bd.modes(cantilever(2), n=3).eigenvalues, rtol=1e-9)


# The state ---------------------------------------------------------------------------------------


@pytest.mark.slow(reason="five equilibria")
def test_weight_stiffens_what_hangs_and_softens_what_stands():
    """Tip load P on a strip: w^2 changes as 1 - P / Pcr, nearly (Blevins), Pcr = (pi / 2L)^2 EI."""
    critical = (0.5 * np.pi / 0.5) ** 2 * STRIP.EI
    squares = []
    for load in (-0.2, 0.0, 0.2, 0.999, 1.001):
        mech = cantilever(4)
        mech.add(bd.Force("load", mech.part("beam").end, (-load * critical, 0.0)))
        first = bd.modes(mech, about="equilibrium", n=1).eigenvalues[0]
        squares.append(-((first**2).real))
    pulled, still, pushed, below, above = squares
    assert_allclose([pulled / still, pushed / still], [1.2, 0.8], rtol=0.02)
    # Shear and compression of the strip shift the load by 1e-5 of it.
    assert below > 0.0 > above
    assert abs(below) < 2e-3 * still


@pytest.mark.slow(reason="an equilibrium")
def test_the_drawing_need_not_be_an_equilibrium():
    """A strip let go with the weight upon it does not bear it yet: it has the modes without."""
    falling = bd.modes(cantilever(gravity=(0.0, -9.81)), n=3)
    free = bd.modes(cantilever(), n=3)
    assert "no equilibrium" in falling.warnings[0]
    assert_allclose(falling.eigenvalues, free.eigenvalues, rtol=1e-3)
    rested = bd.modes(cantilever(gravity=(0.0, -9.81)), about="equilibrium", n=3)
    assert not rested.warnings


@pytest.mark.parametrize("angle", [0.4, 2.0])
def test_frequencies_off_an_equilibrium_do_not_depend_on_coordinates(angle):
    """A bob on a circle, by its angle and by x and y: g / l cos(angle) everywhere."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
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
    # The square root of an angle, of all coordinates.
    s = ca.SX.sym("s", 1)
    w = ca.SX.sym("w", 1)
    odd = bd.ConstrainedSystem(
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
    for system in (bob, odd):
        found = bd.modes(system)
        assert_allclose((found.eigenvalues**2).real, [-9.81 * np.cos(angle)], rtol=1e-7)


def test_positions_by_name_are_a_state():
    mech = bd.Mechanism()
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.25, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("spring", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0), stiffness=5.0))
    found = bd.modes(mech, about={"bar.angle": 0.3})
    assert_allclose(found.q[2], 0.3)
    assert_allclose(found.eigenvalues, [2.0j], rtol=1e-8)
    assert "bar.angle" in found.about


def test_a_moment_of_a_run_is_a_state():
    mech = double_pendulum()
    solution = bd.simulate(mech, bd.Radau(1e-8), 0.2)
    found = bd.modes(mech, about=solution.at(0.1))
    assert_allclose(found.eigenvalues, bd.modes(mech).eigenvalues, rtol=1e-6)
    with pytest.raises(bd.BeamdaeError, match="within the run"):
        solution.at(0.3)
    with pytest.raises(bd.BeamdaeError, match="not one of this model"):
        bd.modes(cantilever(), about=solution.at(0.1))


# What must not matter ----------------------------------------------------------------------------


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("turn", [0.7, 3.0])
def test_place_and_turn_of_the_drawing_and_the_order_of_parts_do_not_matter(turn, backwards):
    moved = bd.modes(double_pendulum(turn, (3.0, -2.0), backwards))
    assert_allclose(moved.eigenvalues, bd.modes(double_pendulum()).eigenvalues, rtol=1e-9)


def arch(elements, turn=0.0):
    mech = bd.Mechanism()
    arc = bd.Arc(radius=1.0, length=1.2, start=(0.3, 0.1), angle=turn)
    beam = mech.add(bd.Beam("arch", arc, STRIP, elements=elements))
    for name, at, end in (("a", 0.0, beam.start), ("b", 1.2, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(at)), end))
    return mech


def test_a_curved_beam_may_be_turned():
    first, turned = (bd.modes(arch(4, turn), n=5).eigenvalues for turn in (0.0, 2.2))
    assert_allclose(turned, first, rtol=1e-8)


@pytest.mark.parametrize("damping", [0.0, 1e-5])
def test_dense_and_sparse_solvers_agree(damping, monkeypatch):
    mech = cantilever(12, damping=damping)
    dense = bd.modes(mech, n=8)
    for solver in ("symmetric_problem", "quadratic_problem"):
        monkeypatch.setattr(f"beamdae.analysis.modes.{solver}.ALL_AT_ONCE", 10)
    sparse = bd.modes(mech, n=8)
    # Stretching is 1e9 times as stiff as the lowest mode: rounding of it makes 1e-7 of that.
    assert_allclose(sparse.eigenvalues, dense.eigenvalues, rtol=1e-8)
    assert_allclose(np.diag(sparse.mac(dense)), 1.0, rtol=1e-9)


@pytest.mark.slow(reason="kernels of three formulations")
def test_formulations_of_one_beam_have_the_same_linear_modes():
    known = bd.modes(cantilever(12), n=4).eigenvalues
    for settings in ({"strain": "linear"}, {"strain": "nonlinear", "frame": "tangent"}):
        assert_allclose(bd.modes(cantilever(12, **settings), n=4).eigenvalues, known, rtol=1e-7)


def test_mistakes_are_told():
    for about in ("drawn", 3, None, ("reference",)):
        with pytest.raises(bd.BeamdaeError, match="about"):
            bd.modes(oscillator(), about=about)
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    force, zero = ca.vertcat(-q[0], -q[1]), [0.0, 0.0]
    massless = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0, 0.0], force=force, q0=zero, v0=zero)
    with pytest.raises(bd.BeamdaeError, match="without inertia"):
        bd.modes(massless)


def test_a_table_tells_frequencies_and_what_moves():
    table = bd.modes(double_pendulum()).table()
    assert list(table["mode"]) == [1, 2]
    assert table["moves"][0] == "bob 1 56%, bob 0 44%"
    assert set(table["kind"]) == {"vibration"}
