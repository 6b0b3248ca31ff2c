"""Cases of the tolerance study: five cases of published models, the wide set and a newer set.

Default settings were chosen with the wide set; the newer set was written afterwards.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks import systems
from four_bar import four_bar as example_four_bar
from governor import governor
from hub_beam import hub_beam
from leaf_spring_vehicle import leaf_spring_vehicle
from pendulum import pendulum
from quick_return import quick_return
from shallow_arch import shallow_arch
from slider_crank import slider_crank
from spin_up import spin_up

import beamdae as bd
from tolerances import flexible_mechanisms as flexible
from tolerances import lumped_systems as lumped
from tolerances import mechanisms
from tolerances.flexible_slider_crank import CRANK_END, flexible_slider_crank
from tolerances.tolerance_case import DAMPED, UNDAMPED, ToleranceCase

# Beams of models whose cases compare the deflection in the middle.
BEAMS = {
    "hub_beam": ("beam",),
    "pendulum": ("beam",),
    "slider_crank": ("rod",),
    "spin_up": ("beam",),
    "four_bar": ("coupler",),
    "double_strip_pendulum": ("upper", "lower"),
    "strip_pendulum": ("strip",),
    "cantilever": ("beam",),
}


# Cases whose deflection is an undamped vibration that no second method resolves.
UNRESOLVED = ("thick_strip",)


def _add_deflections(case: ToleranceCase) -> ToleranceCase:
    beams = () if case.name in UNRESOLVED else BEAMS.get(case.model.name, ())
    return replace(case, beams=beams, deflections=tuple(f"{name} bend.v [m]" for name in beams))


HUB = ("tip.x [m]", "tip.y [m]", "hub.angle [rad]")
PENDULUM = ("tip.x [m]", "tip.y [m]", "frame.angle [rad]")
SLIDER = ("slider.x [m]", "rod frame.angle [rad]")
CASES = tuple(
    _add_deflections(case)
    for case in (
        ToleranceCase("hub_beam", hub_beam, HUB, rows=501),
        ToleranceCase("pendulum_damped", pendulum, PENDULUM, bound=DAMPED, rows=501),
        ToleranceCase("pendulum_undamped", pendulum, PENDULUM, {"damping": 0.0}, rows=501),
        ToleranceCase("slider_crank_tangent", slider_crank, SLIDER, rows=501),
        ToleranceCase("slider_crank_chord", slider_crank, SLIDER, {"frame": "chord"}, rows=501),
    )
)


def _case(
    name: str,
    model: bd.results.Model,
    columns: tuple[str, ...],
    t_end: float,
    bound: float = UNDAMPED,
    **parameters: Any,
) -> ToleranceCase:
    return ToleranceCase(name, model, columns, parameters, bound, t_end)


MECHANISMS = (
    _case("hub_slow", hub_beam, HUB, 5.0, frequency=0.1),
    _case("hub_fast", hub_beam, HUB, 0.5, frequency=10.0),
    _case("hub_fast_damped", hub_beam, HUB, 0.5, DAMPED, frequency=10.0, damping=1e-5),
    _case("hub_strong", hub_beam, HUB, 1.0, torque=50.0),
    _case("hub_weak", hub_beam, HUB, 1.0, torque=2.0),
    _case("flexible_crank", slider_crank, SLIDER, 1.5, crank="flexible"),
    _case(
        "flexible_crank_damped", slider_crank, SLIDER, 1.5, DAMPED, crank="flexible", damping=1e-4
    ),
    _case("no_tip_mass", pendulum, PENDULUM, 1.0, tip_mass=0.0, damping=0.0),
    _case("no_tip_mass_damped", pendulum, PENDULUM, 2.0, DAMPED, tip_mass=0.0),
)

TIP = ("tip.x [m]", "tip.y [m]", "tip.angle [rad]")
BLADE = (
    _case("spin_up", spin_up, TIP, 20.0),
    _case("spin_up_damped", spin_up, TIP, 20.0, DAMPED, damping=1e-2),
)

COUPLER = ("middle.x [m]", "middle.y [m]", "rocker.angle [rad]")
LOOP = ("crank.angle [rad]", "coupler.angle [rad]", "rocker.angle [rad]")
TOPS = ("top.x [m]", "top.y [m]", "bar.x [m]")
LOOPS = (
    _case("four_bar", mechanisms.four_bar, COUPLER, 1.0),
    _case("four_bar_damped", mechanisms.four_bar, COUPLER, 1.5, DAMPED, damping=1e-4),
    _case("parallelogram", mechanisms.parallelogram, LOOP, 1.0),
    replace(
        _case("double_four_bar", mechanisms.double_four_bar, TOPS, 2.0),
        exact=mechanisms.double_four_bar_motion,
    ),
)

ENDS = ("upper end.x [m]", "upper end.y [m]", "lower end.x [m]", "lower end.y [m]")
BOTH = {"upper_damping": 1e-4, "lower_damping": 1e-4}
STRIPS = (
    _case("double_strips", mechanisms.double_strip_pendulum, ENDS, 0.6),
    _case("double_strips_damped", mechanisms.double_strip_pendulum, ENDS, 1.0, DAMPED, **BOTH),
    _case(
        "mixed_damping",
        mechanisms.double_strip_pendulum,
        ENDS,
        0.6,
        upper_height=0.02,
        lower_damping=1e-3,
    ),
    _case("thin_strip", mechanisms.strip_pendulum, PENDULUM, 0.5, height=5e-4),
    _case(
        "thin_strip_damped",
        mechanisms.strip_pendulum,
        PENDULUM,
        1.0,
        DAMPED,
        height=5e-4,
        damping=1e-4,
    ),
    _case("thick_strip", mechanisms.strip_pendulum, PENDULUM, 1.0, height=0.01),
    _case(
        "thick_strip_damped",
        mechanisms.strip_pendulum,
        PENDULUM,
        1.0,
        DAMPED,
        height=0.01,
        damping=1e-4,
    ),
)

# The axial motion of the tip is of second order in the deflection.
BENT = ("tip.y [m]", "tip.angle [rad]")
# Two elements: with more undamped modes, no second method resolves the motion after a step.
TWO = {"elements": 2}
THICK = TWO | {"width": 0.03, "height": 0.03, "force": 1.0}
SMALL = (
    _case("cantilever_small", mechanisms.cantilever, BENT, 0.5, **TWO),
    _case("cantilever_small_damped", mechanisms.cantilever, BENT, 0.5, DAMPED, damping=1e-4, **TWO),
    _case("cantilever_30mm", mechanisms.cantilever, BENT, 0.2, **THICK),
    _case(
        "cantilever_30mm_damped", mechanisms.cantilever, BENT, 0.2, DAMPED, damping=1e-4, **THICK
    ),
)
LARGE = TWO | {"force": 10.0}
LIGHT = TWO | {"width": 0.01, "height": 0.003, "force": 0.05, "start": 0.1, "alloy": True}
BENDING = (
    _case("cantilever_10N", mechanisms.cantilever, BENT, 0.5, **LARGE),
    _case("cantilever_10N_damped", mechanisms.cantilever, BENT, 0.5, DAMPED, damping=1e-4, **LARGE),
    _case("step_on_beam", mechanisms.cantilever, BENT, 0.6, **LIGHT),
    _case("step_on_beam_damped", mechanisms.cantilever, BENT, 0.6, DAMPED, damping=1e-3, **LIGHT),
    _case(
        "step_on_tip_mass",
        mechanisms.cantilever,
        BENT,
        0.6,
        DAMPED,
        tip_mass=1e-3,
        damping=1e-4,
        **LIGHT,
    ),
)
CANTILEVERS = tuple(
    replace(case, reactions=("root.M [N m]",), small=case in SMALL) for case in (*SMALL, *BENDING)
)

CRANK = ("phi1 [rad]", *CRANK_END)
XY = ("x [m]", "y [m]")
SYSTEMS = (
    replace(
        _case("car_axis", systems.car_axis, tuple(systems.CAR_AXIS_END), 3.0),
        published=systems.CAR_AXIS_END,
    ),
    replace(_case("arevalo", systems.arevalo, XY, 2.0), exact=systems.arevalo_motion),
    replace(
        _case("period_two", systems.particle_pendulum, XY, 4.0),
        exact=systems.released_pendulum_motion,
    ),
    replace(
        _case(
            "iftomm_pendulum", systems.particle_pendulum, XY, 10.0, gravity=9.81, angle=-0.5 * np.pi
        ),
        exact=systems.iftomm_motion,
        published=systems.IFTOMM_END,
    ),
    replace(
        _case(
            "spring_slider_crank",
            systems.spring_slider_crank,
            tuple(systems.SPRING_SLIDER_CRANK_END),
            10.0,
            DAMPED,
        ),
        published=systems.SPRING_SLIDER_CRANK_END,
    ),
    replace(_case("ivp_crank", flexible_slider_crank, CRANK, 0.1), published=CRANK_END),
    _case("ivp_crank_damped", flexible_slider_crank, CRANK, 0.1, DAMPED, damped=True),
    replace(
        _case("free_particle", systems.free_particle, ("r [m]", "phi [rad]"), 4.0),
        exact=systems.free_particle_motion,
    ),
)
_OTHERS = (*MECHANISMS, *BLADE, *LOOPS, *STRIPS, *CANTILEVERS, *SYSTEMS)
WIDE = (*CASES, *map(_add_deflections, _OTHERS))


def _new_case(
    name: str,
    model: bd.results.Model,
    t_end: float,
    columns: str,
    deflections: str = "",
    rates: str = "",
    reactions: str = "",
    damped: bool = False,
    beams: tuple[str, ...] = (),
    **parameters: Any,
) -> ToleranceCase:
    """Return a case of the newer set; columns are separated by commas."""
    kinds = (tuple(filter(None, x.split(", "))) for x in (columns, deflections, rates, reactions))
    compared: dict[str, Any] = dict(
        zip(("columns", "deflections", "rates", "reactions"), kinds, strict=True)
    )
    bound = DAMPED if damped else UNDAMPED
    settings = {"parameters": parameters, "bound": bound, "t_end": t_end, "beams": beams}
    return ToleranceCase(name, model, rows=151, **settings, **compared)


_PIN = "pin.x [m], pin.y [m], pin.angle [rad]"
_TIP = "tip.x [m], tip.y [m], tip.angle [rad]"
_FREE_ENDS = "start.x [m], start.y [m], end.x [m], end.y [m], end.angle [rad]"
_TUTORIAL = (
    _PIN,
    "coupler bend.v [m]",
    "pin.x_dot [m/s]",
    "rocker pin.Fx [N], rocker pin.Fy [N]",
)
_HANGING = (
    "pin.x [m], pin.y [m], knee.x [m], knee.y [m]",
    "left bend.v [m], coupler bend.v [m]",
    "pin.x_dot [m/s]",
    "left.Fx [N], left.Fy [N]",
)
_WATT = (
    "b.x [m], b.y [m], e.x [m], e.y [m]",
    "first bend.v [m]",
    "e.x_dot [m/s]",
    "left.Fx [N], left.Fy [N]",
)
# Undamped axial vibrations after a sudden start would leave no second method for deflections.
_SMOOTH = {"damping": 0.0, "onset": 0.2}
_SPIN = (_FREE_ENDS, "beam bend.v [m]", "middle.y_dot [m/s]")
FLEXIBLE = (
    _new_case("tutorial_four_bar", flexible.tutorial_four_bar, 5.0, *_TUTORIAL, damped=True),
    _new_case("hanging_four_bar", flexible.hanging_four_bar, 5.0, *_HANGING, damped=True),
    _new_case("watt_six_bar", flexible.watt_six_bar, 3.0, *_WATT, damped=True),
    _new_case(
        "bouncing_beam",
        flexible.bouncing_beam,
        0.8,
        "left.y [m], right.x [m], right.y [m], right.angle [rad]",
        "beam bend.v [m]",
        "left.y_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "wound_spiral",
        flexible.wound_spiral,
        1.0,
        "wheel.angle [rad], middle.x [m], middle.y [m]",
        "bend.u [m], bend.phi [rad]",
        "wheel.angle_dot [rad/s]",
        "clamp.Fx [N], clamp.M [N m]",
        damped=True,
    ),
    _new_case(
        "peaucellier",
        flexible.peaucellier,
        2.0,
        "q.x [m], q.y [m], q.angle [rad]",
        "column bend.v [m]",
        "q.y_dot [m/s]",
        "motor.M [N m]",
        damped=True,
    ),
    _new_case(
        "cart_mast",
        flexible.cart_mast,
        3.0,
        "cart.x [m], tip.x [m], tip.y [m]",
        "flap.u [m], mast bend.v [m]",
        "tip.x_dot [m/s]",
        "socket.M [N m], socket.Q [N]",
        damped=True,
    ),
    _new_case(
        "scotch_yoke",
        flexible.scotch_yoke,
        2.0,
        "load.x [m], load.angle [rad]",
        "bend.v [m]",
        "load.x_dot [m/s]",
        "root.N [N]",
        damped=True,
    ),
    _new_case(
        "wiper",
        flexible.wiper,
        3.0,
        _TIP,
        "arm bend.v [m]",
        "tip.x_dot [m/s]",
        "motor.M [N m]",
        damped=True,
    ),
    _new_case(
        "whip",
        flexible.whip,
        0.8,
        _TIP,
        "bend.u [m], bend.v [m]",
        "tip.x_dot [m/s]",
        "wrist.M [N m]",
        damped=True,
    ),
    _new_case("spinning_beam", flexible.spinning_beam, 1.0, *_SPIN),
    _new_case(
        "spinning_beam_damped", flexible.spinning_beam, 2.0, *_SPIN, damped=True, damping=1e-4
    ),
    _new_case(
        "exact_pendulum",
        flexible.exact_pendulum,
        5.0,
        _TIP,
        "strip bend.v [m]",
        "tip.x_dot [m/s]",
        "hinge.Fx [N], hinge.Fy [N]",
    ),
)
FLEXIBLE += (
    _new_case("watt_six_bar_undamped", flexible.watt_six_bar, 1.0, *_WATT, **_SMOOTH),
    _new_case("tutorial_four_bar_undamped", flexible.tutorial_four_bar, 3.0, *_TUTORIAL, **_SMOOTH),
    _new_case(
        "bow",
        flexible.bow,
        0.4,
        "arrow.x [m], nock.x [m]",
        "upper bend.v [m]",
        "arrow.x_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "magnet_strip",
        flexible.magnet_strip,
        2.0,
        _TIP,
        "strip bend.v [m]",
        "tip.x_dot [m/s]",
        "clamp.M [N m]",
        damped=True,
    ),
    _new_case(
        "micro_resonator",
        flexible.micro_resonator,
        1e-3,
        "tip.y [m], tip.angle [rad]",
        "bend.v [m]",
        "tip.y_dot [m/s]",
        "clamp.M [N m]",
        damped=True,
    ),
    _new_case(
        "tuning_fork",
        flexible.tuning_fork,
        0.03,
        "left tip.x [m], right tip.x [m], foot.x [m]",
        "left shift.u [m], right shift.u [m], left bend.v [m]",
        "left tip.x_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "clock_pendulum",
        flexible.clock_pendulum,
        20.0,
        "bob.x [m], bob.y [m], bob.angle [rad]",
        "suspension bend.v [m]",
        "bob.x_dot [m/s]",
        "cheeks.M [N m]",
        damped=True,
    ),
    _new_case(
        "hammered_cantilever",
        flexible.hammered_cantilever,
        0.6,
        "ball.y [m], tip.y [m]",
        "shift.v [m], shift.phi [rad], strip bend.v [m]",
        "ball.y_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "crossed_bridge",
        flexible.crossed_bridge,
        1.0,
        "quarter.y [m], end.angle [rad]",
        "girder bend.v [m]",
        "quarter.y_dot [m/s]",
        "left.Fy [N]",
        damped=True,
    ),
    _new_case(
        "drag_flag",
        flexible.drag_flag,
        3.0,
        _TIP,
        "bend.v [m]",
        "tip.x_dot [m/s]",
        "hinge.Fx [N], hinge.Fy [N]",
        damped=True,
    ),
    _new_case(
        "bead_in_bowl",
        flexible.bead_in_bowl,
        2.0,
        "bead.x [m], bead.y [m]",
        "bend.u [m], bend.phi [rad]",
        "bead.x_dot [m/s]",
        "slide.Fy [N]",
        damped=True,
    ),
    _new_case(
        "blade_in_gusts",
        flexible.blade_in_gusts,
        3.0,
        _TIP,
        "bend.v [m]",
        "tip.x_dot [m/s]",
        "motor.M [N m]",
        damped=True,
    ),
    _new_case(
        "tethered_satellites",
        flexible.tethered_satellites,
        12.0,
        "inner.x [m], inner.y [m], outer.x [m], outer.y [m], outer.angle [rad]",
        "bend.v [m]",
        "outer.x_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "falling_mast",
        flexible.falling_mast,
        2.0,
        _TIP,
        "bend.v [m]",
        "tip.x_dot [m/s]",
        "foot.Fx [N], foot.Fy [N]",
        damped=True,
    ),
    _new_case(
        "five_bar",
        flexible.five_bar,
        2.0,
        "tool.x [m], tool.y [m], tool.angle [rad]",
        "left link bend.v [m], right link bend.v [m]",
        "tool.x_dot [m/s]",
        "left motor.M [N m]",
        damped=True,
    ),
    _new_case(
        "running_blade",
        flexible.running_blade,
        1.5,
        "trunk.y [m], toe.x [m], toe.y [m]",
        "shift.u [m], shift.v [m]",
        "trunk.y_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "jib_crane",
        flexible.jib_crane,
        6.0,
        "load.x [m], load.y [m], tip.y [m]",
        "jib bend.v [m]",
        "load.x_dot [m/s]",
        "mast.M [N m]",
        damped=True,
    ),
    _new_case(
        "gas_engine",
        flexible.gas_engine,
        1.0,
        "piston.x [m], crank.x [m]",
        "rod bend.v [m]",
        "piston.x_dot [m/s]",
        "wrist.Fx [N], wrist.Fy [N]",
        damped=True,
    ),
    _new_case(
        "exact_chain",
        flexible.exact_chain,
        2.0,
        "knee.x [m], knee.y [m], tip.x [m], tip.y [m]",
        "upper bend.v [m], lower bend.v [m]",
        "tip.x_dot [m/s]",
        "top.Fx [N], top.Fy [N]",
        damped=True,
    ),
    _new_case(
        "rolling_arm",
        flexible.rolling_arm,
        4.0,
        "wheel.x [m], tip.x [m], tip.y [m]",
        "arm bend.v [m]",
        "tip.x_dot [m/s]",
        "axle.Fx [N], axle.Fy [N]",
        damped=True,
    ),
    _new_case(
        "shallow_arch",
        shallow_arch,
        0.1,
        "crown.y [m], quarter.y [m], quarter.angle [rad]",
        "arch bend.v [m]",
        "crown.y_dot [m/s]",
        "right.Fx [N]",
        damped=True,
        beams=("arch",),
        elements=4,
    ),
    _new_case(
        "leaf_spring_vehicle",
        leaf_spring_vehicle,
        1.0,
        "chassis.y [m], axle.y [m]",
        "leaf 1 bend.v [m]",
        "axle.y_dot [m/s]",
        "bump stop.N [N]",
        damped=True,
        beams=("leaf 1",),
        elements=2,
    ),
    _new_case(
        "example_four_bar",
        example_four_bar,
        2.0,
        "rocker.x [m], rocker.y [m], rocker.angle [rad]",
        "coupler.v [m]",
        "rocker.x_dot [m/s]",
        "rocker pin.Fx [N], motor.M [N m]",
        damped=True,
        elements=4,
    ),
)
LUMPED = (
    replace(
        _new_case(
            "kepler", lumped.kepler, 3.0 * lumped.KEPLER_PERIOD, "planet.x [m], planet.y [m]"
        ),
        exact=lumped.kepler_motion,
    ),
    _new_case(
        "spring_pendulum",
        lumped.spring_pendulum,
        10.0,
        "ball.x [m], ball.y [m]",
        rates="ball.x_dot [m/s]",
        reactions="spring [N]",
    ),
    _new_case(
        "kapitza",
        lumped.kapitza,
        5.0,
        "rod.x [m], rod.angle [rad]",
        rates="rod.angle_dot [rad/s]",
        reactions="shaker.F [N]",
        damped=True,
    ),
    _new_case(
        "stick_slip",
        lumped.stick_slip,
        4.0,
        "block.x [m]",
        rates="block.x_dot [m/s]",
        reactions="rubbing.F [N]",
        damped=True,
    ),
    _new_case(
        "magnet_ball",
        lumped.magnet_ball,
        3.0,
        "ball.x [m], ball.y [m]",
        rates="ball.x_dot [m/s]",
        reactions="thread.F [N]",
    ),
    _new_case(
        "bouncing_ball",
        lumped.bouncing_ball,
        3.0,
        "ball.x [m], ball.y [m]",
        rates="ball.y_dot [m/s]",
        damped=True,
    ),
    _new_case(
        "figure_eight",
        lumped.figure_eight,
        12.0,
        "star 0.x [m], star 0.y [m], star 1.x [m], star 1.y [m]",
        rates="star 0.x_dot [m/s]",
    ),
    _new_case(
        "geared_rotors",
        lumped.geared_rotors,
        2.0,
        "motor.angle [rad], rotor.angle [rad]",
        "twist.phi [rad]",
        "motor.angle_dot [rad/s]",
        "gear.M [N m]",
        damped=True,
    ),
    _new_case(
        "driven_pendulum",
        lumped.driven_pendulum,
        10.0,
        _TIP,
        rates="tip.x_dot [m/s]",
        reactions="hinge.Fx [N], hinge.Fy [N]",
        damped=True,
    ),
    _new_case(
        "governor",
        governor,
        1.0,
        "rotor.angle [rad]",
        "right weight.phi [rad]",
        "rotor.angle_dot [rad/s]",
        "gear.M [N m]",
        damped=True,
    ),
    _new_case(
        "quick_return",
        quick_return,
        3.0,
        "ram.x [m], lever.x [m], lever.angle [rad]",
        rates="ram.x_dot [m/s]",
        reactions="motor.M [N m]",
        damped=True,
    ),
    replace(
        _new_case("double_four_bar_long", mechanisms.double_four_bar, 10.0, ", ".join(TOPS)),
        exact=mechanisms.double_four_bar_motion,
    ),
)
NEW = (*FLEXIBLE, *LUMPED)
ALL = (*WIDE, *NEW)
