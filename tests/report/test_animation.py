"""Animations of runs: trails, inactive parts, failed runs, parts defined by users, MP4 files."""

import re

import numpy as np
import pytest
from hub_beam import hub_beam
from matplotlib import rc_context
from mechanisms import cantilever, falling_ball, free_ball, hinged_body, rectangle, swing
from numpy.testing import assert_allclose
from pendulum import pendulum

import beamdae as bd
from beamdae.parts.part import Drawing
from beamdae.report.scene.mechanism_scene import MAX_BEAM_SECTIONS
from beamdae.report.scene.run_scene import (
    available_colors,
    build_run_scene,
    export_run_frames,
    frame_times,
)

FRAMES = 11


def simulate(mechanism):
    return bd.simulate(mechanism, bd.GeneralizedAlpha(5e-3), 0.2, output_step=0.02)


def scene_lines(solution, **settings):
    """Return the points of each glyph by part and kind, (frames, k, 2)."""
    scene = build_run_scene("test", solution, frame_times(solution, FRAMES), **settings)
    return {(glyph.part, glyph.kind): line for glyph, line in scene.lines()}


@pytest.mark.slow(reason="a quarter of a second")
def test_parts_are_visible_only_while_they_are_active():
    mech = swing()
    hinge = mech.part("hinge")
    mech.observe("bob", mech.part("bob").at(1.0, 0.0))
    mech.when("bob.angle", crosses=-0.05, do=bd.deactivate(hinge), name="let go")
    solution = simulate(mech)
    lines = scene_lines(solution)
    pin, support = lines["hinge", "joint"], lines["ground", "ground"]
    is_absent = np.isnan(pin[:, 0, 0])
    (release_time,) = solution.events["t [s]"]
    assert np.array_equal(is_absent, frame_times(solution, FRAMES) > release_time)
    assert 0 < is_absent.sum() < FRAMES
    assert np.isfinite(support[:, 0]).all()
    (symbol,) = [x for x in export_run_frames(solution)["glyphs"] if x["name"] == "hinge"]
    assert symbol["absent"] == list(range(symbol["absent"][0], 120))
    solution.animate(frames=3)


@pytest.mark.slow(reason="a quarter of a second")
def test_a_run_that_fails_at_the_start_is_drawn(tmp_path):
    mech, ball = free_ball((0.0, 2.0), name="<b>$_ball")
    mech.add(bd.Force("push", ball.point, (lambda t: np.sqrt(-t), 0.0)))
    mech.observe("ball", ball.point)
    solution = bd.simulate(mech, bd.Radau(), t_end=1.0)
    assert solution.status.kind == "failed"
    assert solution.animate(tmp_path / "run.gif", trail=True).stat().st_size > 100
    assert "<b>" not in solution.animate(trail=True)._repr_html_()


def sliding_run(travel, t_end=0.1):
    """Return the run of a rod of 1 m that moves along its axis by `travel` [m]."""
    mech = bd.Mechanism()
    rod = mech.add(
        bd.RigidBody.plate("rod", (0.5, 0.0), 1.0, 0.1, mass=1.0, velocity=(travel / t_end, 0.0))
    )
    mech.observe("end", rod.at(1.0, 0.0))
    return bd.simulate(mech, bd.GeneralizedAlpha(step=0.01), t_end=t_end)


def read_scale(frames):
    """Return the factor of displacements in the caption of an animation."""
    return float((frames["captions"] or "\u00d7 1").split("\u00d7 ")[1])


def test_displacements_that_are_too_small_to_be_visible_are_enlarged():
    for travel, scale in ((0.2, 1.0), (2e-4, 500.0), (2e-6, 50_000.0), (1e-9, 1.0)):
        run = sliding_run(travel)
        frames = export_run_frames(run, 5, enlarges=True)
        assert read_scale(frames) == pytest.approx(scale)
        assert read_scale(export_run_frames(run, 5)) == 1.0
        rod = scene_lines(run, scale=scale)["rod", "rigid"]
        assert_allclose((rod[-1] - rod[0])[:, 0], travel * scale, rtol=1e-6)


def test_the_scale_of_displacements_can_be_chosen():
    run = sliding_run(2e-4)
    assert "displacements \\u00d7 500" in run.animate(frames=3).page
    assert "displacements \\u00d7 20" in run.animate(frames=3, scale=20.0).page
    assert "displacements \\u00d7" not in run.animate(frames=3, scale=1.0).page
    with pytest.raises(bd.BeamdaeError, match=r"^animate: scale must be positive, got 0"):
        run.animate(frames=3, scale=0.0)


def find_default_scale(mechanism, t_end):
    run = bd.simulate(mechanism, bd.GeneralizedAlpha(step=t_end / 20.0), t_end=t_end)
    return read_scale(export_run_frames(run, 5, enlarges=True))


@pytest.mark.parametrize(
    ("speed", "scale"),
    # Rotations of 2 pi, 0.5 mrad and 5 mrad in the run. Displacements are below 1 % of the size.
    [(2.0 * np.pi, 1.0), (5e-4, 200.0), (5e-3, 20.0)],
)
def test_regression_enlarged_bodies_rotate_by_at_most_a_tenth_of_a_radian(speed, scale):
    mech, disc = hinged_body(1.0, 1e-3, name="disc")
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), disc.at(0.0, 0.0), lambda t: speed * t))
    mech.add(bd.Force("load", disc.at(0.005, 0.0), (0.0, 0.0)))
    mech.add(bd.PointMass("far", 1.0, at=(1.5, 0.0)))
    assert find_default_scale(mech, t_end=1.0) == pytest.approx(scale)


def test_regression_enlarged_sections_of_beams_rotate_by_at_most_three_tenths_of_a_radian():
    """They rotated by 0.1 rad, so that the motion of cantilevers was hardly visible."""
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    mech = cantilever(2, line, rectangle(0.003), load=(0.0, 0.05))
    run = bd.simulate(mech, bd.GeneralizedAlpha(step=2e-3), t_end=0.04)
    scale = read_scale(export_run_frames(run, 5, enlarges=True))
    rotation = np.abs(run["tip.angle"]).max()
    # Displacements are at most 12 % of the size.
    assert 0.1 < scale * rotation <= 0.3


@pytest.mark.parametrize("has_contact", [True, False])
def test_regression_mechanisms_with_contacts_are_drawn_with_their_true_motion(has_contact):
    mech, ball = free_ball(gravity=9.81)
    mech.add(bd.PointMass("far", 1.0, at=(1.0, 0.0)))
    if has_contact:
        table = bd.LineSurface(mech.ground.at(0.0, -1e-3))
        mech.add(bd.Contact("touch", ball.point, table, 1e4, exponent=2.0))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 1.0), ball.point, 1e4, free_length=1.0))
    mech.add(bd.Distance("tie", mech.ground.at(1.0, 1.0), mech.parts["far"].point))
    scale = find_default_scale(mech, t_end=0.1)
    assert (scale == 1.0) == has_contact


def test_trails_follow_the_observed_points():
    mechanism = pendulum(elements=1)
    solution = simulate(mechanism)
    trail = scene_lines(solution, trail="tip")["tip", "trail"]
    tip = solution.observed[["tip.x [m]", "tip.y [m]"]].to_numpy()
    # Ten points between two frames.
    assert_allclose(trail[-1, ::10], tip, atol=1e-12)
    assert_allclose(trail[4, :41], trail[-1, :41], atol=1e-15)
    assert np.isnan(trail[4, 41:]).all()
    parts = {part for part, kind in scene_lines(solution, trail=True) if kind == "trail"}
    assert parts == {"tip", "frame"}
    with pytest.raises(bd.BeamdaeError, match=r"trail must be .*, got 'top' \(did you mean 'tip'"):
        scene_lines(solution, trail=["top"])


class Strap(bd.Part):
    """A user-defined part that is drawn through points of several bodies."""

    def __init__(self, name, kind, *ends):
        self.name, self.kind, self.ends = name, kind, ends

    def forces(self, gravity):
        return bd.Spring(self.name, *self.ends, 1.0).forces(gravity)

    def draw(self, attached, points):
        return Drawing(self.kind, list(self.ends))


@pytest.mark.parametrize("kind", ["strap", "rigid"])
def test_a_user_defined_part_is_drawn_through_points_of_several_bodies(kind):
    mech = falling_ball(height=0.0)
    mech.add(Strap("strap", kind, mech.ground.at(0.0, 1.0), mech.part("ball").point))
    solution = simulate(mech)
    line = scene_lines(solution)["strap", kind]
    assert_allclose(line[:, 0], [(0.0, 1.0)] * FRAMES, atol=0)
    assert_allclose(line[:, 1], solution.observed[["ball.x [m]", "ball.y [m]"]], atol=1e-12)
    assert mech.draw().figure.axes


def test_mp4_files_pass_each_frame_to_ffmpeg(tmp_path):
    """A script in place of ffmpeg counts the bytes it receives."""
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\nwc -c > "$last"\n')
    program.chmod(0o755)
    mech = falling_ball()
    with rc_context({"animation.ffmpeg_path": str(program)}):
        path = simulate(mech).animate(tmp_path / "run.mp4", frames=4)
    width, height = 200, 600
    assert int(path.read_text()) == 4 * 4 * width * height


@pytest.mark.parametrize("what", ["strain", "stress", "N", "Q", "M"])
def test_colors_equal_the_observed_values_along_the_beam(what):
    mechanism = pendulum(elements=2)
    beam = mechanism.part("beam")
    s = beam.length / 4.0
    mechanism.observe("top", getattr(beam, what)(s, "top") if len(what) > 1 else beam.end)
    mechanism.observe("bottom", getattr(beam, what)(s, "bottom") if len(what) > 1 else beam.end)
    mechanism.observe("forces", beam.section_forces(s))
    solution = simulate(mechanism)
    colors = available_colors(solution, frame_times(solution, FRAMES), what)[0]
    values = colors.values["beam"][:, (MAX_BEAM_SECTIONS - 1) // 4]
    table = solution.observed
    if len(what) > 1:
        unit = {"strain": "-", "stress": "Pa"}[what]
        expected = table[[f"top [{unit}]", f"bottom [{unit}]"]].abs().max(axis=1)
    else:
        expected = table[next(c for c in table if c.startswith(f"forces.{what} "))]
    scale = np.max(np.abs(expected))
    # Rounding of the times, amplified by the rates of vibrating strains.
    prefix = re.search(r"\[(10[⁻⁰-⁹]+|[nµmkMG])?", colors.title)[1]
    factor = {None: 1.0, "m": 1e-3, "k": 1e3, "M": 1e6, "10⁻³": 1e-3, "10⁻⁶": 1e-6}[prefix]
    assert_allclose(values * factor, expected, rtol=0, atol=1e-9 * scale)
    sizes = np.abs(colors.values["beam"])
    assert sizes.max() <= colors.limits[1] * (1.0 + 1e-12)
    assert colors.limits[0] == (-colors.limits[1] if len(what) == 1 else 0.0)


def test_unavailable_colors_are_rejected():
    solution = simulate(hub_beam(elements=1))
    with pytest.raises(bd.BeamdaeError, match="offset 'top' requires the height of the section"):
        solution.animate(color="stress")
    with pytest.raises(bd.BeamdaeError, match=r"animate: color must be .*'strian'"):
        solution.animate(color="strian")
    ball = bd.Mechanism()
    ball.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    with pytest.raises(
        bd.BeamdaeError, match="color 'M' requires a beam, but the mechanism has none; omit color"
    ):
        simulate(ball).animate(color="M")
