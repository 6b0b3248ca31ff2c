"""Every public part runs in machine code: its kernels and the loops are compiled."""

import pytest
from properties.catalog_models import ENTRIES, entry_model

import beamdae as bd
from beamdae.core.tables import Workspace
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.integrators.compiled_run import StepLoop
from beamdae.integrators.ida.python_solver import SksundaeIda
from beamdae.native.lane_kernels import LaneKernel
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sums.kernel_sums import Sum


def with_switch():
    """Disk and beam fall together for two thirds of a millisecond, and then apart."""
    mech = entry_model(entry="Revolute")
    mech.when("disk.y_dot", -1e-3, "down", bd.deactivate(mech.part("joint")), "cut")
    return mech


def list_code(work):
    """Return the code of all sums in a workspace."""
    if isinstance(work, Sum):
        return work.code_owners
    values = vars(work).values() if isinstance(work, Workspace) else ()
    return [code for value in values for code in list_code(value)]


@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
def test_native_off_applies_only_while_it_is_set(monkeypatch):
    """Kernels belong to the structure of the equations, which similar models share."""
    form = formulate_first_order(bd.equations_of_motion(entry_model(entry="Revolute")), "index3")
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    assert not any(plan.load_native(True) for plan in form.sums)
    monkeypatch.delenv("BEAMDAE_NATIVE")
    assert all(plan.load_native(True) for plan in form.sums)


@pytest.mark.slow(reason="kernels of all parts for all integrators are compiled")
@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("name", [*ENTRIES, "switched"])
def test_runs_consist_of_compiled_loops(name, monkeypatch):
    runs, begin = [], StepLoop.__init__

    def record(self, *arguments):
        begin(self, *arguments)
        runs.append({type(x) for x in list_code(self.work)})

    def refuse(self, *_):
        raise AssertionError("IDA calls Python")

    monkeypatch.setattr(StepLoop, "__init__", record)
    monkeypatch.setattr(SksundaeIda, "__init__", refuse)
    model = with_switch() if name == "switched" else entry_model(entry=name)
    equations = bd.equations_of_motion(model)
    for integrator in (bd.GeneralizedAlpha(1e-3), bd.Radau(), bd.Ida()):
        solution = bd.simulate(equations, integrator, 2e-3, output_step=1e-3)
        assert solution.status.success
    # Generalized-alpha and Radau; Ida would have warned.
    assert len(runs) >= 2
    assert all(kinds == {LaneKernel} for kinds in runs)
