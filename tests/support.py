"""Element variants, small models and numpy functions of equations of motion, for the tests."""

from __future__ import annotations

import itertools
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import pytest

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations.sums import InputLayout, assemble_reactions
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators.ida import stepper
from beamdae.sundials.library import UnavailableError
from beamdae.symbolic.kernel_sums import evaluate_sum

# Stiffness, mass and damping of order one: differences then keep eight digits in every entry.
SOFT = bd.Material(E=60.0, nu=0.3, rho=1.3)


class Variant(NamedTuple):
    strain: str
    shape: str
    quadrature: str
    frame: str
    damping: float
    continuity: str = "cartesian"
    nodes: int = 4
    formulation: str = "floating frame"

    @property
    def section(self):
        return bd.Section(SOFT, area=0.9, second_moment=0.05, damping=self.damping)

    def beam(self, curve, elements=2, section=None, name="beam", **more):
        own = {"strain": self.strain, "continuity": self.continuity}
        return bd.Beam(
            name,
            curve,
            section or self.section,
            elements=elements,
            elements_shape=self.shape,
            nodes=self.nodes,
            quadrature=self.quadrature,
            frame=self.frame,
            formulation=self.formulation,
            **(own if self.formulation == "floating frame" else {}),
            **more,
        )

    def __str__(self):
        if self.formulation != "floating frame":
            return self.formulation
        damped = "damped" if self.damping else "undamped"
        shape = self.shape if self.continuity == "cartesian" else f"{self.shape}-local"
        nodes = "" if self.nodes == 4 else f"-{self.nodes}-nodes"
        return f"{self.strain}-{shape}-{self.quadrature}-{self.frame}-{damped}{nodes}"


VARIANTS = [
    Variant(*choice)
    for choice in itertools.product(
        ("nonlinear", "linear"),
        ("curved", "straight"),
        ("reduced", "full"),
        ("tangent", "chord"),
        (0.0, 0.03),
    )
]
# Continuity changes the constant operator of the mesh alone, which the frame shares.
VARIANTS += [
    Variant("nonlinear", "curved", "reduced", f, 0.03, "local") for f in ("tangent", "chord")
]
VARIANTS += [
    Variant(strain, "curved", "reduced", f, d)
    for strain in ("green", "exact")
    for f, d in (("tangent", 0.0), ("chord", 0.03))
]
# Fewer nodes are shorter sums of the same terms: a choice of the other settings shows them.
VARIANTS += [
    Variant("nonlinear", "curved", "reduced", "tangent", 0.03, nodes=3),
    Variant("nonlinear", "curved", "full", "chord", 0.03, nodes=3),
    Variant("nonlinear", "straight", "reduced", "chord", 0.0, nodes=3),
    Variant("linear", "curved", "reduced", "tangent", 0.0, nodes=3),
    Variant("green", "curved", "reduced", "tangent", 0.0, nodes=3),
    Variant("nonlinear", "straight", "reduced", "chord", 0.03, nodes=2),
    Variant("nonlinear", "straight", "full", "tangent", 0.03, nodes=2),
    Variant("linear", "straight", "reduced", "tangent", 0.0, nodes=2),
]
# Of the product of all settings: any four of the five come in each combination among those left.
_LATER = {v for k, v in enumerate(VARIANTS[:32]) if k.bit_count() % 2}
# For laws of what is made of elements: sums of statements, their forms, the start. These know an
# element by the size of its kernel and the operator of its mesh alone, and the kernels themselves
# are tested over all variants. They differ in everything that makes size and operator (shape,
# frame, continuity, nodes), and every strain, quadrature and damping is among them.
EXACT = Variant("exact", "curved", "reduced", "tangent", 0.03, formulation="exact")
FEW = [
    Variant("nonlinear", "curved", "reduced", "tangent", 0.03),
    Variant("linear", "straight", "full", "chord", 0.0),
    Variant("nonlinear", "curved", "reduced", "chord", 0.03, "local"),
    Variant("green", "curved", "reduced", "tangent", 0.0, nodes=3),
    EXACT,
]
# One of each way in which sections follow the coordinates: strain, quadrature and damping have no
# part in that.
MOTIONS = list({(v.shape, v.frame, v.continuity, v.nodes): v for v in VARIANTS}.values())
ARC = bd.Arc(radius=1.6, length=2.0, start=(0.3, -0.2), angle=0.4)


def every(variants, later=_LATER):
    """These variants as a parameter of a test, those of `later` in the slow run.

    By default that is one half of the product of all.
    """
    return pytest.mark.parametrize(
        "variant",
        [pytest.param(v, marks=[pytest.mark.slow] if v in later else []) for v in variants],
        ids=str,
    )


class Numeric:
    """Equations of motion with numpy arrays in and out, at the parameters of the model."""

    def __init__(self, mechanism, time=(0.0, 0.0)):
        self.mechanism = mechanism
        self.equations = bd.equations_of_motion(mechanism)
        self.time = np.array(time, float)
        self.n, self.m = self.equations.n, self.equations.m

    @cached_property
    def _start(self):
        return StateEvaluator(self.equations)

    def _given(self, q, v, a, lam, time):
        """(time, q, v, a, lam), what is left out of the start or of rest."""
        given = [self.time if time is None else time, self.equations.q0 if q is None else q]
        given += [np.zeros(self.n) if x is None else x for x in (v, a)]
        given += [np.zeros(self.m) if lam is None else lam]
        return [np.asarray(x, float) for x in given]

    def force(self, q=None, v=None, a=None, lam=None, time=None):
        """F."""
        return self._start.force(*self._given(q, v, a, lam, time)[:4])

    def _block(self, c, q, v, a, lam, time):
        nonzeros = self._start.saddle_matrix(*self._given(q, v, a, lam, time)[:4], c)
        return self._start.sums.block.matrix(nonzeros).toarray()

    def stiffness(self, q=None, v=None, a=None, lam=None, time=None):
        """dF/dq."""
        return self._block((1.0, 0.0, 0.0), q, v, a, lam, time)

    def damping(self, q=None, v=None, a=None, lam=None, time=None):
        """dF/dv."""
        return self._block((0.0, 1.0, 0.0), q, v, a, lam, time)

    def mass(self, q=None, v=None, a=None, lam=None, time=None):
        """dF/da."""
        return self._block((0.0, 0.0, 1.0), q, v, a, lam, time)

    def _balance(self, q=None, v=None, a=None, lam=None, time=None):
        """The row of the books at a state."""
        given = self._given(q, v, a, lam, time)
        return measures.balance_rows(self.equations)(*(x[None] for x in given))[0]

    def energies(self, *state, **more):
        """(kinetic, strain, gravity, power of the loads, dissipated power)."""
        return self._balance(*state, **more)[[0, 1, 2, 3, 5]]

    def driver_power(self, *state, **more):
        """Power of the drivers."""
        return self._balance(*state, **more)[4]

    @property
    def levels(self):
        """Three functions: g, g_dot and g_ddot."""
        return [partial(self._level, k) for k in range(3)]

    def _level(self, k, q=None, v=None, a=None, lam=None, time=None):
        return self._start.constraint_levels(*self._given(q, v, a, lam, time)[:4])[k]

    def constraint_matrix(self, q=None, v=None, a=None, lam=None, time=None):
        """G = dg/dq."""
        given = self._given(q, v, a, lam, time)
        return ConsistencySolver(self.equations).constraint_matrix(*given[:2]).toarray()

    def reaction(self, q=None, v=None, a=None, lam=None, time=None):
        """G^T lam."""
        time, q, _, _, lam = self._given(q, v, a, lam, time)
        plan = assemble_reactions(self.equations.structure, InputLayout(q=0, lam=self.n)).vector()
        total, result = plan.sum(False, self.equations.p), np.zeros(self.n)
        total.shared[:] = time
        evaluate_sum(total, np.concatenate([q, lam]), result)
        return result

    def _observed(self, q=None, v=None, a=None, lam=None, time=None):
        given = self._given(q, v, a, lam, time)
        return measures.ObservedRows(self.equations)(*(x[None] for x in given))[0]

    def observed(self, name, **state):
        """The columns of one observable."""
        first = 0
        values = self._observed(**state)
        for observable in self.equations.observables:
            count = len(observable.columns)
            if observable.name == name:
                return values[first : first + count]
            first += count
        raise KeyError(name)

    def index(self, name):
        return self.equations.q_names.index(name)


def slope(function, x, direction, step=1e-3):
    """Derivative of `function` at `x` along `direction`.

    Five points: exact for polynomials of degree four, which is what the strain energy is.
    """
    far, near = (
        np.asarray(function(x + k * step * direction)) - function(x - k * step * direction)
        for k in (2, 1)
    )
    return (8.0 * near - far) / (12.0 * step)


def differences(function, x):
    """Jacobian (or gradient) of `function` at `x`, one column a variable."""
    return np.stack([slope(function, x, d) for d in np.eye(len(x))], axis=-1)


def assert_derivative(jacobian, function, x, seed=0):
    """`jacobian` is that of `function` at `x`: compared along three random directions.

    The differences truncate at step^4 / 30 = 3e-14 and round at 1e-16 / step = 1e-13 of the terms
    in a row; 1e-9 leaves room for terms that cancel in it.
    """
    rng = np.random.default_rng(seed)
    for direction in rng.standard_normal((3, len(x))):
        terms = np.abs(jacobian) @ np.abs(direction)
        error = np.abs(jacobian @ direction - slope(function, x, direction))
        worst = int(np.argmax(error / (terms + 1.0)))
        assert error[worst] <= 1e-9 * (terms[worst] + 1.0), f"row {worst}: off by {error[worst]:g}"


def free_beam(variant, curve=ARC, elements=2, gravity=(0.0, 0.0), section=None):
    """A beam that no joint holds."""
    mech = bd.Mechanism(gravity=gravity)
    mech.add(variant.beam(curve, elements, section))
    return mech


def random_state(numeric, seed, size=0.15):
    """Coordinates near the drawing, velocities and accelerations of order one."""
    rng = np.random.default_rng(seed)
    q = numeric.equations.q0 + size * rng.standard_normal(numeric.n)
    return q, rng.standard_normal(numeric.n), rng.standard_normal(numeric.n)


def by_class(monkeypatch):
    """Have Ida run by scikit-sundae's class, as where its libraries cannot be had."""

    def unavailable(*arguments):
        raise UnavailableError("they cannot be had")

    monkeypatch.setattr(stepper, "CompiledIda", unavailable)
