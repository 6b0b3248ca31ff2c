"""Results of analyses and functions can be copied and sent to other processes."""

import copy
import pickle

import cloudpickle
import numpy as np
import pytest
from mechanisms import free_ball, hinged, symbols

import beamdae as bd
from beamdae.function_pickler import pickle_with_functions

METHOD = bd.GeneralizedAlpha(step=5e-3)


@bd.model(t_end=0.05)
def pendulum(mass=2.0, damping=0.0):
    """Rod on a pin with a local function as law; the damper is absent at damping = 0."""
    mech, rod = hinged(bd.RigidBody.rod("rod", (0.0, 0.0), (0.0, -0.5), mass=mass), gravity=9.81)
    tip = rod.at(0.0, -0.5)
    mech.add(bd.Spring("damper", mech.ground.at(1.0, 0.0), tip, 10.0, damping))
    mech.add(bd.Force("push", tip, (lambda t: mass * t, 0.0)))
    mech.observe("tip", tip)
    return mech


def copies(result):
    return pickle.loads(pickle.dumps(result)), copy.deepcopy(result)


@pytest.mark.slow(reason="half a second and more")
def test_sensitivities():
    result = bd.sensitivities(pendulum, ["mass", "damping"], METHOD)
    for again in copies(result):
        np.testing.assert_array_equal(again.table(), result.table())


@pytest.mark.slow(reason="several analyses")
def test_equilibria_modes_and_gradients():
    path = bd.equilibrium(pendulum())
    for again in copies(path):
        np.testing.assert_array_equal(again["tip.x"], path["tip.x"])
    modes = bd.modes(pendulum(), about="equilibrium")
    # Modes contain the mechanism, and pickle does not support its law, a local function.
    for again in (pickle.loads(cloudpickle.dumps(modes)), copy.deepcopy(modes)):
        np.testing.assert_array_equal(again.frequencies, modes.frequencies)
    gradient = bd.gradient(pendulum, bd.quantities.EndValue("tip.x"), "mass", METHOD)
    for again in copies(gradient):
        np.testing.assert_array_equal(again.array, gradient.array)
    along = bd.equilibrium_sensitivities(pendulum, "mass")
    for again in copies(along):
        np.testing.assert_array_equal(again.table(), along.table())


def test_constrained_systems_are_rejected():

    t, q, v = symbols()
    system = bd.ConstrainedSystem(t=t, q=q, v=v, mass=[1.0], force=-q, q0=[1.0], v0=[0.0])
    with pytest.raises(bd.BeamdaeError, match="equations without a mechanism cannot be pickled"):
        pickle.dumps(system.equations)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_solutions_with_signals_can_be_pickled():
    # CasADi's error "Cannot pickle SX objects without a casadi context", without the cause.
    mech, mass = free_ball((1.0, 0.0), name="mass")
    push = mech.input("push", unit="N")
    speed = mech.sensor("speed", mass.point, "x_dot")
    slow = mech.state("slow", lambda slow, t: push - 2.0 * slow, unit="N")
    law = 0.5 * push
    mech.add(bd.Force("direct", mass.point, (push, slow)))
    mech.add(bd.Force("formula", mass.point, (2.0 * slow - speed, lambda t: law * t)))
    method = bd.GeneralizedAlpha(step=5e-3)
    run = bd.simulate(mech, method, t_end=0.1, inputs={"push": lambda t: 3.0 + t})
    for again in copies(run):
        np.testing.assert_array_equal(again.table(), run.table())
        # The equations are those of the run.
        rerun = bd.simulate(
            again.equations.mechanism, method, t_end=0.1, inputs={"push": lambda t: 3.0 + t}
        )
        np.testing.assert_array_equal(rerun.table(), run.table())


# Functions that are pickled by their code.


def make_law(offset):
    def law(t):
        return (lambda x: x + offset)(t)

    return law


def test_regression_pickled_functions_keep_their_files():
    """Since 3.1.3, cloudpickle replaces the file, so that workers lost the folder of a model."""
    law = make_law(0.5)
    copy = pickle.loads(pickle_with_functions(law))
    assert copy is not law
    assert copy(1.0) == law(1.0) == 1.5
    assert copy.__code__.co_filename == __file__
    assert copy.__code__ == law.__code__  # also the lambda inside
