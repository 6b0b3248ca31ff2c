"""Choice between Ida and Radau by Auto."""

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose

import beamdae as bd


@pytest.mark.parametrize(
    ("damping", "rtol", "method"),
    [(0.0, 1e-4, "Ida"), (0.0, 1e-6, "Radau"), (1e-3, 1e-6, "Ida")],
)
def test_radau_takes_over_where_lightly_damped_modes_meet_a_tight_tolerance(damping, rtol, method):
    mech = hub_beam(damping=damping, elements=2)
    auto = bd.simulate(mech, bd.Auto(rtol, max_steps=20), t_end=0.5)
    assert auto.integrator["method"] == method
    assert auto.integrator["integrator"] == "Auto"
    assert auto.statistics.steps == 20


def test_auto_repeats_the_run_of_the_chosen_integrator():
    mech = hub_beam(elements=2)
    auto, ida = (bd.simulate(mech, one, t_end=0.5) for one in (bd.Auto(1e-4), bd.Ida(1e-4)))
    assert_allclose(auto.q, ida.q, rtol=0.0, atol=0.0)
    assert auto.integrator["amplitudes"] == ida.integrator["amplitudes"]


def test_ida_notes_where_radau_is_cheaper():
    mech = hub_beam(elements=2)
    notes = [
        bd.simulate(mech, bd.Ida(rtol, max_steps=5), t_end=0.5).integrator.get("note", "")
        for rtol in (1e-4, 1e-6)
    ]
    assert notes[0] == ""
    assert "use Radau(rtol) or Auto(rtol)" in notes[1]


def test_auto_is_the_default_integrator():
    solution = bd.simulate(hub_beam, t_end=0.1)
    assert solution.made_by == bd.Auto()
    assert np.isfinite(solution.q).all()


def test_invalid_tolerance_is_rejected():
    with pytest.raises(bd.BeamdaeError, match="Auto: rtol must lie"):
        bd.Auto(0.5)


def test_note_on_radau_requires_automatic_order():
    solution = bd.simulate(hub_beam(elements=2), bd.Ida(1e-7, max_order=1, max_steps=5), t_end=2.0)
    assert solution.integrator["max_order"] == 1
    assert "note" not in solution.integrator
