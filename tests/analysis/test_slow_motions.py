"""Slowest motions of models of any size, and modes against eigenvalues of dense matrices."""

import re
from pathlib import Path

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, hinged_body, rectangle, symbols
from numpy.testing import assert_allclose
from scipy.linalg import lstsq, null_space

import beamdae as bd
from beamdae.analysis.continuation import spectrum
from beamdae.analysis.eigenproblems import slow_motions
from beamdae.analysis.linear_dynamics.linearization import linearize_about


def frame(shape, slenderness, formulation, elements, damping, height=1.0):
    """Return a cantilever, a free strip, a ring or a bent strip between two hinges."""
    mech = bd.Mechanism()
    section = rectangle(height / slenderness, 0.02 * height, damping=damping)
    settings = {"elements": elements, "formulation": formulation}
    if shape == "ring":
        circle = bd.Arc(radius=height, length=2.0 * np.pi * height)
        bd.welded_beams(mech, "ring", circle, section, 4, closed=True, **settings)
        return mech
    beam = mech.add(bd.Beam("post", bd.Line((0.0, 0.0), (0.0, height)), section, **settings))
    if shape == "cantilever":
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    if shape == "portal":
        line = bd.Line((0.0, height), (height, 0.5 * height))
        other = mech.add(bd.Beam("rafter", line, section, **settings))
        mech.add(bd.Weld("corner", beam.end, other.start))
        for name, end in (("left", beam.start), ("right", other.end)):
            mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    return mech


# Free motions, and sqrt(rhoA L^4 / EI) times the lowest angular frequencies: roots of
# cos(x) cosh(x) = -1 and 1 squared, and Hoppe's formula for rings.
CLOSED_FORMS = {
    "cantilever": (0, [3.516015269, 22.03449157, 61.69721442]),
    "free": (3, [22.37328545, 61.67282287, 120.9033918]),
    "ring": (3, [np.sqrt(36.0 / 5.0)] * 2),
    "portal": (0, []),
}


@pytest.mark.parametrize("shape", CLOSED_FORMS)
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize(
    ("elements", "damping", "height"),
    [
        (4, 0.0, 1.0),
        *(
            pytest.param(*x, marks=pytest.mark.slow(reason="many models"))
            for x in ((4, 1e-5, 1.0), (4, 0.0, 1e-3), (48, 0.0, 1.0), (48, 1e-5, 30.0))
        ),
    ],
)
def test_slenderness_does_not_enter_rounding(shape, formulation, elements, damping, height):
    """At L/h = 1e5, rounding of the axial stiffness exceeded the stiffness of the lowest modes."""
    count, expected = CLOSED_FORMS[shape]
    frequencies = []
    # Frames of many elements of a ring turn by differences of positions.
    is_fine_ring = (shape, formulation, elements) == ("ring", "floating frame", 48)
    for slenderness in (1e4, 1e5 if is_fine_ring else 1e6):
        mech = frame(shape, slenderness, formulation, elements, damping, height)
        section = next(iter(mech.parts.values())).section
        modes = bd.modes(mech, n=count + 3, damping=damping > 0.0)
        assert list(modes.kinds) == ["free motion"] * count + ["vibration"] * 3
        unit = np.sqrt(section.EI / section.rhoA) / height**2
        frequencies.append(np.abs(modes.eigenvalues[count:]) / unit)
    # Shear and rotary inertia are of the order of (h / L)^2, damping of its square.
    assert_allclose(frequencies[1], frequencies[0], rtol=1e-6)
    if elements > 4:
        assert_allclose(frequencies[1][: len(expected)], expected, rtol=1e-6)


@pytest.mark.parametrize(("elements", "damping"), [(4, 1e-4), (32, 1e-6)])
def test_damped_free_strips_have_three_free_motions(elements, damping):
    """Two were found while the motions without stiffness and damping took part in the inverse."""
    modes = bd.modes(frame("free", 1e2, "floating frame", elements, damping), n=8)
    assert modes.kinds == ("free motion",) * 3 + ("vibration",) * 5


def chain(beams, damping, formulation="floating frame", joint=bd.Revolute):
    """Return a cantilever of short beams in a row, with springs and dampers at its joints."""
    mech = bd.Mechanism()
    section = rectangle(5e-3, damping=damping)
    end = mech.ground.at(0.0, 0.0)
    for k in range(beams):
        line = bd.Line((0.1 * k, 0.0), (0.1 * (k + 1), 0.0))
        beam = mech.add(bd.Beam(f"beam {k}", line, section, 1, formulation=formulation))
        mech.add((bd.Weld if k == 0 else joint)(f"joint {k}", end, beam.start))
        if k and joint is bd.Revolute:
            mech.add(bd.TorsionSpring(f"spring {k}", end, beam.start, 5.0, damping=1e-3))
        end = beam.end
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    "beams", [32, pytest.param(192, marks=pytest.mark.slow(reason="half a second"))]
)
@pytest.mark.parametrize("joint", [bd.Revolute, bd.Weld])
def test_modes_of_chains_of_any_size(beams, joint):
    modes = bd.modes(chain(beams, 1e-4, joint=joint))
    undamped = bd.modes(chain(beams, 1e-4, joint=joint), damping=False)
    assert_allclose(np.abs(modes.eigenvalues[:5]), np.abs(undamped.eigenvalues[:5]), rtol=1e-3)
    assert np.all(modes.damping_ratios > 0.0)


@pytest.mark.slow(reason="192 beams on a hinge")
def test_free_chain_of_welded_beams_has_one_free_motion():
    """The free motion dominates the inverse."""
    mech = bd.Mechanism()
    section = rectangle(0.0025, 0.03, damping=1e-4)
    end, joint = mech.ground.at(0.0, 0.0), bd.Revolute
    for k in range(192):
        beam = mech.add(bd.Beam(f"beam {k}", bd.Line((0.4 * k, 0), (0.4 * k + 0.4, 0)), section, 1))
        mech.add(joint(f"joint {k}", end, beam.start))
        end, joint = beam.end, bd.Weld
    modes = bd.modes(mech, n=6)
    assert modes.kinds == ("free motion",) + ("vibration",) * 5
    # Hinged and free: roots of tan(x) = tanh(x).
    roots = np.array([3.926602312, 7.068582745, 10.210176122])
    expected = (roots / (192 * 0.4)) ** 2 * np.sqrt(section.EI / section.rhoA)
    assert_allclose(np.abs(modes.eigenvalues[1:4]), expected, rtol=1e-5)


def damped_strip(elements, height=0.004):
    """Return a clamped strip with Kelvin-Voigt damping of 1e-3 s: decays cluster at -1000 1/s."""
    section = rectangle(height, damping=1e-3)
    mech, _ = clamped_beam(section, elements, name="strip", formulation="exact")
    return mech


@pytest.mark.slow(reason="many elements")
def test_modes_of_strong_material_damping():
    modes = bd.modes(damped_strip(32), n=6)
    assert modes.kinds == ("vibration",) * 4 + ("decay",) * 2
    assert_allclose(modes.eigenvalues[4:], -1000.0, rtol=1e-3)
    assert_allclose(bd.modes(damped_strip(120), n=4).eigenvalues, modes.eigenvalues[:4], rtol=1e-6)


@pytest.mark.slow(reason="many elements")
@pytest.mark.parametrize("damping", [True, False])
def test_problems_that_do_not_converge_use_dense_matrices_or_end_in_one_sentence(
    damping, monkeypatch
):
    expected = bd.modes(damped_strip(64), n=3, damping=damping).eigenvalues
    monkeypatch.setattr(spectrum, "_MAX_SEARCHES", 0)
    dense = bd.modes(damped_strip(64), n=3, damping=damping).eigenvalues
    assert_allclose(dense, expected, rtol=1e-6)
    monkeypatch.setattr(slow_motions, "_MAX_FALLBACK_COORDINATES", 0)
    with pytest.raises(bd.BeamdaeError, match=r"3 lowest modes were not found, .* request fewer"):
        bd.modes(damped_strip(64), n=3, damping=damping)


@pytest.mark.slow(reason="many elements")
@pytest.mark.parametrize(("elements", "count"), [(64, 100), (150, 12)])
def test_modes_beyond_the_vibrations_of_strong_damping_are_found(elements, count):
    mech = damped_strip(elements)
    modes = bd.modes(mech, n=count)
    assert modes.kinds == ("vibration",) * 4 + ("decay",) * (count - 4)
    assert_allclose(modes.eigenvalues[4:], -1000.0, rtol=1e-3)
    undamped = np.abs(bd.modes(mech, n=4, damping=False).eigenvalues)
    # Kelvin-Voigt damping: l^2 + 1e-3 w^2 l + w^2 = 0.
    exact = -0.5e-3 * undamped**2 + 1j * undamped * np.sqrt(1.0 - (0.5e-3 * undamped) ** 2)
    assert_allclose(modes.eigenvalues[:4], exact, rtol=1e-7)


@pytest.mark.slow(reason="many elements")
@pytest.mark.parametrize(("height", "count"), [(0.004, 100), (0.001, 12)])
def test_modes_in_a_cluster_of_decays(height, count):
    mech = damped_strip(150, height)
    undamped = np.abs(bd.modes(mech, n=12, damping=False).eigenvalues)
    modes = bd.modes(mech, n=count)
    # Kelvin-Voigt damping: l^2 + 1e-3 w^2 l + w^2 = 0.
    vibrations = undamped[undamped < 1e3]
    exact = -0.5e-3 * vibrations**2 + 1j * vibrations * np.sqrt(1.0 - (0.5e-3 * vibrations) ** 2)
    assert_allclose(modes.eigenvalues[: len(exact)], exact, rtol=1e-6)
    # Decays of the fastest and of slower motions, -1e3 (1 + 1e6 / w^2), are not separated.
    assert_allclose(modes.eigenvalues[len(exact) :], np.full(count - len(exact), -1e3), rtol=5e-6)
    # The shapes, also of equal eigenvalues, are different motions.
    singular = np.linalg.svd(modes.shapes / np.linalg.norm(modes.shapes, axis=1)[:, None])[1]
    assert singular[-1] > 1e-3


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_regression_overdamped_modes_are_as_many_as_requested(formulation):
    """Refined real eigenvalues with rounded imaginary parts below zero were lost: 11 of 20."""
    section = rectangle(0.01, damping=0.03)
    mech, _ = clamped_beam(section, 30, formulation=formulation)
    modes = bd.modes(mech, n=20)
    assert set(modes.kinds) == {"decay"}
    # Eigenvalues accumulate at minus the ratio of stiffness to damping.
    assert_allclose(modes.eigenvalues, np.full(20, -1.0 / 0.03), rtol=1e-5)


def spinning_blades(damping, elements=20, has_motor=True):
    """Return two blades on a hub that turns freely, or that a motor turns at 20 rad/s."""
    mech = bd.Mechanism()
    section = rectangle(0.01, 0.03, damping=damping)
    hub = mech.add(bd.RigidBody("hub", 1.0, inertia=0.1, center=(0.0, 0.0)))
    center = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axis", center, hub.at(0.0, 0.0)))
    if has_motor:
        mech.add(bd.Driver("motor", center, hub.at(0.0, 0.0), lambda t: 20.0 * t))
    for k, tip in enumerate([(1.0, 0.0), (-0.8, 0.3)]):
        line = bd.Line((0.0, 0.0), tip)
        blade = mech.add(bd.Beam(f"blade {k}", line, section, elements, formulation="exact"))
        mech.add(bd.Weld(f"root {k}", hub.at(0.0, 0.0), blade.start))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("damping", [0.0, 1e-6])
def test_gyroscopic_modes_of_large_models_are_those_of_all_motions(damping):
    expected = bd.modes(spinning_blades(damping), about=bd.rotation(20.0), n=None).eigenvalues
    modes = bd.modes(spinning_blades(damping), about=bd.rotation(20.0), n=20)
    # On meshes of 19 to 21 elements, rounding errors of the complete solution are 2e-10 to 2e-9.
    assert_allclose(modes.eigenvalues, expected[:20], rtol=4e-9)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("damping", [0.0, 1e-5])
def test_regression_free_rotation_counts_as_one_mode(damping):
    """Both eigenvalues of its double zero counted, so that one mode was missing.

    The last mode is a conjugate pair, which counts as one.
    """
    mech = spinning_blades(damping, elements=15, has_motor=False)
    more = bd.modes(mech, bd.rotation(20.0), n=20).eigenvalues
    for count in (2, 5, 10):
        values = bd.modes(mech, bd.rotation(20.0), n=count).eigenvalues
        assert values[0] == 0.0
        assert np.all(values[1:].imag > 0.0)
        assert_allclose(values, more[:count], rtol=2e-9)


@pytest.mark.slow(reason="a fifth of a second")
def test_slow_decays_of_stiff_parts_with_strong_dampers_are_found():
    """The undamped modes do not contain them: x'' + c x' + k x = 0 with c >> sqrt(k) >> 1."""
    stiffness = np.linspace(1.0, 500.0, 300)
    damping = np.concatenate([np.zeros(290), np.geomspace(10.0, 1e5, 10)])
    t, q, v = symbols(300)
    zeros = np.zeros(300)
    system = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=zeros + 1.0, force=-stiffness * q - damping * v, q0=zeros, v0=zeros
    )
    roots = np.concatenate(
        [np.roots([1.0, c, k]) for k, c in zip(stiffness, damping, strict=True)]
    ).astype(complex)
    roots = roots[roots.imag >= 0.0]
    expected = roots[np.argsort(np.abs(roots))][:12]
    assert np.sum(expected.imag == 0.0) == 7
    assert_allclose(bd.modes(system, n=12).eigenvalues, expected, rtol=1e-9, atol=1e-12)


def test_regression_large_models_of_few_motions_have_no_other_modes():
    """A request for more modes than motions of more than 300 coordinates had spurious zeros."""
    mech, last = bd.Mechanism(gravity=EARTH), None
    for k in range(101):
        body = mech.add(bd.RigidBody(f"body {k}", 1.0, 0.1, (0.0, -k - 1.0)))
        if last is None:
            mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
        else:
            mech.add(bd.Weld(f"weld {k}", last.at(0.0, -k), body.at(0.0, -k)))
        last = body
    depths = np.arange(1.0, 102.0)
    square = 9.81 * np.sum(depths) / np.sum(depths**2 + 0.1)
    modes = bd.modes(mech, n=4)
    assert_allclose(modes.eigenvalues, [1j * np.sqrt(square)], rtol=1e-9)


# Modes against eigenvalues of dense first-order matrices.

SOFT = bd.Material(E=1e8, nu=0.3, rho=1000.0)
STRIP = rectangle(0.01, damping=2e-4, material=SOFT)
FORMULATIONS = ("floating frame", "exact")


def arch(formulation):
    """Return an arch on two hinges, with a mass suspended from it by a spring and a damper."""
    mech = bd.Mechanism(gravity=EARTH)
    arc = bd.Arc(radius=0.6, length=0.8, start=(0.0, 0.0), angle=-0.66)
    beam = mech.add(bd.Beam("arch", arc, STRIP, elements=2, formulation=formulation))
    for name, s, end in (("left", 0.0, beam.start), ("right", 0.8, beam.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*arc.point(s)), end))
    x, y = arc.point(0.3)
    bob = mech.add(bd.PointMass("bob", 0.02, at=(x, y - 0.2)))
    mech.add(bd.Spring("wire", beam.at(0.3), bob.point, 20.0, 0.05))
    return mech


def arm(formulation, has_driver=True, offset=0.1):
    """Return a curved, damped beam on a hub."""
    mech, hub = hinged_body(1.0, 0.01, name="hub")
    arc = bd.Arc(radius=0.5, length=0.6, start=(offset, 0.0), angle=0.3)
    beam = mech.add(bd.Beam("beam", arc, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("root", hub.at(offset, 0.0), beam.start))
    if has_driver:
        mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0), law=0.0))
    return mech


def redundant_arm(formulation):
    mech = arm(formulation)
    mech.redundant = "minimum norm"
    mech.add(bd.Revolute("pin", mech.part("hub").at(0.1, 0.0), mech.part("beam").start))
    return mech


def sled(formulation):
    """Return a sled on a knife edge with a flexible tail and a soft bushing to the ground."""
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sled", 0.2, 0.01))
    line = bd.Line((0.0, 0.0), (0.5, 0.1))
    beam = mech.add(bd.Beam("tail", line, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("hitch", body.at(0.0, 0.0), beam.start))
    mech.add(bd.Skate("blade", body.at(0.0, 0.0), (1.0, 0.0)))
    ends = mech.ground.at(-0.3, 0.0), body.at(-0.3, 0.0)
    mech.add(bd.Bushing("tether", *ends, 30.0, 50.0, 0.0, 0.1, 0.2, 0.0))
    return mech


def falling_arm(formulation):
    """Return the arm without a driver, which falls under its weight."""
    mech = arm(formulation, has_driver=False)
    mech.gravity = np.array([0.0, -9.81])
    return mech


CASES = {
    "at rest": (arch, "equilibrium"),
    "rotating": (arm, bd.rotation(15.0)),
    "rotating freely": (lambda x: arm(x, has_driver=False), bd.rotation(15.0)),
    "redundant": (redundant_arm, "reference"),
    "nonholonomic": (sled, "reference"),
    "in motion": (falling_arm, None),
}


def with_marks(case):
    slow = case != "nonholonomic"
    return pytest.param(case, marks=[pytest.mark.slow(reason="one is enough")] if slow else [])


def model_and_state(case, formulation):
    make, about = CASES[case]
    mech = make(formulation)
    return mech, about or bd.simulate(mech, bd.Radau(1e-6), 0.1).at(0.07)


def dense_eigenvalues(lin):
    """Return the eigenvalues of q' = v, M v' + C v + K q + H lam = 0 under the constraints."""
    tangent, e = lin.tangent, lin.equations
    stiffness, damping, mass = (
        x.toarray() for x in (tangent.stiffness, tangent.damping, tangent.mass)
    )
    by_q, by_v = tangent.position_jacobian.toarray(), tangent.velocity_jacobian.toarray()
    zeros = np.zeros_like(by_q)
    holonomic = ~lin.linearized_equations.nonholonomic
    rows = [np.hstack([by_q, by_v]), np.hstack([zeros, by_q])[holonomic]]
    scales = np.concatenate([e.position_scales, 30.0 * e.position_scales])
    states = scales[:, None] * null_space(np.vstack(rows) * scales)
    left_basis = null_space(tangent.reactions.toarray().T).T
    one, zero = np.eye(e.n) / e.position_scales[:, None], np.zeros((e.n, e.n))
    by_rates = np.block([[one, zero], [left_basis @ np.hstack([zero, mass])]])
    by_states = np.block([[zero, one], [-left_basis @ np.hstack([stiffness, damping])]])
    # Inverted about a shift, so that rounding of fast modes does not enter slow ones.
    shift = 30.0
    shifted = lstsq((by_states - shift * by_rates) @ states, by_rates @ states)[0]
    return shift + 1.0 / np.linalg.eigvals(shifted)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [with_marks(case) for case in CASES])
def test_modes_match_dense_eigenvalues(case, formulation):
    mech, about = model_and_state(case, formulation)
    lin = linearize_about("modes", mech, about)
    modes = bd.modes(mech, about, n=6)
    expected = dense_eigenvalues(lin)
    for value, kind in zip(modes.eigenvalues, modes.kinds, strict=True):
        if kind == "free motion":
            # The error of a double zero is the square root of rounding.
            assert np.min(np.abs(expected)) < 1e-3
            continue
        assert_allclose(expected[np.argmin(np.abs(expected - value))], value, rtol=1e-8)
    # No eigenvalue is missing.
    lowest = np.sort(np.abs(expected[(expected.imag >= 0.0) & (np.abs(expected) > 1e-3)]))
    nonzero = np.abs(modes.eigenvalues[[kind != "free motion" for kind in modes.kinds]])
    assert_allclose(lowest[: len(nonzero)], nonzero, rtol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", [with_marks(case) for case in CASES])
def test_shapes_satisfy_the_linearized_equations(case, formulation):
    mech, about = model_and_state(case, formulation)
    modes = bd.modes(mech, about, n=6)
    tangent = modes._linearization.tangent
    for value, shape in zip(modes.eigenvalues, modes.shapes, strict=True):
        inertia = value**2 * (tangent.mass @ shape)
        force = inertia + value * (tangent.damping @ shape) + tangent.stiffness @ shape
        h = tangent.reactions.toarray()
        unbalanced = force - h @ np.linalg.lstsq(h, force, rcond=None)[0]
        assert np.max(np.abs(unbalanced)) <= 1e-6 * max(
            np.max(np.abs(tangent.stiffness @ shape)), 1.0
        )
        gap = tangent.position_jacobian @ shape + value * (tangent.velocity_jacobian @ shape)
        assert np.max(np.abs(gap)) <= 1e-7 * max(1.0, abs(value)) * np.max(np.abs(shape))


@pytest.mark.slow(reason="all models about several states")
@pytest.mark.parametrize("path", sorted(Path("models").glob("*.py")), ids=lambda path: path.stem)
def test_every_model_has_modes_or_a_clear_error(path):
    model = bd.load_model(path)
    run = bd.simulate(model, t_end=0.02, output_step=0.01)
    for about in ("equilibrium", bd.rotation(2.0), run.at(0.013)):
        try:
            bd.modes(model, about, n=4)
        except bd.BeamdaeError as error:
            # Some mechanisms rotate or fall forever, and weight does not rotate with the frame.
            if not re.search("no equilibrium was found|do not rotate with", str(error)):
                raise
    modes = bd.modes(model, n=4)
    equations = modes._linearization.equations
    free = equations.n - equations.m
    assert len(modes) >= min(4, free)
    # A complex pair is one mode, and two real eigenvalues of a damped degree of freedom are two.
    n_pairs = np.count_nonzero(modes.eigenvalues.imag > 0.0)
    assert len(modes) + n_pairs <= 2 * free - len(equations.states)
    assert np.all(np.isfinite(modes.eigenvalues))
    assert free or any("there are no modes" in x for x in modes.warnings)
