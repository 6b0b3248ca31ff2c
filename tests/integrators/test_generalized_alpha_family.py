"""Newmark, HHT and generalized-alpha: parameters, orders, damping and adaptive steps."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from benchmarks.cases import AREVALO, PENDULUM, SLIDER_CRANK, pendulum, pendulum_motion
from governor import governor
from numpy.testing import assert_allclose
from quick_return import quick_return
from tolerance_cases import every_case, every_case_by_duration
from tolerances.cases import ALL

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators.alpha import step_loop
from beamdae.integrators.alpha.family import AlphaStart, family_parameters
from beamdae.integrators.alpha.jerk import JerkEquations, evaluate_normal_jerk
from beamdae.integrators.alpha.step_loop import FIRST_STEP, _accept_step, _reject_step
from beamdae.integrators.alpha.stepper import AdaptiveAlphaStepper, FixedAlphaStepper
from beamdae.integrators.alpha.workspace import Motion
from beamdae.native.loops import CompiledLoop
from beamdae.native.object_code import is_native_enabled
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR

MEMBERS = [
    *(("generalized-alpha", rho) for rho in (0.0, 0.3, 0.8, 1.0)),
    *(("hht", rho) for rho in (0.5, 0.6, 0.8, 1.0)),
    *(("newmark", rho) for rho in (0.0, 0.3, 0.8, 1.0)),
]
every_member = pytest.mark.parametrize(("family", "rho_inf"), MEMBERS)
every_formulation = pytest.mark.parametrize("formulation", ["index3", "stabilized-index2"])

ADAPTIVE = bd.GeneralizedAlpha(rtol=1e-4)
# Away from rest and from turning points, with reactions whose derivatives do not vanish.
SWING = pendulum(9.81, 0.4 * np.pi, 0.5).equations
SMOOTH = {
    "Arevalo": (AREVALO.equations, AREVALO.answer, 1.5),
    "pendulum": (SWING, lambda t: pendulum_motion(9.81, 0.4 * np.pi, 0.5, t), 2.0),
}
# Each case and each form once; the other pairs are slow tests.
every_smooth_case = pytest.mark.parametrize(
    ("case", "formulation"),
    [
        ("Arevalo", "index3"),
        ("pendulum", "stabilized-index2"),
        pytest.param("Arevalo", "stabilized-index2", marks=pytest.mark.slow),
        pytest.param("pendulum", "index3", marks=pytest.mark.slow),
    ],
)


def oscillator(omega):
    """x'' + omega^2 x = 0 from x = 1."""
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 1), ca.SX.sym("v", 1)
    return bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=-(omega**2) * q, q0=[1], v0=[0])


def pushed_particle(law):
    """Particle of 2 kg under a force along its rail."""
    mech = bd.Mechanism()
    particle = mech.add(bd.PointMass("particle", 2.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", particle.point, (law, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), particle.point))
    return mech


def settings(equations, family, rho_inf, formulation="index3", form=None):
    """Return arguments of steppers whose Newton iteration converges to rounding."""
    index3 = formulation == "index3"
    form = form or formulate_step(equations, not index3)
    start = AlphaStart(
        family_parameters(family, rho_inf), ConsistencySolver(equations), index3, cured=True
    )
    return form, start, equations.position_scales, 1e-10, "dense"


class March:
    """Takes steps of any length, regardless of their errors."""

    def __init__(self, equations, *member, **more):
        # Far away, because steps are halved near the end of an interval.
        far = 1e3
        self.steps = AdaptiveAlphaStepper(
            *settings(equations, *member, **more),
            first=1.0,
            largest=far,
            duration=far,
            tolerance=1e300,
        )
        time = np.array([0.0, 0.5])
        state = ConsistencySolver(equations).state(time, equations.q0, equations.v0)
        self.steps.begin(0.0, far, 0.5, state)
        self.rows = [np.concatenate([[0.0], *state])]
        self.n = equations.n

    def step(self, h):
        """Take one step and return its row."""
        self.steps._run.next_step = h
        self.rows.append(self.steps.advance(1)[0].copy())
        return self.rows[-1]

    @property
    def history(self):
        """Times and states of the steps."""
        t, *parts = np.split(np.array(self.rows), 1 + np.arange(4) * self.n, axis=1)
        return t[:, 0], State(*parts)


def steps_of(solution):
    return np.concatenate([np.diff(segment.t) for segment in solution.trajectory.intervals])


def errors(solution, answer):
    """Return the largest errors of q, v and lam over the output times."""
    exact = answer(solution.t)
    values = {"q": solution.q, "v": solution.v, "lam": solution.lam}
    return np.array([np.max(np.abs(values[name] - exact[name])) for name in ("q", "v", "lam")])


# The family -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"family": "newmarks"}, ["family", "'newmarks'", "did you mean 'newmark'"]),
        ({"family": None}, ["family", "None"]),
        ({"family": "hht", "rho_inf": 0.4}, ["rho_inf", "[0.5, 1]", "'hht'", "0.4"]),
        ({"family": "newmark", "rho_inf": 1.2}, ["rho_inf", "[0, 1]", "1.2"]),
        ({"rtol": 0.0}, ["rtol", "positive", "0"]),
        ({"rtol": 0.5}, ["rtol", "between 1e-14 and 0.1", "0.5"]),
        ({"rtol": np.nan}, ["rtol", "finite", "nan"]),
        ({"rtol": "tight"}, ["rtol", "number", "'tight'"]),
        ({"rtol": 1e-4, "family": "newmark"}, ["rtol", "second order", "'newmark'", "0.8"]),
        ({"rtol": 1e-4, "max_steps": 0}, ["max_steps", "at least 1", "0"]),
        ({"max_steps": 100}, ["max_steps", "requires rtol", "100"]),
    ],
)
def test_invalid_setting_is_named_with_its_value(settings, words):
    with pytest.raises(bd.BeamdaeError) as problem:
        bd.GeneralizedAlpha(**settings)
    message = str(problem.value)
    for word in ("GeneralizedAlpha", *words):
        assert word in message
    assert message.endswith(".")
    assert ". " not in message


def test_bounds_of_settings_are_valid():
    bd.GeneralizedAlpha(family="hht", rho_inf=0.5)
    bd.GeneralizedAlpha(family="newmark", rho_inf=0.0)
    bd.GeneralizedAlpha(family="newmark", rho_inf=1.0, rtol=0.1, max_steps=1)


def test_labels_contain_family_and_step_or_tolerance():
    assert bd.GeneralizedAlpha(step=1e-3).label == "GeneralizedAlpha(step=0.001)"
    assert bd.GeneralizedAlpha(family="hht").label == "GeneralizedAlpha(family=hht, step=0.001)"
    newmark = bd.GeneralizedAlpha(family="newmark", rho_inf=1.0, rtol=1e-4)
    assert newmark.label == "GeneralizedAlpha(family=newmark, rtol=0.0001)"


def test_reported_settings_contain_family_and_tolerances():
    settings_of_run = bd.simulate(pushed_particle(1.0), ADAPTIVE, 0.1).integrator
    assert (settings_of_run["family"], settings_of_run["rtol"]) == ("generalized-alpha", 1e-4)
    assert 0.0 < settings_of_run["local_tolerance"] < 1e-4
    settings_of_run = bd.simulate(
        pushed_particle(1.0), bd.GeneralizedAlpha(family="hht"), 0.1
    ).integrator
    assert (settings_of_run["family"], settings_of_run["rtol"]) == ("hht", None)


def test_families_share_members():
    # HHT with alpha = -1/3. At rho_inf = 1 all are the average-acceleration method, except for
    # the averages of generalized-alpha.
    assert_allclose(
        family_parameters("hht", 0.5), family_parameters("generalized-alpha", 0.5), atol=1e-15
    )
    assert_allclose(family_parameters("hht", 1.0), family_parameters("newmark", 1.0), atol=1e-15)
    assert_allclose(family_parameters("newmark", 1.0)[2:4], [0.5, 0.25], rtol=1e-15)


@cache
def step_of_an_oscillator(omega):
    """Return an oscillator and its step equations, the same for all members."""
    equations = oscillator(omega).equations
    return equations, formulate_step(equations, stabilized=False)


def amplification(family, rho_inf, h_omega):
    """Return the eigenvalues of the map of (q, h v, h^2 q'', h^2 a) over one step."""
    equations, step = step_of_an_oscillator(h_omega)
    steps = FixedAlphaStepper(*settings(equations, family, rho_inf, form=step), step=1.0)
    nothing = State(*np.zeros((3, 1)), np.zeros(0))
    columns = []
    for unit in np.eye(4):
        steps.begin(0.0, 1.0, 0.5, nothing)
        now = steps._run.current
        now.q[:], now.v[:], now.ddq[:], now.a[:] = unit
        steps.advance(1)
        columns.append(np.concatenate([now.q, now.v, now.ddq, now.a]))
    return np.linalg.eigvals(np.array(columns).T)


@every_member
def test_rho_inf_is_the_spectral_radius_at_infinite_frequency(family, rho_inf):
    # Rounding errors of double and triple eigenvalues have the powers 1/2 and 1/3.
    radius = np.max(np.abs(amplification(family, rho_inf, 1e5)))
    assert_allclose(radius, rho_inf, rtol=0.0, atol=2e-3)


@pytest.mark.slow(reason="half a second")
@every_member
def test_amplification_is_at_most_one(family, rho_inf):
    radii = [np.max(np.abs(amplification(family, rho_inf, x))) for x in np.logspace(-2, 4, 25)]
    assert max(radii) <= 1.0 + 1e-4


def test_hht_below_one_half_has_another_eigenvalue():
    # The reason for the bound on rho_inf: alpha_f / (1 - alpha_f) at infinity.
    assert np.max(np.abs(amplification("hht", 0.2, 1e5))) > 1.5


def remaining_energy(family, rho_inf):
    """Return the remaining share of energy after ten periods of twenty steps."""
    omega = 2.0 * np.pi
    integrator = bd.GeneralizedAlpha(step=0.05, rho_inf=rho_inf, family=family, start="plain")
    solution = bd.simulate(oscillator(omega), integrator, 10.0, 0.05)
    return float(solution.v[-1, 0] ** 2 + (omega * solution.q[-1, 0]) ** 2) / omega**2


@pytest.mark.parametrize("family", ["generalized-alpha", "hht", "newmark"])
def test_dissipation_falls_with_rho_inf(family):
    energies = [remaining_energy(family, rho) for rho in (0.5, 0.7, 0.9, 1.0)]
    assert np.all(np.diff(energies) > 0.0)
    assert_allclose(energies[-1], 1.0, rtol=0.0, atol=1e-9)


def test_generalized_alpha_damps_resolved_motion_less_than_newmark():
    # The purpose of the averages: less damping at low frequencies for the same at infinity.
    energies = [remaining_energy(family, 0.8) for family in ("generalized-alpha", "hht", "newmark")]
    assert energies[0] > energies[1] > energies[2]


def observed_orders(case, steps, **settings):
    equations, answer, t_end = SMOOTH[case]
    errors_by_step = []
    for k in (steps, 2 * steps):
        integrator = bd.GeneralizedAlpha(step=t_end / k, newton_tolerance=1e-10, **settings)
        errors_by_step.append(errors(bd.simulate(equations, integrator, t_end, t_end / k), answer))
    return np.log2(errors_by_step[0] / errors_by_step[1])


@every_smooth_case
@pytest.mark.parametrize("rho_inf", [0.5, 0.8])
def test_hht_is_of_second_order(case, formulation, rho_inf):
    orders = observed_orders(case, 800, family="hht", rho_inf=rho_inf, formulation=formulation)
    assert_allclose(orders, 2.0, rtol=0.0, atol=0.1)


@every_smooth_case
def test_damped_newmark_is_of_first_order(case, formulation):
    orders = observed_orders(case, 800, family="newmark", rho_inf=0.8, formulation=formulation)
    assert_allclose(orders, 1.0, rtol=0.0, atol=0.1)


@pytest.mark.parametrize("family", ["generalized-alpha", "hht", "newmark"])
def test_without_damping_every_family_is_of_second_order(family):
    # Without constraints, because their multipliers would not be damped.
    errors_by_step = []
    for step in (0.01, 0.005):
        integrator = bd.GeneralizedAlpha(step=step, rho_inf=1.0, family=family)
        solution = bd.simulate(oscillator(3.0), integrator, 2.0, 0.01)
        errors_by_step.append(np.max(np.abs(solution.q[:, 0] - np.cos(3.0 * solution.t))))
    assert_allclose(np.log2(errors_by_step[0] / errors_by_step[1]), 2.0, rtol=0.0, atol=0.02)


@every_formulation
@pytest.mark.parametrize("family", ["generalized-alpha", "hht", "newmark"])
def test_the_cured_start_keeps_multipliers_from_ringing(family, formulation):
    ringing = []
    for start in ("cured", "plain"):
        integrator = bd.GeneralizedAlpha(
            step=2e-3, rho_inf=0.8, family=family, formulation=formulation, start=start
        )
        lam = bd.simulate(SWING, integrator, 0.02, 2e-3).lam[1:, 0]
        # Fourth differences: the part that alternates from step to step.
        ringing.append(np.max(np.abs(np.diff(lam, 4))))
    assert ringing[0] < 0.2 * ringing[1]


# Last q and lam after 100 steps, computed by the code before the loop was compiled.
STORED = {
    ("index3", 0.0): (
        *(1.315419342290798, 1.001492487381957, -0.5049732933349123),
        *(1.0547693432488605, -0.5538202829050521),
    ),
    ("index3", 0.8): (
        *(1.3154201814557676, 1.0014920228179998, -0.5049734144411417),
        *(1.0548058379934393, -0.553819680469192),
    ),
    ("stabilized-index2", 0.0): (
        *(1.315419207679227, 1.0014925619032904, -0.5049732739080647),
        *(1.0547884851776257, -0.5538216514632514),
    ),
    ("stabilized-index2", 0.8): (
        *(1.3154201452686043, 1.001492042851307, -0.5049734092187077),
        *(1.054810918704733, -0.5538202569963281),
    ),
}


@pytest.mark.parametrize(("formulation", "rho_inf"), STORED)
def test_fixed_steps_match_stored_values(formulation, rho_inf):
    integrator = bd.GeneralizedAlpha(1e-2, rho_inf, formulation, newton_tolerance=1e-12)
    solution = bd.simulate(SLIDER_CRANK.equations, integrator, 1.0)
    last = solution.trajectory.intervals[0].state
    assert solution.statistics.steps == 100
    assert solution.statistics.rejected_steps == 0
    # Rounding errors of the iteration accumulate in the multipliers of the index-3 form.
    values = [*last.q[-1], *last.lam[-1]]
    assert_allclose(values, STORED[formulation, rho_inf], rtol=2e-8)


# Step changes ---------------------------------------------------------------------------------


def step_change_errors(case, steps, family, formulation):
    """Return the largest errors of q, v and lam if every step changes by a factor of two."""
    equations, answer, t_end = SMOOTH[case]
    h = np.where(np.arange(steps) % 2, 2.0, 1.0)
    h *= t_end / np.sum(h)
    march = March(equations, family, 0.8, formulation)
    for step in h:
        march.step(step)
    t, states = march.history
    exact = answer(t)
    pairs = ((states.q, exact["q"]), (states.v, exact["v"]), (states.lam, exact["lam"]))
    return np.array([np.max(np.abs(x - y)) for x, y in pairs])


@every_smooth_case
@pytest.mark.parametrize("family", ["generalized-alpha", "hht"])
def test_second_order_with_a_step_change_at_every_step(case, family, formulation):
    # Without the conversion in `step_loop._change_step` the orders of q and v lie between 1 and 2,
    # and that of lam is 1. The multipliers converge to second order from above.
    coarse, fine = (step_change_errors(case, steps, family, formulation) for steps in (800, 1600))
    orders = np.log2(coarse / fine)
    assert_allclose(orders[:2], 2.0, rtol=0.0, atol=0.1)
    assert 1.9 < orders[2] < 2.6


def test_step_change_does_not_disturb_the_multipliers(monkeypatch):
    """One step change, long after the start."""
    equations, answer, _ = SMOOTH["pendulum"]
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    largest = []
    for resume in (step_loop._change_step, keep_motion):
        monkeypatch.setattr(step_loop, "_change_step", resume)
        march = March(equations, "generalized-alpha", 0.8)
        for k in range(150):
            march.step(2e-3 if k < 100 else 1e-3)
        t, states = march.history
        largest.append(np.max(np.abs(states.lam - answer(t)["lam"])[101:]))
    assert largest[0] < 0.02 * largest[1]


def keep_motion(run, h):
    step_loop._copy_motion(run.current, run.accepted_motion)
    step_loop.set_step(run, h)
    return DONE


def test_unchanged_step_is_not_converted(monkeypatch):
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    new_steps, resume = [], step_loop._change_step

    def record_change(run, h):
        new_steps.append(h)
        return resume(run, h)

    monkeypatch.setattr(step_loop, "_change_step", record_change)
    march = March(SWING, "generalized-alpha", 0.8)
    for h in (1e-3, 1e-3 * (1.0 + 1e-12), 1e-3):
        march.step(h)
    assert new_steps == []
    march.step(2e-3)
    assert new_steps == [2e-3]


@pytest.mark.parametrize("equations", [PENDULUM.equations, SLIDER_CRANK.equations])
def test_loop_jerk_equals_start_jerk(equations):
    random = np.random.default_rng(0)
    time, delta = np.array([0.1, 0.5]), 1e-5
    q = equations.q0 + 1e-2 * random.normal(size=equations.n)
    v, a = random.normal(size=(2, equations.n))
    state = State(q, v, a, np.zeros(equations.m))
    expected = ConsistencySolver(equations).evaluate_normal_jerk(time, state, delta)
    jerk = JerkEquations.from_equations(equations).buffers(native=False)
    at = Motion(q, v, a, a, state.lam)
    assert evaluate_normal_jerk(jerk, *time, at, delta) == DONE
    # Rounding of a difference over 2 delta.
    assert_allclose(
        jerk.unknowns[: equations.n], expected, rtol=0.0, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.skipif(not is_native_enabled(), reason="without machine code")
def test_step_changes_do_not_leave_the_loop(monkeypatch):
    calls, call = [], CompiledLoop.__call__

    def count_call(loop):
        code = call(loop)
        calls.append(code)
        return code

    monkeypatch.setattr(CompiledLoop, "__call__", count_call)
    equations = SLIDER_CRANK.equations
    # With stated scales there is no pilot run.
    equations = replace(equations, scales=equations.position_scales)
    solution = bd.simulate(equations, replace(ADAPTIVE, rtol=1e-6), 4.0)
    assert solution.status.success
    assert np.count_nonzero(np.abs(np.diff(steps_of(solution))) > 1e-9) >= 5
    assert calls.count(FIRST_STEP) == 1
    # Two matrices, with two pivot orders each.
    assert calls.count(NEW_PIVOTS) <= 4
    assert len(calls) <= 6 + solution.statistics.steps // 64


def test_adaptive_steps_match_interpreted_steps(monkeypatch):
    integrator = replace(ADAPTIVE, rtol=1e-4)
    compiled = bd.simulate(PENDULUM.equations, integrator, 0.3)
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    plain = bd.simulate(PENDULUM.equations, integrator, 0.3)
    # Rounding; steps vary with the power 1/3 of their errors.
    assert_allclose(steps_of(compiled), steps_of(plain), rtol=1e-6)


# Adaptive steps -------------------------------------------------------------------------------


@every_case_by_duration
def test_error_falls_with_rtol_and_stays_in_bounds(case):
    rtols = np.array([1e-3, 1e-4])
    solutions = [case.run(bd.GeneralizedAlpha(rtol=rtol)) for rtol in rtols]
    assert all(s.status.success for s in solutions)
    max_errors = np.array([case.errors(s).max() for s in solutions])
    assert max_errors[1] < max_errors[0]
    assert np.all(max_errors <= case.bound * rtols)


@pytest.mark.slow(reason="tens of thousands of steps")
def test_regression_small_axial_deformations_do_not_stop_adaptive_steps():
    """With scales as small as the deformations, the steps fell to 1e-14 s and the run failed."""
    (case,) = (case for case in ALL if case.name == "tuning_fork")
    solution = case.run(bd.GeneralizedAlpha(rtol=1e-5))
    assert solution.status.success
    assert case.errors(solution).max() < case.bound * 1e-5


@pytest.mark.slow(reason="an undamped beam at 1e-5 takes tens of thousands of steps")
@every_case
def test_error_keeps_falling_at_a_tight_tolerance(case):
    rtols = np.array([1e-4, 1e-5])
    max_errors = np.array(
        [case.errors(case.run(bd.GeneralizedAlpha(rtol=rtol))).max() for rtol in rtols]
    )
    assert max_errors[1] < max_errors[0]
    assert np.all(max_errors <= case.bound * rtols)


@pytest.mark.slow(reason="every case with seven members")
@every_case
@pytest.mark.parametrize(
    "settings",
    [
        {"rho_inf": 0.0},
        {"rho_inf": 0.5},
        {"rho_inf": 0.95},
        {"family": "hht", "rho_inf": 0.5},
        {"family": "hht", "rho_inf": 0.8},
        {"formulation": "stabilized-index2"},
        {"step": 1.0},
    ],
    ids=str,
)
def test_error_bound_for_all_members_and_first_steps(case, settings):
    rtols = np.array([1e-3, 1e-4])
    solutions = [case.run(bd.GeneralizedAlpha(rtol=rtol, **settings)) for rtol in rtols]
    max_errors = np.array([case.errors(s).max() for s in solutions])
    assert np.all(max_errors <= 100.0 * rtols)


@every_smooth_case
@pytest.mark.parametrize(("family", "rho_inf"), [("generalized-alpha", 0.8), ("hht", 0.6)])
def test_adaptive_steps_are_second_order(case, family, rho_inf, formulation):
    equations, answer, t_end = SMOOTH[case]
    errors_by_rtol, steps = [], []
    for rtol in (1e-5, 1e-6):
        integrator = replace(
            ADAPTIVE,
            rtol=rtol,
            family=family,
            rho_inf=rho_inf,
            formulation=formulation,
            newton_tolerance=1e-10,
        )
        solution = bd.simulate(equations, integrator, t_end, t_end / 200)
        errors_by_rtol.append(errors(solution, answer))
        steps.append(solution.statistics.steps)
    # Multipliers of Arevalo's problem only: they are not in the error test, which lets the step
    # of a pendulum grow where the jerk passes zero, at the cost of their error there.
    components = slice(0, 3 if case == "Arevalo" else 2)
    ratio = (errors_by_rtol[0] / errors_by_rtol[1])[components]
    # Errors proportional to rtol with steps proportional to its root.
    assert_allclose(ratio, 10.0, rtol=0.15)
    assert_allclose(np.log(ratio) / np.log(steps[1] / steps[0]), 2.0, rtol=0.0, atol=0.2)
    assert np.all(errors_by_rtol[1] < errors_by_rtol[0])


def test_steps_follow_the_motion():
    # A push of 0.1 s in a run of 5 s, without a breakpoint.
    def push(t):
        return 100.0 * np.exp(-(((t - 1.0) / 0.1) ** 2))

    solution = bd.simulate(pushed_particle(push), bd.GeneralizedAlpha(rtol=1e-5), 5.0)
    (segment,) = solution.trajectory.intervals
    h, t = np.diff(segment.t), segment.t[1:]
    during = h[(t > 0.9) & (t < 1.1)]
    # The longest step is a twentieth of the run; the last steps are equal.
    assert_allclose(np.max(h[t > 2.0]), 0.25, rtol=0.1)
    assert np.max(during) < 0.01
    assert_allclose(solution.v[-1, 0], 5.0 * np.sqrt(np.pi), rtol=1e-3)
    # Short steps during the push only, not in the whole run.
    assert solution.statistics.steps < 0.2 * 5.0 / np.mean(during)


def test_steps_are_at_most_a_quarter_of_the_law_time_scale():
    solution = bd.simulate(pushed_particle(bd.sine(1.0, 2.0)), bd.GeneralizedAlpha(rtol=0.1), 5.0)
    equations = bd.equations_of_motion(pushed_particle(bd.sine(1.0, 2.0)))
    longest = np.max(steps_of(solution))
    assert longest <= 0.25 * equations.time_scale * (1.0 + 1e-12)
    assert longest > 0.2 * equations.time_scale


@pytest.mark.parametrize(
    ("errors_seen", "step"),
    [
        # After the eighth step the largest error decides: factor 0.8 error^(-1/3).
        ([1e-3] * 7, 1.0),
        ([1e-3] * 8, 2.0),
        ([0.1] * 8, 0.8 * 10.0 ** (1.0 / 3.0)),
        ([1e-3] * 7 + [0.4], 1.0),
        ([0.4] + [1e-3] * 7, 1.0),
        ([0.0] * 24, 5.0),
    ],
)
def test_step_grows_by_at_least_a_fifth(errors_seen, step):
    size = SimpleNamespace(next_step=1.0, max_step=5.0, steps_checked=0, max_error=0.0)
    for size.error in errors_seen:
        _accept_step(size, size.next_step)
    assert_allclose(size.next_step, step, rtol=1e-12)


@pytest.mark.parametrize(
    ("error", "step"),
    [(1.001, 0.8), (8.0, 0.4), (1e9, 0.2), (1e200, 0.2), (np.inf, 0.5), (np.nan, 0.5)],
)
def test_rejected_step_shrinks_by_its_error(error, step):
    size = SimpleNamespace(next_step=1.0, steps_checked=0, max_error=0.0, error=error)
    _reject_step(size, 1.0)
    assert_allclose(size.next_step, step, rtol=1e-3)


def test_factors_are_reused_while_the_step_is_constant():
    solution = bd.simulate(oscillator(2.0), ADAPTIVE, 20.0)
    h = steps_of(solution)
    changes = np.count_nonzero(np.abs(np.diff(h) / h[1:]) > 1e-6)
    s = solution.statistics
    # A linear system: one factorization for each step length, rejected ones included.
    assert s.factorizations <= 1 + changes + s.rejected_steps
    assert s.factorizations < 0.1 * s.steps


def test_factorizations_for_the_jerk_are_counted():
    equations, _, t_end = SMOOTH["pendulum"]
    solution = bd.simulate(equations, ADAPTIVE, t_end)
    h, s = steps_of(solution), solution.statistics
    changes = np.count_nonzero(np.abs(np.diff(h) / h[1:]) > 1e-6)
    # Each change of the step requires one factorization and one solution for the jerk.
    assert s.factorizations - s.jacobian_calls >= changes > 0
    assert s.solves - s.residual_calls == s.factorizations - s.jacobian_calls


def test_rejected_steps_are_counted_but_not_returned():
    equations, answer, t_end = SMOOTH["pendulum"]
    solution = bd.simulate(equations, replace(ADAPTIVE, step=1.0), t_end)
    s = solution.statistics
    # From a twentieth of the run to a two-hundredth.
    assert s.rejected_steps >= 3
    assert s.steps == len(steps_of(solution))
    assert errors(solution, answer)[0] < 100.0 * 1e-4


def test_breakpoints_are_hit_and_followed_by_the_first_step():
    solution = bd.simulate(pushed_particle(bd.piecewise((0.1234567, 5.0), 0.0)), ADAPTIVE, 1.0)
    first, second = (segment.t for segment in solution.trajectory.intervals)
    assert (first[0], first[-1], second[0], second[-1]) == (0.0, 0.1234567, 0.1234567, 1.0)
    assert_allclose([first[1], second[1] - second[0]], 1e-3, rtol=1e-9)
    assert_allclose(solution.v[-1, 0], 2.5 * 0.1234567, rtol=1e-12)


def test_the_last_two_steps_before_a_breakpoint_are_equal():
    # The remainder is split into two equal steps instead of a tiny one.
    solution = bd.simulate(pushed_particle(bd.piecewise((0.12345, 5.0), 0.0)), ADAPTIVE, 1.0)
    for segment in solution.trajectory.intervals:
        h = np.diff(segment.t)
        assert_allclose(h[-1], h[-2], rtol=1e-6)
        assert np.min(h) > 0.9e-3


def test_steps_begin_within_an_interval_shorter_than_the_first_step():
    law = bd.piecewise((0.5, 0.0), (0.5002, 5.0), 0.0)
    solution = bd.simulate(pushed_particle(law), ADAPTIVE, 1.0)
    times = solution.trajectory.intervals[1].t
    assert_allclose(times[[0, -1]], [0.5, 0.5002], rtol=0.0, atol=0.0)
    assert len(times) > 2


def test_regression_pulse_that_vanishes_at_both_ends_is_not_stepped_over():
    """The first step ended at the end of the pulse, so the particle stayed at rest."""
    pulse = bd.piecewise((1e-3, lambda t: 1.0 - np.cos(2e3 * np.pi * t)), 0.0)
    solution = bd.simulate(pushed_particle(pulse), ADAPTIVE, 1e-2)
    # Impulse over mass.
    assert_allclose(solution.v[-1, 0], 5e-4, rtol=1e-2)


# Failures -------------------------------------------------------------------------------------


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_steps_approach_the_singularity_of_a_law(rtol):
    law = pushed_particle(lambda t: np.sqrt(0.5 - t))
    solution = bd.simulate(law, replace(ADAPTIVE, rtol=rtol), 1.0, 1e-3)
    assert not solution.status.success
    for words in ("t = 0.5 s", "not finite", "at a step of"):
        assert words in solution.status.sentence
    assert_allclose(solution.trajectory.end, 0.5, rtol=0.0, atol=1e-8)
    exact = (0.5**1.5 - (0.5 - solution.t) ** 1.5) / 3.0
    assert_allclose(solution.v[:, 0], exact, rtol=0.0, atol=1e-3)


def test_unbounded_force_fails_the_run():
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 1), ca.SX.sym("v", 1)
    force = 1.0 / (0.5 - t) ** 2
    system = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1], force=[force], constraints=[], q0=[0], v0=[0]
    )
    solution = bd.simulate(system, replace(ADAPTIVE, rtol=1e-3), 1.0)
    assert not solution.status.success
    for words in ("error test failed", "at a step of", "loosen rtol"):
        assert words in solution.status.sentence
    # Steps are at least 1e-12 of the run.
    assert_allclose(solution.trajectory.end, 0.5, rtol=0.0, atol=1e-5)
    assert np.all(np.isfinite(solution.q))


@every_formulation
def test_newton_failure_shrinks_the_step(formulation):
    # The joint cannot be closed once the center has moved two radii away.
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    reach = ca.vertcat(ca.dot(q, q) - 1.0, q[0] - t)
    torn = bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1, 1], force=[0, 0], constraints=reach, q0=[0, 1], v0=[1, 0]
    )
    integrator = replace(ADAPTIVE, step=2.0, formulation=formulation)
    solution = bd.simulate(torn, integrator, 10.0)
    assert not solution.status.success
    assert "t = 1 s" in solution.status.sentence
    assert "use a smaller step" not in solution.status.sentence
    assert solution.statistics.rejected_steps > 3
    assert_allclose(solution.trajectory.end, 1.0, rtol=0.0, atol=1e-4)
    assert np.all(np.isfinite(solution.q))


def test_dependent_joints_fail_the_run(monkeypatch):
    def singular(*_):
        return SINGULAR

    def raise_no_inertia(self, time, q, v, stiff_time=0.0):
        raise bd.BeamdaeError("rail: this coordinate has no inertia at t = 0.1.")

    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    monkeypatch.setattr(step_loop, "evaluate_normal_jerk", singular)
    solution = bd.simulate(PENDULUM.equations, ADAPTIVE, 2.0)
    assert not solution.status.success
    assert "the constraints have become dependent" in solution.status.sentence
    assert f"stopped at t = {solution.trajectory.end:.6g} s" in solution.status.sentence
    acceleration = ConsistencySolver.acceleration

    def fail_later(self, time, *arguments, **keywords):
        return (raise_no_inertia if time[0] > 0.0 else acceleration)(
            self, time, *arguments, **keywords
        )

    monkeypatch.setattr(ConsistencySolver, "acceleration", fail_later)
    solution = bd.simulate(PENDULUM.equations, ADAPTIVE, 2.0)
    assert "rail: this coordinate has no inertia" in solution.status.sentence


@pytest.mark.slow(reason="a fifth of a second")
def test_max_steps_limits_the_run():
    law = bd.piecewise(*((0.1 * k, float(k)) for k in range(1, 10)), 0.0)
    whole = bd.simulate(pushed_particle(law), ADAPTIVE, 1.0)
    assert whole.status.success
    steps = whole.statistics.steps
    assert bd.simulate(pushed_particle(law), replace(ADAPTIVE, max_steps=steps), 1.0).status.success
    # The limit applies to the run, not to a segment.
    limited = bd.simulate(pushed_particle(law), replace(ADAPTIVE, max_steps=steps - 1), 1.0)
    assert not limited.status.success
    assert f"reached max_steps = {steps - 1}" in limited.status.sentence
    assert limited.statistics.steps == steps - 1
    assert 0.9 < limited.trajectory.end < 1.0


def test_time_limit_limits_the_run():
    # With `max_steps`, the run does not end early because it needs too many steps.
    integrator = replace(ADAPTIVE, rtol=1e-6, time_limit=0.05, max_steps=10**9)
    solution = bd.simulate(PENDULUM.equations, integrator, 1000.0, 0.1)
    assert not solution.status.success
    assert "time limit of 0.05 s" in solution.status.sentence
    assert 0.0 < solution.trajectory.end < 1000.0


def test_interrupted_run_keeps_its_steps():
    def interrupt(t):
        if t > 0.3:
            raise KeyboardInterrupt

    integrator = replace(ADAPTIVE, rtol=1e-6)
    with pytest.raises(bd.Interrupted) as caught:
        bd.simulate(PENDULUM.equations, integrator, 4.0, 0.01, progress=interrupt)
    solution = caught.value.solution
    assert not solution.status.success
    assert "interrupted at t = " in solution.status.sentence
    assert 0.3 < solution.trajectory.end < 4.0


def test_runs_are_independent():
    first = bd.simulate(SLIDER_CRANK.equations, ADAPTIVE, 1.0, 0.1)
    bd.simulate(PENDULUM.equations, ADAPTIVE, 0.5)
    again = bd.simulate(SLIDER_CRANK.equations, ADAPTIVE, 1.0, 0.1)
    assert_allclose(again.q, first.q, rtol=0.0, atol=0.0)
    assert_allclose(again.lam, first.lam, rtol=0.0, atol=0.0)


@pytest.mark.slow(reason="half a second")
def test_regression_reactions_with_friction_converge_in_driven_mechanisms():
    """The joints determine all positions; reactions were up to 9e-4 of their maximum off."""
    loose, tight = (
        bd.simulate(quick_return, bd.GeneralizedAlpha(1e-3, newton_tolerance=x), t_end=1.6).lam
        for x in (1e-6, 1e-10)
    )
    assert_allclose(loose, tight, rtol=0.0, atol=1e-5 * np.max(np.abs(tight)))


@pytest.mark.parametrize(("model", "tolerance"), [(governor, 1e-9), (quick_return, 1e-6)])
def test_regression_rounding_errors_of_short_steps_do_not_end_runs(model, tolerance):
    """Corrections stopped decreasing above the limit, and Newton's iteration failed."""
    method = bd.GeneralizedAlpha(1e-6, newton_tolerance=tolerance)
    run = bd.simulate(model, method, t_end=1e-3)
    assert run.status.success, run.status


def test_regression_tiny_reactions_with_friction_do_not_end_runs():
    """At the start of a Gaussian pulse, their reciprocals overflowed: "residual is not finite"."""
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody("rod", 1.0, 1.0 / 12.0, center=(0.5, 0.0)))
    pin = mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    mech.add(bd.Friction("rubbing", pin, 0.3, friction_speed=0.01, radius=0.01))

    def pulse(t):
        return 10.0 * np.exp(-(((t - 0.03) / 0.001) ** 2))

    mech.add(bd.Force("push", rod.at(1.0, 0.0), (0.0, pulse)))
    run = bd.simulate(mech, bd.GeneralizedAlpha(1e-4), t_end=0.04)
    assert run.status.success, run.status
    assert 4.0 < np.max(np.abs(run.lam)) < 6.0
