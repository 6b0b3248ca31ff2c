"""Branch and limit points under follower loads, and the paths that branch off."""

import numpy as np
import pytest
from mechanisms import clamped_beam, lee_frame, rectangle
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from test_slender_structures import FORMULATIONS

import beamdae as bd

SECTION = rectangle(1e-3)


def column(share=0.25, **options):
    """Return a cantilever under EI / L^2, of which `share` follows the tip."""
    options = options or {"formulation": "exact"}
    mech, beam = clamped_beam(SECTION, 8, (0.0, 1.0), name="column", **options)
    mech.add(bd.Force("dead", beam.end, (0.0, -(1.0 - share) * SECTION.EI)))
    mech.add(bd.Force("follower", beam.end, (0.0, -share * SECTION.EI), axes="body"))
    mech.observe("tip", beam.end)
    return mech


def divergence_load(share):
    """Return P L^2 / EI where cos(L sqrt(P / EI)) = -share / (1 - share)."""
    return np.arccos(-share / (1.0 - share)) ** 2


def elastica_tip(share, load):
    """Return the lateral displacement of the tip of the inextensible column by shooting."""

    def integrate(end):
        # Angle from the vertical, its derivative and the displacement, from the tip to the clamp.
        sideways = share * np.sin(end)
        downwards = 1.0 - share + share * np.cos(end)

        def rates(_, y):
            moment = load * (downwards * np.sin(y[0]) - sideways * np.cos(y[0]))
            return [-y[1], moment, np.sin(y[0])]

        return solve_ivp(rates, (0.0, 1.0), [end, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]

    return integrate(brentq(lambda end: integrate(end)[0], 0.05, 2.5))[2]


@pytest.mark.slow(reason="one second")
@FORMULATIONS
@pytest.mark.parametrize("share", [0.1, 0.25, 0.45])
def test_buckled_path_of_a_column_under_a_partly_following_force(share, options):
    expected = divergence_load(share)
    tips = []
    for side in (1, -1):
        path = bd.equilibrium(column(share, **options), to=1.15 * expected, switch=side)
        assert path.status.success
        (point,) = path.critical
        assert point.kind == "branch point"
        # Compression and shear.
        assert point.factor == pytest.approx(expected, rel=3e-6)
        assert path.unstable[-1] == 0
        tips.append(path.columns["tip.x [m]"][-1])
    assert tips[0] == pytest.approx(-tips[1], rel=1e-9)
    assert abs(tips[0]) == pytest.approx(elastica_tip(share, 1.15 * expected), rel=2e-5)


@pytest.mark.slow(reason="several seconds")
def test_divergence_ends_where_half_of_the_force_follows():
    # The two lowest divergence loads merge at pi^2; beyond, the column flutters.
    @bd.model(t_end=1.0)
    def model(share=0.45):
        return column(share)

    by, to = ("share", "load"), 1.2 * divergence_load(0.45)
    curve = bd.boundary(model, "branch point", by, (0.45, 0.52), step=0.4, to=to)
    assert curve.status.success
    (turning,) = curve.special
    assert turning.kind == "turning point"
    assert turning.value == pytest.approx(0.5, rel=1e-5)
    assert turning.factor == pytest.approx(np.pi**2, rel=1e-5)
    assert_allclose(np.cos(np.sqrt(curve.factors)), -curve.values / (1.0 - curve.values), atol=1e-5)


@pytest.mark.slow(reason="several seconds")
@FORMULATIONS
def test_limit_points_of_a_frame_under_a_follower_force(options):
    # Lee's frame with a follower force: the tangent is not symmetric.
    path = bd.equilibrium(lee_frame(5, "body", **options), to=60.0, control="arc length", step=0.2)
    assert path.status.success
    assert [point.kind for point in path.critical] == ["limit point"] * 2
    # Values of 16 elements; those of 4 elements differ by 5e-5.
    assert_allclose([point.factor for point in path.critical], [35.392, -13.793], rtol=1e-4)
    # The load factor has its extrema there.
    rows = [point.row for point in path.critical]
    assert_allclose(path.factors[rows, 0], [path.factors[: rows[1], 0].max(), path.factors.min()])
