"""Results of every analysis, as numbers with a unit that do not depend on the drawing."""

from random import Random

import numpy as np
from properties.similarity import Similarity, Wave
from properties.state_laws import similarity_transformations

import beamdae as bd
from beamdae import quantities

FRAMES = {"drawn": Similarity()} | similarity_transformations(Random(0))
RUN = bd.Radau(1e-8)
RATE = 9.0  # [rad/s], of the load


def shuffled(mech: bd.Mechanism, parts: list, frame: str) -> bd.Mechanism:
    """Add the parts, in reverse order if the frame is not the drawn one."""
    for part in parts if frame == "drawn" else parts[::-1]:
        mech.add(part)
    return mech


@bd.model(t_end=1.0)
def arm(x=1.0, frame="drawn", push=0.0):
    """A rod on a hinge, with a spring, a torsion spring and dampers, under loads that `x` scales.

    The elongation of the spring and the input "push", a force at its end, describe the motion.
    """
    f = FRAMES[frame]
    mech = bd.Mechanism(gravity=f.way(0.0, -9.81, "m/s^2"))
    hinge, end, hook = (f.point(*point) for point in ((0.2, 0.1), (0.6, 0.4), (0.1, 0.7)))
    rod = mech.add(bd.RigidBody.rod("rod", hinge, end, mass=f.number(0.8 * x, "kg")))
    ground, tip = mech.ground.at(*hinge), rod.at(*end)
    stiffness, damping = f.number(60.0 * x, "N/m"), f.number(1.5, "N s/m")
    gauge = bd.Spring("gauge", mech.ground.at(*hook), tip, stiffness, damping)
    push = mech.input("push", push)
    ways = f.way(0.6, 0.8, "")
    torsion = {"stiffness": f.number(3.0, "N m"), "damping": f.number(0.1, "N m s")}
    load = f.law(Wave(0.5 * x, 1.0, RATE), "N m", f.sense)
    parts = [
        bd.Revolute("hinge", ground, rod.at(*hinge)),
        gauge,
        bd.TorsionSpring("coil", ground, rod.at(*hinge), **torsion),
        bd.Force("jet", tip, (ways[0] * push, ways[1] * push)),
        bd.Moment("motor", tip, load),
    ]
    shuffled(mech, parts, frame)
    mech.observe("gauge", gauge.elongation)
    return mech


@bd.model(t_end=1.0)
def column(x=1.0, frame="drawn", lean=0.0):
    """A hinged steel column of 1 m under 0.3 of its Euler load; `x` scales its height."""
    f, mech = FRAMES[frame], bd.Mechanism()
    material = bd.Material(f.number(2.1e11, "Pa"), 0.3, f.number(7850.0, "kg/m^3"))
    section = bd.Section.rectangle(material, f.number(0.02, "m"), f.number(2e-3 * x, "m"))
    foot, head = f.point(0.1, 0.2), f.point(0.7, 1.0)
    beam = mech.add(bd.Beam("beam", bd.Line(foot, head), section, 4, formulation="exact"))
    load = f.number(0.3 * np.pi**2 * 2.1e11 * 0.02 * 2e-3**3 / 12.0, "N")
    fx, fy = f.way(-0.6 * load + 0.8 * lean * load, -0.8 * load - 0.6 * lean * load, "")
    guide = f.way(0.6, 0.8, "")
    parts = [
        bd.Revolute("foot", mech.ground.at(*foot), beam.start),
        bd.PointOnLine("head", mech.ground.at(*foot), beam.end, guide),
        bd.Force("press", beam.end, (fx, fy)),
    ]
    shuffled(mech, parts, frame)
    mech.observe("middle", beam.strain(0.5 * beam.length, f.number(1e-3, "m")))
    return mech


@bd.model(t_end=1.0)
def rotor(x=1.0, frame="drawn"):
    """A soft blade on a hub that a driver holds, with its axis at (0.3, -0.2) m."""
    f, mech = FRAMES[frame], bd.Mechanism()
    material = bd.Material(f.number(1e8 * x, "Pa"), 0.3, f.number(1000.0, "kg/m^3"))
    section = bd.Section.rectangle(material, f.number(0.02, "m"), f.number(0.01, "m"))
    axis, root, end = (f.point(*point) for point in ((0.3, -0.2), (0.3, -0.1), (0.3, 0.4)))
    hub = mech.add(bd.RigidBody.disk("hub", axis, f.number(0.1, "m"), mass=f.number(2.0, "kg")))
    blade = mech.add(bd.Beam("blade", bd.Line(root, end), section, 2))
    parts = [
        bd.Weld("clamp", hub.at(*root), blade.start),
        bd.Revolute("bearing", mech.ground.at(*axis), hub.at(*axis)),
        bd.Driver("motor", mech.ground.at(*axis), hub.at(*axis), 0.0),
    ]
    return shuffled(mech, parts, frame)


# Analyses: functions of a frame's name that return numbers with their units --------------------


def times(frame: str) -> tuple[float, float]:
    """Return the end time and the interval of rows."""
    return FRAMES[frame].number(0.4, "s"), FRAMES[frame].number(0.02, "s")


def values(frame: str) -> dict:
    return {"parameters": {"frame": frame}}


def simulate(frame):
    run = bd.simulate(arm(frame=frame), RUN, *times(frame))
    changes = run.energies - run.energies.iloc[0]
    energies = [(changes[f"energy.{kind} [J]"], "N m") for kind in ("kinetic", "strain", "gravity")]
    return [(run["gauge"], "m"), *energies]


def sensitivities(frame):
    found = bd.sensitivities(arm, "x", RUN, *times(frame), **values(frame), estimate_error=False)
    return [(found.sensitivity("gauge", "x"), "m")]


OBJECTIVES = {
    "EndValue": lambda f: (quantities.EndValue("gauge"), "m"),
    "TimeIntegral": lambda f: (quantities.TimeIntegral("gauge"), "m s"),
    "SmoothMaximum": lambda f: (quantities.SmoothMaximum("gauge", exponent=8.0), "m"),
    "SquaredErrors": lambda f: (
        quantities.SquaredErrors(
            "gauge",
            tuple(f.number(t, "s") for t in (0.1, 0.3)),
            tuple(f.number(y, "m") for y in (0.01, -0.02)),
            f.number(0.01, "m"),
        ),
        "",
    ),
}


def gradient_of(kind):
    def analysis(frame):
        objective, unit = OBJECTIVES[kind](FRAMES[frame])
        settings = values(frame) | {"estimate_error": False}
        result = bd.gradient(arm, objective, "x", RUN, times(frame)[0], **settings)
        return [(result.value, unit), (result.array, unit)]

    return analysis


def equilibrium(frame):
    path = bd.equilibrium(arm(frame=frame))
    return [(path["gauge"].iloc[-1], "m"), (path.unstable[-1], "")]


def equilibrium_sensitivities(frame):
    found = bd.equilibrium_sensitivities(arm, "x", **values(frame))
    return [(found.sensitivity("gauge", "x").iloc[-1], "m")]


def modes(frame):
    pairs = [(arm, "equilibrium"), (column, "equilibrium"), (rotor, "reference")]
    found = [bd.modes(model(frame=frame), about=about, n=3) for model, about in pairs]
    parts = [part(x.eigenvalues) for x in found for part in (np.real, lambda y: np.abs(np.imag(y)))]
    return [(part, "rad/s") for part in parts]


def mode_sensitivities(frame):
    found = bd.mode_sensitivities(arm, "x", about="equilibrium", **values(frame))
    return [(found.sensitivity("frequency", "x"), "rad/s")]


def linear_model(frame):
    return bd.linearize(arm(frame=frame), "equilibrium", ["push"], ["gauge"])


def linearize(frame):
    model = linear_model(frame)
    poles = np.sort_complex(np.round(model.poles, 12))
    gain = model.frequency_response([0.0])[0, 0, 0]
    return [(poles.real, "rad/s"), (np.abs(poles.imag), "rad/s"), (gain.real, "m/N")]


def bode(frame):
    f = FRAMES[frame]
    diagram = bd.bode(
        linear_model(frame), frequencies=[f.number(n, "rad/s") for n in (0.5, 2.0, 9.0)]
    )
    return [(np.abs(diagram.response[:, 0, 0]), "m/N")]


def margins(frame):
    f = FRAMES[frame]
    gain, delay = f.number(-300.0, "N/m"), f.number(0.02, "s")
    loop = bd.margins(linear_model(frame), controller=gain, delay=delay)
    numbers = [(loop.gain_margin, ""), (loop.phase_margin, "")]
    return [*numbers, (loop.gain_crossover, "rad/s")]


def period(frame):
    return FRAMES[frame].number(2.0 * np.pi / RATE, "s")


def periodic(frame):
    motion = bd.periodic(arm(frame=frame), period(frame), RUN)
    gauge = motion.solution["gauge"].to_numpy()
    return [(np.sort(np.abs(motion.multipliers)), ""), (np.ptp(gauge), "m"), (gauge[0], "m")]


def periodic_sensitivities(frame):
    found = bd.periodic_sensitivities(arm, "x", period(frame), RUN, **values(frame))
    return [(found.sensitivity("gauge", "x").iloc[0], "m")]


def frequency_response(frame):
    curve = bd.frequency_response(
        arm, "x", (0.9, 1.1), lambda x: period(frame), bd.Radau(1e-7), 0.1, 0.1, **values(frame)
    )
    ends = [np.ptp(curve.points[k].solution["gauge"]) for k in (0, -1)]
    return [(np.array(ends), "m")]


def buckling(frame):
    return [(bd.buckling(column(frame=frame), n=2).factors, "")]


def boundary(frame):
    curve = bd.boundary(
        column, "branch point", ("x", "load"), (1.0, 1.2), step=0.2, to=5.0, **values(frame)
    )
    return [(curve.values[[0, -1]], ""), (curve.factors[[0, -1]], "")]


def imperfect(frame):
    perfect, size = column(frame=frame), FRAMES[frame].number(1e-3, "m")
    path = bd.equilibrium(bd.imperfect(perfect, bd.buckling(perfect, n=1), size))
    return [(np.abs(path["middle"].iloc[-1]), "")]


def campbell(frame):
    f = FRAMES[frame]
    speeds = [f.turn(s, "rad/s") for s in (0.0, 20.0)]
    diagram = bd.campbell(rotor(frame=frame), speeds, 2, center=f.point(0.3, -0.2))
    # Mirrored speeds are negative, and ascend in the other order.
    rows = np.argsort(np.abs(diagram.speeds))
    return [(np.abs(diagram.eigenvalues)[rows], "rad/s")]


def fit(frame):
    run = bd.simulate(arm(x=1.07, frame=frame), RUN, *times(frame)).table()
    found = bd.fit(arm, run[["t [s]", "gauge [m]"]], "x", RUN, **values(frame))
    return [(found.parameters["x"], "")]


def optimize(frame):
    """Choose the height of the column for a first frequency of 8 Hz at the least mass."""
    least = quantities.at_least(quantities.Frequency(1), FRAMES[frame].number(8.0, "rad/s"))
    design = bd.optimize(column, quantities.Mass(), "x", least, {"x": (0.5, 3.0)}, **values(frame))
    return [(design.parameters["x"], ""), (design.objective, "kg")]


def check(frame):
    found = bd.check(arm(frame=frame), predict=False)
    return [(found.coordinates, ""), (found.rank, ""), (len(found.free_motions), "")]


ANALYSES = {
    "simulate": simulate,
    "sensitivities": sensitivities,
    **{kind: gradient_of(kind) for kind in OBJECTIVES},
    "equilibrium": equilibrium,
    "equilibrium_sensitivities": equilibrium_sensitivities,
    "modes": modes,
    "mode_sensitivities": mode_sensitivities,
    "linearize": linearize,
    "bode": bode,
    "margins": margins,
    "periodic": periodic,
    "periodic_sensitivities": periodic_sensitivities,
    "frequency_response": frequency_response,
    "buckling": buckling,
    "boundary": boundary,
    "imperfect": imperfect,
    "campbell": campbell,
    "fit": fit,
    "optimize": optimize,
    "check": check,
}
# Derivatives, the last results of these analyses, are those of functions of x.
FUNCTIONS = {
    "sensitivities": lambda x: bd.simulate(arm(x=x), RUN, *times("drawn"))["gauge"],
    **{
        kind: lambda x, of=of: of(Similarity())[0].value(
            bd.simulate(arm(x=x), RUN, times("drawn")[0], keep_steps=True)
        )
        for kind, of in OBJECTIVES.items()
    },
    "equilibrium_sensitivities": lambda x: bd.equilibrium(arm(x=x))["gauge"].iloc[-1],
    "mode_sensitivities": lambda x: bd.modes(arm(x=x), about="equilibrium").frequencies,
    "linearize": lambda x: bd.equilibrium(arm(push=x - 1.0))["gauge"].iloc[-1],
    "periodic_sensitivities": lambda x: bd.periodic(
        arm(x=x), period("drawn"), RUN
    ).solution["gauge"].iloc[0],
}  # fmt: skip
