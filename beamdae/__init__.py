"""beamdae: curved beams in flexible multibody systems, on SUNDIALS IDA and generalized-alpha."""

from beamdae.beam import Beam
from beamdae.bodies import Attachment, PointMass, RigidBody
from beamdae.constrained_system import ConstrainedSystem
from beamdae.equations import EquationsOfMotion, equations_of_motion
from beamdae.errors import BeamdaeError
from beamdae.geometry import Arc, Curve, Line, Parabola
from beamdae.integrators import GeneralizedAlpha, Ida
from beamdae.joints import Driver, PointOnLine, Revolute, Weld
from beamdae.laws import Law, piecewise, run_up, sine, table
from beamdae.loads import Force, Moment
from beamdae.mechanism import Mechanism
from beamdae.model import Model, model
from beamdae.sections import Material, Section
from beamdae.simulation import simulate
from beamdae.solution import Solution

__version__ = "0.1.0"

__all__ = [
    "Arc",
    "Attachment",
    "Beam",
    "BeamdaeError",
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
    "Revolute",
    "RigidBody",
    "Section",
    "Solution",
    "Weld",
    "equations_of_motion",
    "model",
    "piecewise",
    "run_up",
    "simulate",
    "sine",
    "table",
]
