"""A small mechanism with each public part, law, curve, section and observable."""

from tempfile import TemporaryDirectory

import numpy as np
from conformance import JOINTS, KINEMATICS, LOADS, NONHOLONOMIC
from sample_parts import SAMPLES, SampleMechanism, find_public
from support import ARC, SOFT_MATERIAL

import beamdae as bd

SECTION = bd.Section(SOFT_MATERIAL, area=0.9, second_moment=0.05, damping=0.03)
# Arguments of sample calls that must fit to the drawing, and exponents.
FIXED = {"at", "center", "end", "exponent", "length", "radii", "radius", "shape", "start", "x"}


def scale_arguments(arguments: dict, x: float) -> dict:
    """Multiply all numbers of a call that do not describe the drawing by `x`."""

    def scale(value):
        if isinstance(value, tuple) and all(isinstance(v, float) for v in value):
            return tuple(v * x for v in value)
        return value * x if isinstance(value, float) else value

    return {k: v if k in FIXED else scale(v) for k, v in arguments.items()}


def sample_part(kind):
    def add(mech, disk, beam, x):
        sample = SampleMechanism()
        sample.mechanism, sample.disk, sample.beam = mech, disk, beam
        part = mech.add(find_public(kind)(**scale_arguments(SAMPLES[kind](sample), x)))
        place = getattr(part, "point", None) or (
            part.at(3.0, 0.1) if kind == "RigidBody" else kind == "ReducedBody" and part.at(0)
        )
        if place:
            mech.add(bd.Spring("tie", disk.at(0.7, 0.4), place, 3.0 * x))

    return add


def other_part(make):
    return lambda mech, disk, beam, x: mech.add(make(mech, disk, beam))


def hang_beam(mech, curve, section=SECTION, elements=2, **settings):
    """Add another beam on a hinge."""
    beam = mech.add(bd.Beam("strip", curve, section, elements, **settings))
    mech.add(bd.Revolute("hook", mech.ground.at(*beam.start.point), beam.start))
    mech.observe("strip end", beam.end)
    mech.observe("strip strain", beam.strain(0.3 * beam.length, 0.01))


def beam_with(**settings):
    return lambda mech, disk, beam, x: hang_beam(mech, bd.Arc(1.0 / x, 1.5), **settings)


def beam_along(make):
    return lambda mech, disk, beam, x: hang_beam(mech, make(x))


def beam_of(make):
    return lambda mech, disk, beam, x: hang_beam(mech, bd.Arc(2.0, 1.0), make(x))


def force_by(make):
    """Return the entry of a time law, which pushes the disk."""

    def add(mech, disk, beam, x):
        mech.add(bd.Force("push", disk.at(0.1, 0.2), (make(x), 0.0)))

    return add


def table_of_file(x):
    with TemporaryDirectory() as folder:
        path = f"{folder}/push.csv"
        with open(path, "w", encoding="utf-8") as file:
            file.write(f"t [ms],F [N]\n0,0\n80,{x!r}\n150,0.3\n400,2\n")
        return bd.table_from_csv(path)


def observable(make):
    return lambda mech, disk, beam, x: mech.observe("seen", make(disk, beam))


def add_signals(mech, disk, beam, x):
    """An input and a filtered sensor act on the disk."""
    place = disk.at(0.1, 0.2)
    thrust = mech.input("thrust", 0.7 * x, unit="N")
    speed = mech.sensor("speed", place, "x_dot")
    lag = mech.state("lag", scale=0.1)
    lag.follows((speed - lag) / (0.05 * x))
    smooth = mech.state("smooth", lambda y, t: (speed - y) / (0.03 * x))
    mech.add(bd.Force("jet", place, (thrust - 0.3 * lag, -2.0 * smooth)))


def add_control(block):
    def add(mech, disk, beam, x):
        angle = mech.sensor("angle", disk.at(0.5, 0.4), "angle")
        mech.add(bd.Moment("motor", disk.at(0.5, 0.4), block(mech, 0.1 - angle, x)))

    return add


def add_controller(mech, disk, beam, x):
    thrust = mech.input("thrust", 0.3 * x)
    mech.add(bd.Force("jet", disk.at(0.1, 0.2), (thrust, 0.0)))
    reads = disk.at(0.5, 0.4)
    mech.add(bd.Controller("pilot", 0.05, reads, thrust, lambda sample: -sample.reads[0]))


def event(action):
    """Return the entry of an action, when the disk has fallen by 8 mm, on a moment or a hinge."""

    def add(mech, disk, beam, x):
        motor = mech.add(bd.Moment("motor", disk.at(0.5, 0.4), 0.5 * x))
        pin = mech.add(bd.Revolute("pin", mech.ground.at(*beam.end.point), beam.end))
        mech.deactivate(pin)
        mech.when("disk.y", 0.392, "down", action(motor, pin), "change")

    return add


def add_impact(mech, disk, beam, x):
    gap = bd.LineSurface(mech.ground.at(0.0, 0.392)).gap(disk.at(0.5, 0.4))
    mech.observe("gap", gap)
    mech.when("gap", 0.0, "down", bd.impact(gap, 0.6), "bounce")


def add_driver_change(mech, disk, beam, x):
    axle = mech.ground.at(0.4, 0.4), disk.at(0.4, 0.4)
    mech.add(bd.Revolute("axle", *axle))
    motor = mech.add(bd.Driver("motor", *axle, lambda t: x * t))
    mech.observe("axle", motor.drive)
    mech.when("disk.angle", 0.07, "up", bd.change_law(motor, lambda t: 0.5 * x * t), "brake")


def add_frame(mech, disk, beam, x):
    points = {"A": (2.0, 0.0), "B": (2.0, 1.0), "C": (3.0, 1.0)}
    corners = bd.frame(mech, "portal", points, ["AB", "BC"], SECTION, elements=1)
    mech.add(bd.Weld("foot", mech.ground.at(2.0, 0.0), corners.corners["A"]))
    mech.add(bd.Force("wind", corners.corners["C"], (0.4 * x, 0.1)))


def add_welded_beams(mech, disk, beam, x):
    pieces = bd.welded_beams(mech, "chain", bd.Line((2.0, 0.0), (3.0, 0.5)), SECTION, bodies=2)
    mech.add(bd.Revolute("foot", mech.ground.at(2.0, 0.0), pieces[0].start))
    mech.add(bd.Force("wind", pieces[-1].end, (0.4 * x, 0.1)))


def parabola(x):
    return bd.Parabola(1.5, 0.2 * x, (0.0, 1.0), 0.1)


PARTS = [
    kind
    for kind in SAMPLES
    if kind != "Beam" and isinstance(one := find_public(kind), type) and issubclass(one, bd.Part)
]
OTHERS = JOINTS | NONHOLONOMIC | LOADS
SOFT = {"material": SOFT_MATERIAL, "damping": 0.02}
# Functions of (mechanism, disk, beam, x) that add an entry, by its public name or its variant.
ENTRIES = {
    **{k: sample_part(k) for k in PARTS},
    **{k: other_part(make) for k, make in OTHERS.items() if k not in PARTS},
    "LineSurface": other_part(LOADS["contact with a line"]),
    "CircleSurface": other_part(LOADS["contact with a circle"]),
    "Law": force_by(lambda x: bd.results.Law((lambda t: x * t, lambda t: 0.2), (0.1,))),
    "run_up": force_by(lambda x: bd.run_up(x, 0.15)),
    "sine": force_by(lambda x: bd.sine(x, 5.0, 0.3)),
    "half_sine": force_by(lambda x: bd.half_sine(x, 0.11, 0.03)),
    "sum of laws": force_by(lambda x: 0.1 + bd.half_sine(x, 0.11) + (lambda t: np.cos(9 * t))),
    "piecewise": force_by(lambda x: bd.piecewise((0.07, x), (0.12, lambda t: np.cos(9 * t)), 0.0)),
    "table": force_by(lambda x: bd.table([0.0, 0.05, 0.1, 0.3], [0.0, x, 0.0, 1.0])),
    "table_from_csv": force_by(table_of_file),
    "acceleration": observable(lambda d, b: bd.acceleration(b.end)),
    "relative_displacement": observable(lambda d, b: bd.relative_displacement(b.end, d.at(0, 0))),
    "relative_motion": observable(lambda d, b: bd.relative_motion(b.end, d.at(0.1, 0.2))),
    "Input": add_signals,
    "Sensor": add_signals,
    "State": add_signals,
    "transfer_function": add_control(
        lambda m, e, x: bd.transfer_function(m, "filter", e, [5.0 * x, 3.0], [0.01, 0.2, 1.0])
    ),
    "pid": add_control(
        lambda m, e, x: bd.pid(m, "servo", e, 9.0 * x, 4.0, 0.5, filter_time=0.02)
    ),
    "Controller": add_controller,
    "Sample": add_controller,
    "Event": event(lambda motor, pin: "record"),
    "activate": event(lambda motor, pin: bd.activate(pin, as_is=True)),
    "deactivate": event(lambda motor, pin: bd.deactivate(motor)),
    "change_law": add_driver_change,
    "impact": add_impact,
    "Beam": beam_with(),
    **{name: beam_with(kinematics=kind) for name, kind in KINEMATICS.items()},
    "linear strain": beam_with(strain="linear", elements_shape="straight", quadrature="full"),
    "local continuity, three nodes": beam_with(continuity="local", nodes=3),
    "seven nodes": beam_with(nodes=7),
    "prestressed": beam_with(free_curve=bd.Arc(1.3, 1.5)),
    "frame": add_frame,
    "welded_beams": add_welded_beams,
    "Line": beam_along(lambda x: bd.Line((0.0, 1.0), (1.0 * x, 1.4))),
    "Arc": beam_along(lambda x: bd.Arc(1.2 * x, 1.0, (0.0, 1.0), 0.1)),
    "Parabola": beam_along(parabola),
    "Curve": beam_along(lambda x: bd.Curve(lambda u: 0.2 * x * u**2, x=(0.0, 1.0))),
    "IntrinsicCurve": beam_along(lambda x: bd.IntrinsicCurve(lambda s: 0.5 * x * s, 1.2)),
    "Segment": beam_along(lambda x: bd.Segment(parabola(x), 0.2, 1.1)),
    "Section": beam_of(lambda x: bd.Section(SOFT_MATERIAL, 0.8 * x, 0.05 * x, damping=0.03)),
    "rectangle": beam_of(lambda x: bd.Section.rectangle(width=0.9, height=0.4 * x, **SOFT)),
    "circle": beam_of(lambda x: bd.Section.circle(diameter=0.6 * x, **SOFT)),
    "pipe": beam_of(lambda x: bd.Section.pipe(diameter=0.6 * x, wall=0.1, **SOFT)),
    "i profile": beam_of(
        lambda x: bd.Section.i_profile(width=0.5, height=0.6 * x, flange=0.1, web=0.1, **SOFT)
    ),
    "section by a law": beam_of(
        lambda x: lambda s: bd.Section(SOFT_MATERIAL, 0.8 * x * (1.0 - 0.3 * s), 0.05)
    ),
    "taper": beam_of(lambda x: bd.taper(bd.Section.circle, diameter=(0.6 * x, 0.4), **SOFT)),
    "Material": beam_of(lambda x: bd.Section(bd.Material(60.0 * x, 0.3, 1.3 * x), 0.9, 0.05)),
}  # fmt: skip

T_END = 0.2


@bd.model(t_end=T_END)
def entry_model(x=1.0, entry="Spring", formulation="floating frame", elements=1, stiffness=1.0):
    """Return a disk and a beam that fall, with an entry, whose numbers `x` scales."""
    mech = bd.Mechanism(gravity=(0.2, -1.5 * x))
    material = bd.Material(E=60.0 * stiffness, nu=0.3, rho=1.3)
    section = bd.Section(material, area=0.9, second_moment=0.05, damping=0.03 / stiffness)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, section, elements=elements, formulation=formulation))
    mech.observe("disk", disk.at(0.5, 0.4))
    mech.observe("tip", beam.end)
    ENTRIES[entry](mech, disk, beam, x)
    return mech
