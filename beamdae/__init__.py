"""beamdae: curved beams in flexible multibody systems, on SUNDIALS IDA and generalized-alpha."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from beamdae.errors import BeamdaeError

# Now, for the function has to stand before the submodule of the same name.
from beamdae.model import Model, model

if TYPE_CHECKING:
    from beamdae.beam import Beam
    from beamdae.bodies import Attachment, PointMass, RigidBody
    from beamdae.building import equations_of_motion
    from beamdae.constrained_system import ConstrainedSystem
    from beamdae.damping import AirDrag, RayleighDamping
    from beamdae.equations import EquationsOfMotion
    from beamdae.geometry import Arc, Line, Segment
    from beamdae.integrators import GeneralizedAlpha, Ida, Radau
    from beamdae.joints import Driver, PointOnLine, Revolute, Weld
    from beamdae.laws import Law, piecewise, run_up, sine, table
    from beamdae.loads import Force, Moment
    from beamdae.mechanism import Mechanism
    from beamdae.model_file import load_model
    from beamdae.observables import relative_displacement
    from beamdae.sections import Material, Section
    from beamdae.simulation import simulate
    from beamdae.solution import Solution
    from beamdae.spline_curves import Curve, Parabola
    from beamdae.studies import Case, Study, compare, grid, study
    from beamdae.welded import welded_beams

__version__ = "0.1.0"

__all__ = [
    "AirDrag",
    "Arc",
    "Attachment",
    "Beam",
    "BeamdaeError",
    "Case",
    "ConstrainedSystem",
    "Curve",
    "Driver",
    "EquationsOfMotion",
    "Force",
    "GeneralizedAlpha",
    "Ida",
    "Law",
    "Line",
    "Material",
    "Mechanism",
    "Model",
    "Moment",
    "Parabola",
    "PointMass",
    "PointOnLine",
    "Radau",
    "RayleighDamping",
    "Revolute",
    "RigidBody",
    "Section",
    "Segment",
    "Solution",
    "Study",
    "Weld",
    "compare",
    "equations_of_motion",
    "grid",
    "load_model",
    "model",
    "piecewise",
    "relative_displacement",
    "run_up",
    "simulate",
    "sine",
    "study",
    "table",
    "welded_beams",
]

_MODULES = {
    "beam": ("Beam",),
    "building": ("equations_of_motion",),
    "bodies": ("Attachment", "PointMass", "RigidBody"),
    "constrained_system": ("ConstrainedSystem",),
    "damping": ("AirDrag", "RayleighDamping"),
    "equations": ("EquationsOfMotion",),
    "geometry": ("Arc", "Line", "Segment"),
    "integrators": ("GeneralizedAlpha", "Ida", "Radau"),
    "joints": ("Driver", "PointOnLine", "Revolute", "Weld"),
    "laws": ("Law", "piecewise", "run_up", "sine", "table"),
    "loads": ("Force", "Moment"),
    "mechanism": ("Mechanism",),
    "model_file": ("load_model",),
    "observables": ("relative_displacement",),
    "sections": ("Material", "Section"),
    "simulation": ("simulate",),
    "solution": ("Solution",),
    "spline_curves": ("Curve", "Parabola"),
    "studies": ("Case", "Study", "compare", "grid", "study"),
    "welded": ("welded_beams",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name from its module when first used: `beamdae --help` needs none."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"beamdae.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
