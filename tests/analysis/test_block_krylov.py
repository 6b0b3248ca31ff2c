"""Block Krylov method: multiple eigenvalues, accuracy, and modes of large chains of beams."""

import warnings

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.analysis.eigenproblems import slow_motions
from beamdae.analysis.eigenproblems.block_krylov import BlockKrylov
from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import linearize_about
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.simulation import skip_result_checks

STEEL = bd.Material.of("steel")


def random_basis(n, seed=0):
    """Return a random orthogonal matrix (n, n)."""
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))[0]


def krylov_space(matrix, columns, metric=None, is_symmetric=True):
    start = np.random.default_rng(1).standard_normal((len(matrix), columns))
    metric = sp.eye_array(len(matrix)) if metric is None else metric
    return BlockKrylov(lambda x: matrix @ x, start, metric, is_symmetric)


def converge_to(krylov, count):
    """Expand the space until the `count` largest eigenpairs are accurate."""

    def required_accuracy(values):
        return np.where(np.arange(len(values)) < count, 0.0, np.inf)

    return krylov.converge(required_accuracy)


def test_multiple_eigenvalues_are_found_with_their_multiplicity():
    q = random_basis(60)
    exact = np.concatenate([[5.0, 5.0, 5.0, -4.0, -4.0], 1.0 / np.arange(1, 56)])
    krylov = krylov_space((q * exact) @ q.T, columns=5)
    assert converge_to(krylov, 5)
    assert_allclose(krylov.values[:5], [5.0, 5.0, 5.0, -4.0, -4.0], rtol=1e-12)
    vectors = krylov.vectors(np.arange(5))
    assert_allclose(vectors.T @ vectors, np.eye(5), atol=1e-12)
    assert_allclose(((q * exact) @ q.T) @ vectors, vectors * krylov.values[:5], atol=1e-9)


@pytest.mark.parametrize("is_symmetric", [True, False])
def test_residuals_are_those_of_the_eigenpairs(is_symmetric):
    rng = np.random.default_rng(2)
    matrix = rng.standard_normal((40, 40))
    metric = np.diag(rng.uniform(1.0, 9.0, 40))
    if is_symmetric:
        # Self-adjoint in the metric.
        matrix = np.linalg.solve(metric, matrix + matrix.T)
    krylov = krylov_space(matrix, 3, sp.csr_array(metric), is_symmetric)
    krylov.expand()
    vectors = krylov.vectors(np.arange(krylov.size))
    residuals = matrix @ vectors - vectors * krylov.values
    lengths = np.sqrt(np.einsum("ij,ij->j", residuals.conj(), metric @ residuals).real)
    assert_allclose(krylov.residuals * np.abs(krylov.values), lengths, rtol=1e-6)


def test_invariant_space_is_exact():
    q = random_basis(30)
    matrix = q[:, :6] @ np.diag([6.0, 5.0, 4.0, 3.0, 2.0, 1.0]) @ q[:, :6].T
    krylov = krylov_space(matrix, 4)
    while krylov.expand():
        pass
    # One random direction of each column of the start lies in the null space.
    assert krylov.size == 10
    assert_allclose(krylov.values[:6], [6.0, 5.0, 4.0, 3.0, 2.0, 1.0], rtol=1e-12)


@pytest.mark.parametrize("contrast", [1e6, 1e8, 1e9])
def test_regression_rounding_errors_in_stiff_metrics_are_no_new_vectors(contrast):
    """Similar vectors of rounding errors were appended; false eigenvalues kept spaces growing."""
    n, rng = 60, np.random.default_rng(0)
    # Stiff springs tie the coordinates of each pair, x and y = r x.
    ratios = rng.uniform(0.5, 2.0, n)
    cosines = 1.0 / np.sqrt(1.0 + ratios**2)
    ties = sp.hstack([sp.diags_array(ratios), -sp.eye_array(n)])
    metric = sp.csr_array(contrast * (ties.T @ ties) + sp.eye_array(2 * n))
    basis = random_basis(n)
    soft = np.vstack([cosines[:, None] * basis, (ratios * cosines)[:, None] * basis])
    exact = 1.0 / np.arange(1, n + 1) ** 2
    krylov = BlockKrylov(
        lambda x: soft @ (exact[:, None] * (soft.T @ x)), soft[:, :8], metric, False
    )
    while krylov.size < 80 and krylov.expand():
        pass
    # The first block is invariant.
    assert krylov.size == 8
    assert_allclose(krylov.values, exact[:8], rtol=1e-9)


@pytest.mark.slow(reason="half a second and more")
def test_eigenvalues_inside_a_cluster_do_not_converge():
    exact = np.concatenate([[2.0], 1.0 - 0.1 * np.linspace(0.0, 1.0, 999) ** 4])
    krylov = krylov_space(np.diag(exact), 2)
    assert not converge_to(krylov, 4)
    assert krylov.residuals[0] < 1e-11


def find_modes(mech, **settings):
    """Return modes without the solutions for their errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return bd.modes(mech, **settings)


def count_solutions(monkeypatch):
    """Return a list that grows by one entry per right-hand side of a linear system."""
    solutions = []

    def factorize(*matrices):
        solve = factorize_saddle_point(*matrices)

        def solve_and_count(right):
            solutions.extend(right.T)
            return solve(right)

        return None if solve is None else solve_and_count

    monkeypatch.setattr(slow_motions, "factorize_saddle_point", factorize)
    return solutions


def chain(beams, damping, formulation="floating frame", joint=bd.Revolute):
    """Return a cantilever of short beams in a row, with springs and dampers at its joints."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=5e-3, damping=damping)
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
    "beams", [32, pytest.param(192, marks=pytest.mark.slow(reason="192 beams"))]
)
@pytest.mark.parametrize("joint", [bd.Revolute, bd.Weld])
def test_modes_of_chains_need_few_solutions_of_any_size(beams, joint, monkeypatch):
    """ARPACK needed up to 240 000 products; the modes of 192 beams took 13 to 219 s."""
    solutions = count_solutions(monkeypatch)
    with skip_result_checks():  # which compute modes with shorter elements
        modes = bd.modes(chain(beams, 1e-4, joint=joint))
    assert len(solutions) < 450
    undamped = bd.modes(chain(beams, 1e-4, joint=joint), damping=False)
    assert_allclose(np.abs(modes.eigenvalues[:5]), np.abs(undamped.eigenvalues[:5]), rtol=1e-3)
    assert np.all(modes.damping_ratios > 0.0)


@pytest.mark.slow(reason="192 beams on a hinge")
def test_free_chain_of_welded_beams_has_one_free_motion():
    """The free motion dominates the inverse; ARPACK needed 240 000 products for this chain."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.03, height=0.0025, damping=1e-4)
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
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=height, damping=1e-3)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("strip", line, section, elements, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
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
    expected = bd.modes(damped_strip(32), n=3, damping=damping).eigenvalues
    monkeypatch.setattr(BlockKrylov, "converge", lambda *arguments: False)
    dense = bd.modes(damped_strip(32), n=3, damping=damping).eigenvalues
    assert_allclose(dense, expected, rtol=1e-6)
    monkeypatch.setattr(slow_motions, "_MAX_FALLBACK_COORDINATES", 0)
    with pytest.raises(bd.BeamdaeError, match=r"3 lowest modes were not found, .* request fewer"):
        bd.modes(damped_strip(32), n=3, damping=damping)


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
@pytest.mark.parametrize(
    # The number of solutions depends on rounding: 256 to 739 for heights within 1e-7 of 1 mm.
    ("height", "count", "most_solutions"),
    [(0.004, 100, 2250), (0.001, 12, 1000)],
)
def test_regression_modes_in_a_cluster_of_decays_need_few_solutions(
    height, count, most_solutions, monkeypatch
):
    """100 modes of 4 mm took 83 s (3420 solutions), and 12 modes of 1 mm failed after 50 s."""
    mech = damped_strip(150, height)
    undamped = np.abs(bd.modes(mech, n=12, damping=False).eigenvalues)
    solutions = count_solutions(monkeypatch)
    modes = find_modes(mech, n=count)
    assert len(solutions) < most_solutions
    # Kelvin-Voigt damping: l^2 + 1e-3 w^2 l + w^2 = 0.
    vibrations = undamped[undamped < 1e3]
    exact = -0.5e-3 * vibrations**2 + 1j * vibrations * np.sqrt(1.0 - (0.5e-3 * vibrations) ** 2)
    assert_allclose(modes.eigenvalues[: len(exact)], exact, rtol=1e-6)
    assert_allclose(modes.eigenvalues[len(exact) :], np.full(count - len(exact), -1e3), rtol=1e-6)
    # The shapes, also of equal eigenvalues, are different motions.
    singular = np.linalg.svd(modes.shapes / np.linalg.norm(modes.shapes, axis=1)[:, None])[1]
    assert singular[-1] > 1e-3


@pytest.mark.slow(reason="dense eigenvalues of 576 coordinates")
def test_regression_searches_in_nearly_the_whole_space_are_not_begun(monkeypatch):
    """The first space had as many vectors as the problem, at three times the dense work."""
    mech = damped_strip(64)
    solutions = count_solutions(monkeypatch)
    assert len(find_modes(mech, n=100).eigenvalues) == 100
    # 2409 without the search, most of them for the undamped modes, and 3765 with it.
    assert len(solutions) < 3000


def test_search_ends_if_dense_eigenvalues_take_less_time():
    exact = np.linspace(1.0, 2.0, 200)
    krylov = krylov_space(np.diag(exact), 20)
    assert not krylov.converge(lambda values: np.zeros(len(values)))
    assert krylov.size < 200


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_regression_overdamped_modes_are_as_many_as_requested(formulation):
    """Refined real eigenvalues with rounded imaginary parts below zero were lost: 11 of 20."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.01, damping=0.03)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, section, 30, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    modes = bd.modes(mech, n=20)
    assert set(modes.kinds) == {"decay"}
    # Eigenvalues accumulate at minus the ratio of stiffness to damping.
    assert_allclose(modes.eigenvalues, np.full(20, -1.0 / 0.03), rtol=1e-5)


def spinning_blades(damping, elements=20, has_motor=True):
    """Return two blades on a hub that turns freely, or that a motor turns at 20 rad/s."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(STEEL, width=0.03, height=0.01, damping=damping)
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
def test_regression_gyroscopic_modes_need_few_solutions(damping, monkeypatch):
    """False eigenvalues off the axis kept the space growing to all motions: 100 modes took 300 s.

    The error of the lowest mode, 5e-9, came from the shift in the middle of the modes.
    """
    expected = bd.modes(spinning_blades(damping), about=bd.rotation(20.0), n=None).eigenvalues
    solutions = count_solutions(monkeypatch)
    modes = find_modes(spinning_blades(damping), about=bd.rotation(20.0), n=20)
    assert len(solutions) < 500
    # On meshes of 19 to 21 elements, rounding errors of the complete solution are 2e-10 to 2e-9.
    assert_allclose(modes.eigenvalues, expected[:20], rtol=4e-9)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("damping", [0.0, 1e-5])
def test_regression_free_rotation_counts_as_one_mode(damping):
    """Both eigenvalues of its double zero counted, so that one mode was missing.

    The last mode is a conjugate pair, which counts as one.
    """
    mech = spinning_blades(damping, elements=15, has_motor=False)
    lin = linearize_about("modes", mech, bd.rotation(20.0), 0.0).linearized_equations
    more = solve_eigenproblem(lin, 20).values
    for count in (2, 5, 10):
        values = solve_eigenproblem(lin, count).values
        assert values[0] == 0.0
        assert np.all(values[1:].imag > 0.0)
        assert_allclose(values, more[:count], rtol=2e-9)


@pytest.mark.slow(reason="a fifth of a second")
def test_slow_decays_of_stiff_parts_with_strong_dampers_are_found():
    """The undamped modes do not contain them: x'' + c x' + k x = 0 with c >> sqrt(k) >> 1."""
    stiffness = np.linspace(1.0, 500.0, 300)
    damping = np.concatenate([np.zeros(290), np.geomspace(10.0, 1e5, 10)])
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 300), ca.SX.sym("v", 300)
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


@pytest.mark.slow(reason="192 beams")
def test_motion_that_rounding_hides_is_a_free_motion_damped_or_not():
    """The squared frequency of the lowest mode equals the rounding error of this stiffness."""
    mech = chain(192, 1e-4, "exact")
    damped, undamped = (bd.modes(mech, n=4, damping=damping) for damping in (True, False))
    assert damped.kinds == undamped.kinds
    assert_allclose(np.abs(damped.eigenvalues[1:]), np.abs(undamped.eigenvalues[1:]), rtol=1e-3)
