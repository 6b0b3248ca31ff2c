"""Live view: answers to requests of its page, refusals of others, the command, and a browser."""

import http.client
import json
import re
import signal
import subprocess
import sys
import threading
from typing import Literal

import numpy as np
import pytest
from mechanisms import rope_swing
from pages import find_violations, open_tab
from terminals import process

import beamdae as bd
from beamdae import live as live_session
from beamdae.live import create_controls


@bd.model(t_end=0.2)
def swing(length=0.5, mass=2.0, copies=1, tilt=0.0, color="red", is_fast=False, points=(1.0, 2.0)):
    """Release a mass of `mass` [kg] on a rope of `length` [m] at `tilt` [rad]."""
    if color == "broken":
        raise ZeroDivisionError("division by zero")
    return rope_swing(length, mass)


@pytest.fixture
def live():
    live = swing.view()
    yield live
    live.close()


def send(live, action, body=None, method=None, token=None, **headers):
    """Return the status and the content of the answer to a request."""
    connection = http.client.HTTPConnection("127.0.0.1", live.port, timeout=30)
    path = f"/{live.token if token is None else token}/{action}"
    content = None if body is None else json.dumps(body)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    if body is not None:
        headers.setdefault("Content-Type", "application/json")
    method = method or ("GET" if body is None else "POST")
    try:
        connection.request(method, path, content, headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def ask(live, action, **values):
    status, text = send(live, action, {"values": values})
    assert status == 200, text
    return json.loads(text)


def test_the_page_contains_controls_and_drawing(live):
    status, page = send(live, "")
    assert status == 200
    assert "<title>swing</title>" in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page)[1])
    assert [x["kind"] for x in data["controls"]] == [
        *("number", "number", "integer", "number", "text", "flag", "text")
    ]
    assert data["controls"][0] == {
        **{"name": "length", "value": 0.5, "unit": "m", "kind": "number"},
        **{"low": 0.125, "high": 2.0, "log": True},
        "description": swing.parameter_info["length"].description,
    }
    assert data["first"]["frames"]["glyphs"]
    assert live.url in live._repr_html_()


def test_regression_the_page_shows_no_earlier_error(tmp_path):
    """The page kept an error of its first drawing until the view was closed."""
    file = tmp_path / "length.txt"

    @bd.model(t_end=0.1)
    def measured(mass=1.0):
        return swing(length=float(file.read_text()))

    live = measured.view()
    assert '"first":{"error":' in send(live, "")[1]
    file.write_text("0.5")
    assert '"first":{"frames":' in send(live, "")[1]
    live.close()


def test_the_drawing_follows_the_parameters(live):
    extents = [ask(live, "draw", length=x)["frames"]["extent"] for x in (0.5, 1.0, "800 mm")]
    assert [high[0] for _, high in extents] == pytest.approx([0.5, 1.0, 0.8], rel=0.1)


def test_a_run_is_animated_and_summarized(live):
    answer = ask(live, "run", length=1.0)
    assert answer["status"].startswith("reached the end; ")
    assert answer["ok"]
    assert len(answer["frames"]["t"][""]) > 100
    rows = {row[0]: row for row in answer["table"]["rows"]}
    assert float(rows["bob.y [m]"][1]) == pytest.approx(-0.19, abs=0.02)
    short = send(live, "run", {"values": {}, "t_end": 0.1})[1]
    assert json.loads(short)["status"].startswith("reached the end")


ERRORS = {
    "length": [("850 N", "measures another quantity; give the value in m."), ("x", "type float")],
    "copies": [(1.5, "must be of type int"), (None, "must be of type int")],
    "speed": [(1.0, "there is no parameter 'speed'; available parameters: length, mass")],
    "mass": [(float("nan"), "mass must be finite"), (-1.0, "mass")],
    "color": [("broken", "division by zero")],
    "points": [("(1, ", "must be of type tuple")],
}


def test_mistakes_are_sentences(live):
    for name, cases in ERRORS.items():
        for value, sentence in cases:
            for action in ("draw", "run"):
                answer = ask(live, action, **{name: value})
                assert list(answer) == ["error"], answer
                assert sentence in answer["error"]
                assert "\n" not in answer["error"]
    end = json.loads(send(live, "run", {"values": {}, "t_end": -1.0})[1])
    assert "t_end" in end["error"]


def test_only_the_page_of_this_server_is_answered(live):
    host = f"127.0.0.1:{live.port}"
    body = {"values": {}}
    for good in (
        {"Origin": f"http://{host}"},
        {"Host": f"localhost:{live.port}", "Origin": f"http://localhost:{live.port}"},
        {"Sec_Fetch_Site": "same-origin"},
    ):
        assert send(live, "draw", body, **good)[0] == 200, good
    for bad in (
        {"Origin": "http://example.org"},
        {"Origin": f"https://{host}"},
        {"Origin": "null"},
        {"Host": f"example.org:{live.port}"},
        {"Host": "127.0.0.1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"token": "x"},
        {"token": ""},
        {"token": live.token[:-1]},
        {"token": live.token + "/.."},
    ):
        assert send(live, "draw", body, **bad)[0] == (404 if ".." in str(bad) else 403), bad
        if "Sec_Fetch_Site" not in bad:
            assert send(live, "", **bad)[0] == (404 if ".." in str(bad) else 403), bad
    connection = http.client.HTTPConnection("127.0.0.1", live.port, timeout=30)
    connection.request("GET", "/")
    answer = connection.getresponse()
    assert answer.status == 403
    assert live.token not in str(answer.headers) + answer.read().decode()
    connection.close()


def test_wrong_requests_are_refused(live):
    assert send(live, "other")[0] == send(live, "other", {"values": {}})[0] == 404
    assert send(live, "draw", {"values": {}}, Content_Type="text/plain")[0] == 415
    assert send(live, "draw", {"values": {"color": "x" * 200_000}})[0] == 413
    for body in ([], {}, {"values": 3}, "text"):
        assert send(live, "draw", body)[0] == 400
    assert send(live, "", method="PUT")[0] == 501
    assert send(live, "", method="DELETE")[0] == 501


def test_a_later_request_ends_a_run(live, monkeypatch):
    begun, may_end = threading.Event(), threading.Event()
    simulate = live_session.simulate

    def wait(*arguments, progress, **settings):
        begun.set()
        may_end.wait(30.0)
        assert progress(0.1) == "superseded"
        return simulate(*arguments, **settings)

    monkeypatch.setattr(live_session, "simulate", wait)
    answers = []
    run = threading.Thread(target=lambda: answers.append(ask(live, "run")))
    run.start()
    begun.wait(30.0)
    drawing = threading.Thread(target=lambda: answers.append(ask(live, "draw")))
    drawing.start()
    while live.session._latest < 2:
        pass
    may_end.set()
    run.join()
    drawing.join()
    assert sorted(map(list, answers)) == [["frames"], ["superseded"]]


@bd.model(t_end=1.0)
def turned(a=0.0, b=0.0, end: Literal["free", "held"] = "free", size: Literal["M", 2] = "M"):
    """Turn by `a` [rad] and `b` [deg]."""


def test_sliders_of_angles_reach_half_a_turn_and_lists_contain_texts():
    *sliders, end, size = create_controls(turned)
    assert [(x["low"], x["high"]) for x in sliders] == [(-np.pi, np.pi), (-180.0, 180.0)]
    assert (end["kind"], end["choices"]) == ("choice", ["free", "held"])
    assert (size["kind"], size["value"]) == ("text", "M")


def test_ranges_of_sliders():
    by_name = {x["name"]: x for x in create_controls(swing, {"length": ("50 cm", 3.0)})}
    assert (by_name["length"]["low"], by_name["length"]["high"]) == (0.5, 3.0)
    assert not by_name["length"]["log"]
    assert (by_name["copies"]["low"], by_name["copies"]["high"]) == (1, 4)
    for ranges in (
        {"length": (2.0, 1.0)},
        {"length": 3.0},
        {"color": ("a", "b")},
        {"speed": (1, 2)},
    ):
        with pytest.raises(bd.BeamdaeError):
            create_controls(swing, ranges)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"port": -1}, "view: port must be an integer from 0 to 65535, got -1"),
        ({"port": True}, "view: port must be"),
        ({"time_limit": 0.0}, "view: time_limit must be"),
    ],
)
def test_mistakes_in_settings(settings, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        swing.view(**settings)


def test_a_used_port_is_an_error(live):
    with pytest.raises(bd.BeamdaeError, match=f"view: port {live.port} cannot be used"):
        swing.view(port=live.port)


@pytest.mark.slow(reason="starts a process")
def test_the_command_serves_until_interrupted():
    command = process("view", "example:pendulum", "--no-browser", "--range", "radius=50cm:2m")
    address = command.stdout.readline()
    match = re.fullmatch(r"pendulum: http://127\.0\.0\.1:(\d+)/([\w-]+)/\n", address)
    connection = http.client.HTTPConnection("127.0.0.1", int(match[1]), timeout=30)
    connection.request("GET", f"/{match[2]}/")
    answer = connection.getresponse()
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    assert b'"low":0.5' in answer.read()
    connection.close()
    command.send_signal(signal.SIGINT)
    _, errors = command.communicate(timeout=30)
    assert (command.returncode, errors) == (130, "interrupted\n")


@pytest.mark.slow(reason="starts a process")
def test_python_ends_without_closing_a_view(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import beamdae as bd\nlive = bd.load_model('example:pendulum').view()\nprint(live.url)\n"
    )
    result = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith("http://127.0.0.1:")


def test_a_run_ends_at_its_time_limit():
    live = swing.view(t_end=1e3, time_limit=1e-6)
    answer = ask(live, "run")
    live.close()
    assert "reached the time limit of 1e-06 s" in answer["status"]
    assert not answer["ok"]
    assert answer["frames"]


# Live view in a browser: sliders move the drawing, errors are sentences, runs are animated.


@bd.model(t_end=0.2)
def released_swing(length=0.5, mass=2.0):
    """Release a `mass` [kg] on a rope of `length` [m]."""
    return rope_swing(length, mass)


@pytest.fixture
def released():
    released = released_swing.view()
    yield released
    released.close()


@pytest.fixture
def open_live(browser, released):
    """Return a function that opens the live view in a window of this size and color scheme."""
    contexts, messages, requests = [], [], []

    def show(**settings):
        context = browser.new_context(**settings)
        contexts.append(context)
        tab = open_tab(context, released.url, messages, requests)
        wait_for_run(tab)
        return tab

    yield show
    for context in contexts:
        context.close()
    # The browser reports requests to a closed server.
    assert [x for x in messages if "ERR_CONNECTION_REFUSED" not in x] == []
    assert all(url.startswith((released.url, "data:")) for url in requests)


def wait_for_run(tab):
    tab.locator("#state", has_text=" steps, ").wait_for()


def stage(tab):
    paths = tab.locator("#stage path.body:not(.initial)")
    return paths.evaluate_all("paths => paths.map((path) => path.getAttribute('d'))")


def wait_for_drawing(tab, before):
    """Wait until the drawing differs from the one before."""
    for _ in range(500):
        if stage(tab) != before:
            return
        tab.wait_for_timeout(20)
    pytest.fail("the drawing did not change")


def test_a_slider_moves_the_drawing_and_its_release_runs_the_model(open_live):
    tab = open_live(viewport={"width": 1366, "height": 768})
    assert tab.locator("#title").text_content() == "released_swing"
    assert tab.locator("#play").text_content() == "Pause"
    tab.get_by_label("run after each change").uncheck()
    tab.locator("#play").click()
    field, slider = tab.locator("#parameter-length"), tab.get_by_role("slider", name="length")
    slider.focus()
    for _ in range(3):
        before = stage(tab)
        tab.keyboard.press("PageUp")
        wait_for_drawing(tab, before)
    assert 0.5 < float(field.input_value()) < 2.0
    assert tab.locator("#player").is_hidden()
    assert "--set length=" in tab.locator("#command").text_content()
    tab.get_by_label("run after each change").check()
    tab.keyboard.press("Tab")
    slider.focus()
    tab.keyboard.press("PageUp")
    wait_for_run(tab)
    assert tab.locator("#player").is_visible()
    assert tab.locator("#table tbody tr").count() == 4


def test_mistakes_and_units_in_a_field(open_live):
    tab = open_live(viewport={"width": 390, "height": 844}, color_scheme="dark")
    field, state = tab.locator("#parameter-length"), tab.locator("#state")
    before = stage(tab)
    field.fill("3 N")
    field.press("Enter")
    tab.locator("#state", has_text="the unit N measures another quantity").wait_for()
    assert "alarm" in state.get_attribute("class")
    field.fill("800 mm")
    field.press("Enter")
    wait_for_run(tab)
    assert "alarm" not in (state.get_attribute("class") or "")
    assert stage(tab) != before
    tab.locator("#reset").click()
    assert field.input_value() == "0.5"
    assert tab.locator("#command").is_hidden()
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390


@bd.model(t_end=0.1)
def rod(end: Literal["free", "long rope"] = "free"):
    """Hang a mass."""
    return released_swing(length=0.5 if end == "free" else 1.0)


def test_texts_with_known_values_are_chosen_from_a_list(browser):
    released = rod.view()
    context = browser.new_context(viewport={"width": 390, "height": 844}, bypass_csp=True)
    tab = context.new_page()
    tab.goto(released.url)
    wait_for_run(tab)
    before = stage(tab)
    tab.get_by_label("end", exact=True).select_option("long rope")
    wait_for_run(tab)
    wait_for_drawing(tab, before)
    assert "--set 'end=long rope'" in tab.locator("#command").text_content()
    assert find_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    tab.locator("#reset").click()
    assert tab.get_by_label("end", exact=True).input_value() == "free"
    context.close()
    released.close()


def test_a_closed_server_is_a_sentence(open_live, released):
    tab = open_live(viewport={"width": 1366, "height": 768})
    released.close()
    tab.locator("#run").click()
    tab.locator("#state", has_text="The server does not answer").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_live_view_has_no_violations(browser, released, scheme):
    # Axe is a script, which the policy of the page forbids.
    size = {"width": 390, "height": 844}
    context = browser.new_context(viewport=size, color_scheme=scheme, bypass_csp=True)
    tab = context.new_page()
    tab.goto(released.url)
    wait_for_run(tab)
    assert find_violations(tab) == []
    # The last column of the results was beyond the edge of the screen.
    overflow = "(box) => box.scrollWidth - box.clientWidth"
    assert tab.locator("#results .scroll").evaluate(overflow) == 0
    context.close()
