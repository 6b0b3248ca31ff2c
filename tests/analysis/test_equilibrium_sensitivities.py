"""Derivatives of equilibria and critical loads: closed forms, scaling, differences of paths."""

import mechanisms
import numpy as np
import pytest
from differentiable_models import assert_close, differentiate
from four_bar import four_bar
from leaf_spring_vehicle import leaf_spring_vehicle
from mechanisms import clamped_beam, free_ball, hinged_body, rectangle
from numpy.testing import assert_allclose
from pendulum import pendulum
from quick_return import quick_return
from ring_mount import ring_mount
from shallow_arch import shallow_arch

import beamdae as bd

truss = bd.model(t_end=1.0)(mechanisms.truss)
ziegler = bd.model(t_end=1.0)(mechanisms.ziegler)

G = 9.81
SLOW = pytest.mark.slow(reason="another variant of a test of half a second")


@bd.model(t_end=1.0)
def hanging(stiffness=400.0, mass=2.0, length=0.5, load=3.0, damping=0.0):
    """Mass on a vertical spring, under its weight and a force."""
    mech, bob = free_ball((0.0, -length), mass, name="bob", gravity=G)
    hook = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", hook, bob.point, direction=(0.0, 1.0)))
    mech.add(bd.Spring("spring", hook, bob.point, stiffness, damping))
    mech.add(bd.Force("pull", bob.point, (0.5 * load, -load)))
    mech.observe("guide", mech.parts["guide"].reaction)
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_hanging_mass_has_the_derivatives_of_its_closed_form():
    names = ["stiffness", "mass", "length", "load"]
    result = bd.equilibrium_sensitivities(hanging, names, loads=["pull"], to=[0.5, 2.0])
    mu = result.equilibrium.factors[:, 0]
    expected = {
        "stiffness": (2.0 * G + 3.0 * mu) / 400.0**2,
        "mass": np.full_like(mu, -G / 400.0),
        "length": np.full_like(mu, -1.0),
        "load": -mu / 400.0,
    }
    for name in names:
        assert_allclose(result.sensitivity("bob.y", name), expected[name], rtol=1e-9, atol=1e-15)
        assert np.all(result.sensitivity("load factor", name) == 0.0)
    force = result.equilibrium.columns["guide.F [N]"]
    assert_allclose(result.sensitivity("guide.F", "load"), force / 3.0, rtol=1e-9, atol=1e-12)


@pytest.mark.slow(reason="half a second and more")
def test_prescribed_position_has_derivatives_of_the_load_factor():
    # The weight and mu times the load stretch the spring by 0.1 m: 2 G + 3 mu = 40.
    result = bd.equilibrium_sensitivities(
        hanging, ["stiffness", "mass", "load"], loads=["pull"], to={"bob.y": -0.6}
    )
    factor = (40.0 - 2.0 * G) / 3.0
    assert result.equilibrium.factor == pytest.approx(factor, rel=1e-12)
    expected = {"stiffness": 0.1 / 3.0, "mass": -G / 3.0, "load": -factor / 3.0}
    for name, value in expected.items():
        assert result.sensitivity("load factor", name).iloc[-1] == pytest.approx(value, rel=1e-9)
        assert result.sensitivity("bob.y", name).iloc[-1] == pytest.approx(0.0, abs=1e-15)
        # The path begins at the load factor zero, not at a prescribed position.
        assert result.sensitivity("load factor", name).iloc[0] == 0.0


def test_equilibria_of_rigid_bodies_depend_on_no_mass_and_their_reactions_on_it():
    """A rigid pendulum at rest has no stiffness but that of its reactions."""

    @bd.model(t_end=1.0)
    def plumb(mass=2.0, offset=0.3):
        mech, bob = hinged_body(mass, center=(1.0, 0.0), gravity=G)
        mech.observe("bob", bob.at(1.0, offset))
        mech.observe("pin", mech.part("hinge").reaction)
        return mech

    result = bd.equilibrium_sensitivities(plumb, ["mass", "offset"])
    factors = result.equilibrium.factors[:, 0]
    assert_allclose(result.sensitivity("bob.y", "mass"), 0.0, atol=1e-12)
    assert_allclose(result.sensitivity("pin.Fy", "mass"), G * factors, rtol=1e-9)
    assert_allclose(result.sensitivity("bob.x", "offset"), 1.0, rtol=1e-9)


@pytest.mark.slow(reason="half a second and more")
def test_stages_of_loads():
    result = bd.equilibrium_sensitivities(hanging, "mass", loads=[["gravity"], ["pull"]], to=0.5)
    first, second = result.equilibrium.factors.T
    assert {0.0, 1.0} <= set(first)
    assert {0.0, 0.5} <= set(second)
    assert_allclose(result.sensitivity("bob.y", "mass"), -first * G / 400.0, atol=1e-14)


@bd.model(t_end=1.0)
def post(stiffness=5.0, length=0.4, extra=0.0, side=0.0, tilt=0.0):
    """Rigid post on springs, pressed from above.

    It buckles at (stiffness + extra) / length + side * length.
    """
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody("post", 1.0, 0.1, (0.0, 0.5 * length)))
    foot = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("foot", foot, rod.at(0.0, 0.0)))
    mech.add(bd.TorsionSpring("spring", foot, rod.at(0.0, 0.0), stiffness))
    mech.add(bd.TorsionSpring("extra", foot, rod.at(0.0, 0.0), extra))
    mech.add(bd.Spring("side", mech.ground.at(1.0, length), rod.at(0.0, length), side, 0.1))
    mech.add(bd.Force("press", rod.at(0.0, length), (tilt, -1.0)))
    mech.observe("tip", rod.at(0.0, length))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_branch_point_of_a_post_has_a_closed_form():
    names = ["stiffness", "length", "extra", "side", "tilt"]
    with pytest.warns(bd.BeamdaeWarning, match="tilt does not preserve the branch point"):
        result = bd.equilibrium_sensitivities(post, names, to=15.0)
    ((kind, load, *rates),) = result.critical_table().to_numpy()
    assert kind == "branch point"
    assert load == pytest.approx(12.5, rel=1e-8)
    expected = [1.0 / 0.4, -5.0 / 0.4**2, 1.0 / 0.4, 0.4]
    assert_allclose(np.array(rates[:-1], float), expected, rtol=1e-9)
    # An imperfection turns the branch point into a limit point: the derivative does not exist.
    assert np.isnan(rates[-1])


@bd.model(t_end=1.0)
def twin_posts(stiffness=5.0, other=5.0):
    """Two posts, which buckle at the same load."""
    mech = bd.Mechanism()
    for name, x, spring in (("one", 0.0, stiffness), ("two", 1.0, other)):
        rod = mech.add(bd.RigidBody(name, 1.0, 0.1, (x, 0.2)))
        foot = mech.ground.at(x, 0.0)
        mech.add(bd.Revolute(f"foot {name}", foot, rod.at(x, 0.0)))
        mech.add(bd.TorsionSpring(f"spring {name}", foot, rod.at(x, 0.0), spring))
        mech.add(bd.Force(f"press {name}", rod.at(x, 0.4), (0.0, -1.0)))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore:equilibrium:beamdae.BeamdaeWarning")
def test_branch_points_with_two_critical_modes_have_no_derivative():
    with pytest.warns(bd.BeamdaeWarning, match="several modes are critical there"):
        result = bd.equilibrium_sensitivities(twin_posts, "stiffness", to=15.0)
    assert result.critical_table().iloc[:, 2].isna().all()
    single = bd.equilibrium_sensitivities(
        twin_posts, "stiffness", to=13.0, parameters={"other": 6.0}
    )
    assert single.critical_table().iloc[0, 2] == pytest.approx(2.5, rel=1e-9)


def limit_point(rise, stiffness, span):
    """Return load and height at the limit point, where the bars have the length (L0 s^2)^(1/3)."""
    length = (np.sqrt(span**2 + rise**2) * span**2) ** (1.0 / 3.0)
    height = np.sqrt(length**2 - span**2)
    return 2.0 * stiffness * (np.sqrt(span**2 + rise**2) / length - 1.0) * height, height


@pytest.mark.parametrize("unit", [1.0, pytest.param(1000.0, marks=SLOW)], ids=["m", "mm"])
@pytest.mark.slow(reason="half a second and more")
def test_limit_point_of_a_truss_has_a_closed_form(unit):
    values = {"rise": 0.2 * unit, "stiffness": 1000.0 / unit, "span": 1.0 * unit}
    result = bd.equilibrium_sensitivities(
        truss, list(values), to={"crown.y": 0.0}, parameters=values
    )
    (point,) = result.equilibrium.critical
    table = result.critical_table()
    for name in values:
        step = {**values, name: values[name] * (1.0 + 1e-30j)}
        expected = [x.imag / (1e-30 * values[name]) for x in limit_point(**step)]
        assert table[f"d(load factor)/d({name}) [- per unit of {name}]"][0] == pytest.approx(
            expected[0], rel=1e-9
        )
        # Columns follow the limit point.
        height = result.sensitivity("crown.y", name).iloc[point.row]
        assert_close(height, expected[1], values[name], limit_point(**values)[1], 1e-10)


@pytest.mark.parametrize("damping", [0.0, pytest.param(0.3, marks=SLOW)])
@pytest.mark.slow(reason="half a second and more")
def test_flutter_point_has_a_closed_form(damping):
    names = ["stiffness", "length", "mass"]
    result = bd.equilibrium_sensitivities(ziegler, names, to=3.0, parameters={"damping": damping})
    ((kind, factor, *rates),) = result.critical_table().to_numpy()
    assert kind == "flutter point"
    # Without damping, P l / k = 7/2 - sqrt(2) (Ziegler, Ing.-Arch. 20 (1952) 49); with damping,
    # P l / k = 41/28 + c^2 / (2 k m l^2) (Herrmann & Jong, J. Appl. Mech. 32 (1965) 592).
    if damping:
        share = 0.5 * damping**2
        expected = [41.0 / 28.0, -41.0 / 28.0 - 3.0 * share, -share]
    else:
        load = 3.5 - np.sqrt(2.0)
        expected = [load, -load, 0.0]
    # The search stops at 1e-6 of a step; eigenvalues that coalesce are less accurate.
    assert_allclose(rates, expected, rtol=1e-5, atol=1e-6)
    assert rates[0] - 3.0 * rates[2] == pytest.approx(-rates[1], rel=1e-5)
    assert factor == pytest.approx(rates[0] - rates[2], rel=1e-5)


@bd.model(t_end=1.0)
def cantilever(
    E=2e9,
    length=1.0,
    height=0.02,
    width=0.03,
    load=10.0,
    curvature=0.8,
    formulation="exact",
    axes="inertial",
):
    """Curved strip under a force and its weight; large deflections."""
    mech = bd.Mechanism(gravity=(0.0, -G))
    section = rectangle(height, width, material=bd.Material(E=E, nu=0.4, rho=1200.0))
    curve = bd.Arc(1.0 / curvature, length)
    beam = mech.add(bd.Beam("beam", curve, section, 2, formulation=formulation))
    root = mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("tip load", beam.end, (0.0, -load), axes=axes))
    mech.observe("tip", beam.end)
    mech.observe("root", root.reaction)
    mech.observe("stress", beam.stress(0.25 * length, "top"))
    mech.observe("middle", beam.section_forces(0.5 * length))
    return mech


EXACT, FLOATING = {"formulation": "exact"}, {"formulation": "floating frame"}
CANTILEVER = [name for name, value in cantilever.parameters.items() if isinstance(value, float)]
SNAP = {"to": {"crown.y": -0.006}}
# Model, parameters that are differentiated, values of others, path, tolerance.
PATHS = {
    "arch past limit points": (
        shallow_arch,
        ["rise", "height", "span", "load"],
        {"elements": 4},
        SNAP,
        1e-7,
    ),
    # Differences of the shear force, from tiny strains, are accurate to 2e-7.
    "cantilever": (cantilever, CANTILEVER, EXACT, {}, 1e-6),
    "cantilever floating": (cantilever, CANTILEVER, FLOATING, {}, 1e-6),
    "follower load": (cantilever, CANTILEVER, {"axes": "body"}, {}, 1e-6),
    "four_bar": (four_bar, ["rise", "stiffness"], EXACT, {}, 1e-6),
    "four_bar floating": (four_bar, ["height", "rise"], FLOATING, {}, 1e-6),
    "pendulum": (pendulum, ["tip_mass", "angle"], EXACT, {}, 1e-6),
    "pendulum floating": (pendulum, ["radius"], FLOATING, {}, 1e-6),
    "ring_mount": (ring_mount, ["radius"], EXACT, {}, 1e-6),
    # The operators of joints depend on the radius.
    "ring_mount floating": (ring_mount, ["motor_mass", "radius"], FLOATING, {}, 1e-6),
    "leaf_spring_vehicle": (leaf_spring_vehicle, ["sprung_mass"], {}, {}, 1e-6),
    "quick_return": (quick_return, ["crank_radius"], {}, {}, 1e-6),
}


@pytest.mark.slow(reason="five paths of a model per parameter")
@pytest.mark.parametrize("case", PATHS)
def test_ends_and_critical_loads_agree_with_differences_of_paths(case):
    model, names, values, settings, tolerance = PATHS[case]
    result = bd.equilibrium_sensitivities(model, names, parameters=values, **settings)
    path = result.equilibrium

    def end(path):
        loads = [path.factor, *(point.factor for point in path.critical)]
        return loads, path.q[-1], [values[-1] for values in path.columns.values()]

    # Errors of forces are relative to the largest force at the same place.
    groups = [x.partition(".")[0] for x in path.columns]
    columns = np.abs(end(path)[2])
    size = [columns[[x == group for x in groups]].max() for group in groups]
    for name in names:
        expected = [
            differentiate(lambda x, k=k: end(bd.equilibrium(x, **settings))[k], model, name, values)
            for k in range(3)
        ]
        rates = result.factors[name].sum(axis=1)
        loads = [rates[-1], *(rates[point.row] for point in path.critical)]
        value = result.parameters[name]
        assert_close(loads, expected[0], value, end(path)[0], tolerance)
        assert_close(result.q[name][-1], expected[1], value, np.abs(path.q[-1]).max(), 1e-7)
        actual = [result.sensitivity(x, name).iloc[-1] for x in path.columns]
        assert_close(actual, expected[2], value, np.maximum(size, 1e-2), tolerance)


@pytest.mark.slow(reason="paths of a beam for three parameters")
def test_functions_of_a_path_agree_with_differences_of_section_forces():
    # Section forces from the balance of loads, at sections that keep their relative position.
    names = ["height", "length", "load"]
    result = bd.equilibrium_sensitivities(cantilever, names)

    def forces(path):
        sections = path.section_forces("beam")
        return np.stack([sections.N, sections.Q, sections.M])

    for name in names:
        expected = differentiate(lambda x: forces(bd.equilibrium(x)), cantilever, name, {})
        actual = result.derivative(forces, name)
        assert_allclose(actual, expected, atol=1e-6 * np.abs(expected).max())


@bd.model(t_end=1.0)
def euler_column(height=0.01, E=2e11, length=1.0):
    """Clamped column under a multiple of E I."""
    section = rectangle(height, material=bd.Material(E=E, nu=0.3, rho=7800.0))
    mech, beam = clamped_beam(section, 8, length, name="column", formulation="exact")
    mech.add(bd.Force("press", beam.end, (-E * 0.02 * height**3 / 12.0, 0.0)))
    return mech


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4])
def test_buckling_loads_of_thin_columns_are_differentiated_without_rounding(height):
    result = bd.equilibrium_sensitivities(
        euler_column, ["E", "length", "height"], to=3.0, parameters={"height": height}
    )
    load, by_modulus, by_length, by_height = result.critical_table().iloc[0, 1:]
    assert load == pytest.approx(0.25 * np.pi**2, rel=height**2 + 1e-5)
    assert abs(by_modulus * 2e11) < 1e-7
    # Shear and compression reduce the load by a fraction in proportion to (height / length)^2.
    assert by_length == pytest.approx(-2.0 * load, rel=2.0 * height**2 + 1e-7)
    assert by_height * height == pytest.approx(-2.15 * height**2, rel=0.01, abs=2e-7)


@pytest.mark.slow(reason="several paths")
def test_springs_without_stiffness_have_derivatives():
    bent = {"to": 2.0, "parameters": {"tilt": 1.0}}
    result = bd.equilibrium_sensitivities(post, ["extra", "side"], **bent)
    modes = bd.mode_sensitivities(post, ["extra", "side"])
    for name in ("extra", "side"):
        tips, values = [], []
        for k in range(5):
            mech = {name: k * 1e-4}
            tips.append(bd.equilibrium(post(tilt=1.0, **mech), to=2.0)["tip.x"].iloc[-1])
            values.append(bd.modes(post(**mech)).eigenvalues)
        one_sided = np.array([-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4]) / 1e-4
        assert result.sensitivity("tip.x", name).iloc[-1] == pytest.approx(one_sided @ tips)
        assert_allclose(modes.eigenvalues[name], one_sided @ values, rtol=1e-6)


@bd.model(t_end=1.0)
def lift(load=10.0, width=0.4):
    """Plate on a spring, guided by three rails, one of which is redundant."""
    mech = bd.Mechanism(redundant="minimum norm")
    plate = mech.add(bd.RigidBody("plate", 2.0, 0.1, (0.5 * width, 0.3)))
    for name, x, y in (("low", 0.0, 0.3), ("high", 0.0, 0.5), ("right", width, 0.3)):
        foot = mech.ground.at(x, 0.0)
        guide = mech.add(bd.PointOnLine(name, foot, plate.at(x, y), (0.0, 1.0)))
        mech.observe(name, guide.reaction)
    middle = plate.at(0.5 * width, 0.3)
    mech.add(bd.Spring("spring", mech.ground.at(0.5 * width, -1.0), middle, 500.0))
    mech.add(bd.Force("push", plate.at(width, 0.35), (load, -load)))
    return mech


@pytest.mark.slow(reason="half a second and more")
def test_reactions_of_redundant_constraints_have_minimum_norm():
    result = bd.equilibrium_sensitivities(lift, ["load", "width"])
    # Forces X on the low and right rails, Y on the high rail: 2 X + Y = F, and the moment of Y
    # about the low rail, 0.2 m, balances F (0.05 m + width / 2).
    share = {"load": 1.25, "width": 25.0}
    for name, high in share.items():
        low = 0.5 * ((1.0 if name == "load" else 0.0) - high)
        for rail, value in (("low", low), ("right", low), ("high", high)):
            rate = result.sensitivity(f"{rail}.F", name).iloc[-1]
            assert rate == pytest.approx(value, rel=1e-9)


def test_functions_of_the_path_agree_with_columns():
    result = bd.equilibrium_sensitivities(truss, "rise", to={"crown.y": 0.1})
    derivative = result.derivative(lambda path: path.factors[:, 0], "rise")
    assert_allclose(derivative, result.factors["rise"][:, 0], rtol=1e-8, atol=1e-9)
    table = result.table()
    assert list(table)[:2] == ["load factor [-]", "d(load factor)/d(rise) [- per unit of rise]"]
    assert "d(crown.y)/d(rise) [m per unit of rise]" in table


@pytest.mark.parametrize(
    ("model", "by", "settings", "message"),
    [
        (hanging, "stifness", {}, "no parameter 'stifness' .did you mean 'stiffness'"),
        (truss, "rise", {"to": 5.0}, "the path of truss did not reach its end"),
        (truss, "rise", {"to": {"crown.y": 0.1}, "loads": ["other"]}, "no part has this name"),
    ],
)
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_refusals(model, by, settings, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.equilibrium_sensitivities(model, by, **settings)


@bd.model(t_end=1.0)
def loose(stiffness=10.0):
    return free_ball((1.0, 0.0), name="bob", spring=(stiffness,))[0]


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_equilibria_that_can_move_have_no_derivative():
    with pytest.raises(bd.BeamdaeError, match=r"bob\.y of loose can move without stiffness"):
        bd.equilibrium_sensitivities(loose, "stiffness")


@pytest.mark.slow(reason="equilibria of thin arcs")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize("height", [2e-2, 2e-3, 2e-4])
def test_derivatives_of_section_forces_of_thin_arcs_follow_from_similarity(height, formulation):
    """Differences of residuals enlarge rounding errors of small strains: up to 30 % of dN/dr."""

    @bd.model(t_end=1.0)
    def arc(radius=0.5, height=height, width=0.02, load=-1e-3 * (height / 2e-3) ** 3):
        section = rectangle(height, width)
        mech, beam = clamped_beam(
            section,
            6,
            bd.Arc(radius, 0.9 * radius, start=(0.0, 0.0), angle=0.4),
            name="arc",
            formulation=formulation,
        )
        mech.add(bd.Force("push", beam.end, (0.3 * load, load)))
        mech.observe("section", beam.section_forces(0.31 * radius))
        return mech

    result = bd.equilibrium_sensitivities(arc, list(arc.parameters))
    for column, degree in (("section.N", 2), ("section.Q", 2), ("section.M", 3)):
        # Forces are proportional to the square of the scale of lengths if loads are.
        value = result.equilibrium[column].iloc[-1]
        rates = {x: result.sensitivity(column, x).iloc[-1] * y for x, y in arc.parameters.items()}
        total = rates["radius"] + rates["height"] + rates["width"] + 2.0 * rates["load"]
        assert total == pytest.approx(degree * value, rel=2e-3)
        # Thin arcs under small loads are statically determinate.
        assert rates["load"] == pytest.approx(value, rel=1e-3)
        assert rates["width"] == pytest.approx(0.0, abs=1e-3 * abs(value))
