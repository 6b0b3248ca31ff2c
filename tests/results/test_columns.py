"""Selection of columns by name."""

import pytest
from mechanisms import EARTH, free_ball

import beamdae as bd


def falling(*names):
    """Return a run of falling masses, which are all observed."""
    mech = bd.Mechanism(gravity=EARTH)
    for k, name in enumerate(names):
        mech.observe(name, mech.add(bd.PointMass(f"mass {k}", 1.0, at=(k, 2.0))).point)
    return mech


@pytest.fixture(scope="module")
def run():
    return bd.simulate(falling("tip"), t_end=0.1)


def test_a_single_column_is_selected_with_or_without_its_unit(run):
    for name in ("tip.y", "tip.y [m]"):
        assert run[name].name == "tip.y [m]"


@pytest.mark.parametrize("name", ["ti", "tip.y [N]", 3, None])
def test_names_of_no_column_are_rejected(name, run):
    with pytest.raises(bd.BeamdaeError, match=r"column"):
        run[name]


def test_regression_a_list_of_names_selects_a_table_over_time():
    mech, _ = free_ball((0.0, 2.0), gravity=9.81)
    run = bd.simulate(mech, t_end=0.1)
    table = run[["ball.y", "ball.x [m]", "ball.y"]]
    assert list(table) == ["ball.y [m]", "ball.x [m]"]
    assert table.index.name == "t [s]"
    assert list(run[["ball.y"]]) == ["ball.y [m]"]
    with pytest.raises(bd.BeamdaeError, match=r"no column 'ball\.z'"):
        run[["ball.y", "ball.z"]]
    with pytest.raises(AttributeError, match=r"plot\.save\(path\)"):
        run.plot("ball.y").savefig("y.png")


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("motr.M", "motor.M"),
        ("motor.T", "motor.M"),
        ("knee 2.z", "knee 2.y"),
    ],
)
def test_regression_messages_list_the_most_similar_columns_first(name, first):
    """Torques of drivers were hidden behind "and 2 more"."""
    mech = falling(*(f"{point} {k}" for point in ("tip", "knee") for k in range(5)))
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.1))
    center = mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", *center))
    motor = mech.add(bd.Driver("motor", *center, bd.sine(1.0, 2.0)))
    mech.observe("motor", motor.reaction)
    with pytest.raises(bd.BeamdaeError) as caught:
        bd.simulate(mech, t_end=1e-3)[name]
    listed = str(caught.value).partition("available columns: ")[2]
    assert listed.startswith(f"{first}, ")
    assert listed.endswith(" more.")
