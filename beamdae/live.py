"""Live view: a page served on this computer, with sliders for the parameters of a model.

To extend: add a kind of control to `create_controls` and to the page script `live.js`.
"""

from __future__ import annotations

import atexit
import hmac
import html
import inspect
import json
import math
import secrets
import sys
import threading
import time as clock
import webbrowser
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Literal, get_args, get_origin

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    format_exception,
    require_choice,
    require_mapping,
    require_pair,
    require_positive,
    short_repr,
)
from beamdae.integrators.auto import Auto
from beamdae.model_functions import Model
from beamdae.model_parameters import ModelParameter
from beamdae.parts.mechanism import Mechanism
from beamdae.report.page.content import encode, export_table
from beamdae.report.page.page_file import fill_template
from beamdae.report.scene.mechanism_scene import build_scene, reference_poses
from beamdae.report.scene.run_scene import export_frames, export_run_frames
from beamdae.report.tables import range_rows
from beamdae.results.columns import observed_columns
from beamdae.results.solution import Solution
from beamdae.simulation import simulate

# Enough for a picture; `beamdae run` is more accurate.
RTOL = 1e-3
_SUPERSEDED = "superseded"

# The slider of a number reaches from the default divided by this factor to the default times it.
_RANGE_FACTOR = 4.0
# A slider with positive ends is logarithmic from this ratio of its ends on.
_MIN_LOGARITHMIC_RATIO = 8.0
_FULL_TURN = {"rad": math.pi, "deg": 180.0, "°": 180.0}  # half a turn, in both directions

_HOST = "127.0.0.1"
_TOKEN_BYTES = 24
_MAX_BODY = 100_000  # bytes of a request
_MAX_PORT = 65535
_POLL_INTERVAL = 0.05  # s; `close` waits for this time
_REQUEST_TIMEOUT = 30.0  # s; a connection without a request is closed
_FRAME_HEIGHT = 720  # of the page in a notebook [pixels]
DEFAULT_TIME_LIMIT = 10.0  # wall time of a run [s]

_STYLES = ("page", "charts", "tables", "mechanism", "media", "live")
_SCRIPTS = ("data", "markers", "mechanism", "live")
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'"
)
_JSON = "application/json"


class LiveSession:
    """Drawings and runs of a model for the live view.

    Requests of several threads are answered one after another; each ends the run of an earlier
    one.

    Parameters
    ----------
    model
        The model.
    ranges
        Ends of the sliders, see `create_controls`.
    t_end
        End time of the runs [s].
    time_limit
        Maximum wall time of a run [s].
    """

    def __init__(
        self,
        model: Model,
        ranges: Mapping[str, Any] | None,
        t_end: float,
        time_limit: float,
    ) -> None:
        self._model, self._t_end, self._time_limit = model, t_end, time_limit
        self.name, self.controls = model.name, create_controls(model, ranges)
        self._lock, self._latest = threading.Lock(), 0
        self._count_lock = threading.Lock()

    def describe(self) -> dict[str, Any]:
        """Return the title, the controls and the first drawing, as data of the page."""
        return {
            "name": self.name,
            "summary": self._model.summary,
            "controls": self.controls,
            "t_end": self._t_end,
            "first": self.draw({}),
        }

    def draw(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the "frames" of the drawing with parameters `values`, or an "error"."""
        return self._answer(values, self._draw)

    def run(self, values: Mapping[str, Any], t_end: Any = None) -> dict[str, Any]:
        """Return the "frames", "status", "warnings" and "table" of a run, or an "error".

        A run that a later request ended is only marked as "superseded".
        """
        return self._answer(values, lambda mechanism, number: self._run(mechanism, number, t_end))

    def close(self) -> None:
        """End the run in progress."""
        self._count_request()

    def _count_request(self) -> int:
        """Return the number of a new request, which supersedes all earlier ones."""
        with self._count_lock:
            self._latest += 1
            return self._latest

    def _answer(self, values: Mapping[str, Any], function: Any) -> dict[str, Any]:
        number = self._count_request()
        with self._lock:
            if number != self._latest:
                return {_SUPERSEDED: True}
            try:
                mechanism = self._model(**values)
                if not isinstance(mechanism, Mechanism):
                    raise BeamdaeError(
                        f"view: {self.name} consists of equations without a shape; only a "
                        "Mechanism can be viewed."
                    )
                answer: dict[str, Any] = function(mechanism, number)
            except BeamdaeError as problem:
                return {"error": str(problem)}
            except Exception as problem:  # The model function can raise any error.
                return {"error": f"{self.name}: {format_exception(problem)}"}
            return answer

    def _draw(self, mechanism: Mechanism, number: int) -> dict[str, Any]:
        times = np.zeros(1)
        scene = build_scene(mechanism, reference_poses, times, name="view")
        return {"frames": export_frames(scene, times)}

    def _run(self, mechanism: Mechanism, number: int, t_end: Any) -> dict[str, Any]:
        # The first step follows compilation, which takes seconds once on a machine.
        begin = 0.0

        def stop(t: float) -> str | None:
            nonlocal begin
            begin = begin or clock.perf_counter()
            if clock.perf_counter() - begin > self._time_limit:
                return f"reached the time limit of {self._time_limit:g} s"
            return _SUPERSEDED if number != self._latest else None

        end = self._t_end if t_end is None else t_end
        solution = simulate(mechanism, Auto(rtol=RTOL), end, progress=stop)
        if number != self._latest:
            return {_SUPERSEDED: True}
        return {"frames": export_run_frames(solution), **summarize(solution)}


def summarize(solution: Solution) -> dict[str, Any]:
    """Return status, warnings and the table of observed columns for the page."""
    cost = solution.statistics
    columns = solution.all_columns()
    observed = {name: columns[name] for name in observed_columns(columns)}
    return {
        "status": f"{solution.status.sentence}; {cost.steps} steps, {cost.wall_time:.2g} s",
        "ok": solution.status.success,
        "warnings": list(solution.warnings),
        "table": export_table("Observed", range_rows(observed, steps=solution.step_extremes)),
    }


def create_controls(model: Model, ranges: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return one control per parameter, as plain data for the page.

    Parameters
    ----------
    model
        The model.
    ranges
        Pairs (first, last) of slider ends by parameter, numbers or texts with units.

    Returns
    -------
    list of dict
        "name", "value", "unit", "description", "kind" ("number", "integer", "flag", "choice" or
        "text"); for numbers with a slider, its ends "low" and "high" and whether it is logarithmic
        ("log"); for choices, annotated as `Literal` texts, these values ("choices").

    Raises
    ------
    BeamdaeError
        If `ranges` has the wrong form, or names an unknown or another kind of parameter.
    """
    pairs = require_mapping(
        "view", "ranges", {} if ranges is None else ranges, "a dict of pairs by parameter"
    )
    ends = {str(name): _require_range(model, str(name), x) for name, x in pairs.items()}
    controls = [_create_control(x, ends.get(x.name)) for x in model.parameter_info.values()]
    literals = _read_literals(model)
    for control in controls:
        if control["kind"] != "text":
            continue
        name, default = control["name"], control["value"]
        if default in literals.get(name, ()):
            control |= {"kind": "choice", "choices": literals[name]}
    return controls


def _read_literals(model: Model) -> dict[str, list[str]]:
    """Return the texts of the parameters that are annotated as `Literal` texts."""
    try:
        annotations = inspect.get_annotations(model.build, eval_str=True)
    except Exception:  # Annotations can be any code, also of names that only type checkers import.
        return {}
    choices = {
        name: list(get_args(annotation))
        for name, annotation in annotations.items()
        if get_origin(annotation) is Literal
    }
    return {name: x for name, x in choices.items() if all(isinstance(text, str) for text in x)}


def _create_control(x: ModelParameter, ends: tuple[Any, Any] | None) -> dict[str, Any]:
    control = {"name": x.name, "unit": x.unit, "description": x.description}
    if isinstance(x.default, bool):
        return control | {"kind": "flag", "value": x.default}
    if not isinstance(x.default, (int, float)) or not math.isfinite(x.default):
        value = x.default if isinstance(x.default, str) else repr(x.default)
        return control | {"kind": "text", "value": value}
    kind = "integer" if isinstance(x.default, int) else "number"
    low, high = _default_range(x) if ends is None else ends
    is_log = kind == "number" and low > 0.0 and high >= _MIN_LOGARITHMIC_RATIO * low
    slider = {"low": low, "high": high, "log": is_log} if low < high else {}
    return control | {"kind": kind, "value": x.default, **slider}


def _default_range(x: ModelParameter) -> tuple[Any, Any]:
    """Return the ends of a slider; equal ends mean no slider, for a default of 0."""
    if x.unit in _FULL_TURN:
        return -_FULL_TURN[x.unit], _FULL_TURN[x.unit]
    if isinstance(x.default, int):
        return (1, int(_RANGE_FACTOR) * x.default) if x.default > 0 else (x.default, x.default)
    low, high = sorted((x.default / _RANGE_FACTOR, x.default * _RANGE_FACTOR))
    return (low, high) if math.isfinite(high - low) else (x.default, x.default)


def _require_range(model: Model, name: str, value: Any) -> tuple[Any, Any]:
    pair = require_pair("view", f"the range of {name}", value, "a pair (first, last)")
    low, high = (model.complete({name: x})[name] for x in pair)
    is_number = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (low, high))
    if not is_number or not low < high:
        raise BeamdaeError(
            f"view: the range of {name} must be two ascending numbers, got {low} and {high}."
        )
    return low, high


class LiveView:
    """Page with sliders for the parameters of a model, served on this computer until `close`.

    Only programs of this computer can connect, and only with the token in the address. Notebooks
    display the page.

    Attributes
    ----------
    url
        Address of the page, with its token.
    """

    def __init__(self, session: LiveSession, port: int, is_embedded: bool = True) -> None:
        number = as_real(port)
        if number is None or not number.is_integer() or not 0 <= number <= _MAX_PORT:
            raise BeamdaeError(
                f"view: port must be an integer from 0 to {_MAX_PORT}, got {short_repr(port)}."
            )
        self.session, self._is_embedded = session, is_embedded
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        try:
            self._server = _Server((_HOST, int(number)), _Handler)
        except OSError as problem:
            raise BeamdaeError(
                f"view: port {port} cannot be used ({problem.strerror}); choose another port, or "
                "0 for a free one."
            ) from None
        self._server.view = self
        self.port = int(self._server.server_address[1])
        self.url = f"http://{_HOST}:{self.port}/{self.token}/"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(_POLL_INTERVAL,), daemon=True
        )
        self._thread.start()
        atexit.register(self.close)

    @property
    def page(self) -> str:
        """The page (HTML), with a new drawing: files that the model reads may have changed."""
        data = self.session.describe()
        return fill_template("live", _STYLES, _SCRIPTS, data, title=html.escape(self.session.name))

    @property
    def policy(self) -> str:
        """Content security policy of the page; only notebooks show it in a frame."""
        return _POLICY if self._is_embedded else f"{_POLICY}; frame-ancestors 'none'"

    def open(self) -> None:
        """Open the page in the web browser."""
        webbrowser.open(self.url)

    def wait(self) -> None:
        """Wait until the server is closed or Ctrl-C is pressed."""
        while self._thread.is_alive():
            self._thread.join(0.2)

    def close(self) -> None:
        """End the run in progress and stop the server."""
        atexit.unregister(self.close)
        self.session.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __repr__(self) -> str:
        return f"<LiveView of {self.session.name}: {self.url}>"

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {_FRAME_HEIGHT}px; border: none"
        title = html.escape(f"live view of {self.session.name}")
        return f'<iframe src="{self.url}" style="{style}" title="{title}"></iframe>'


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = False
    view: LiveView

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore pages that were closed before the answer; report all other errors."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Handler of one request: the page, a drawing or a run."""

    server: _Server
    timeout = _REQUEST_TIMEOUT
    server_version = "beamdae"
    sys_version = ""

    def do_GET(self) -> None:
        path = self._authorized_path()
        if path is None:
            return
        if path:
            self._send_text(HTTPStatus.NOT_FOUND, "There is no such page.")
            return
        self._send(HTTPStatus.OK, "text/html; charset=utf-8", self.server.view.page)

    def do_POST(self) -> None:
        path = self._authorized_path()
        if path is None:
            return
        actions = {"draw": self._draw, "run": self._run}
        if path not in actions:
            self._send_text(HTTPStatus.NOT_FOUND, "There is no such action.")
            return
        if self.headers.get_content_type() != _JSON:
            self._send_text(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "The request must be JSON.")
            return
        size = self.headers.get("Content-Length", "")
        if not size.isdigit() or int(size) > _MAX_BODY:
            self._send_text(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "The request is too long.")
            return
        try:
            request = json.loads(self.rfile.read(int(size)))
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict) or not isinstance(request.get("values"), dict):
            self._send_text(HTTPStatus.BAD_REQUEST, "The request must contain values.")
            return
        answer = encode(actions[path](request))
        self._send(HTTPStatus.OK, _JSON, answer)

    def _draw(self, request: Mapping[str, Any]) -> dict[str, Any]:
        return self.server.view.session.draw(request["values"])

    def _run(self, request: Mapping[str, Any]) -> dict[str, Any]:
        return self.server.view.session.run(request["values"], request.get("t_end"))

    def _authorized_path(self) -> str | None:
        """Return the path after the token, or answer 403 and return None.

        The host is checked because a foreign page could bind its own name to this address, and the
        origin because a foreign page could send requests.
        """
        view = self.server.view
        hosts = {f"{name}:{view.port}" for name in (_HOST, "localhost")}
        origin = self.headers.get("Origin")
        is_local_page = self.headers.get("Host") in hosts and (
            origin is None or origin in {f"http://{host}" for host in hosts}
        )
        if self.command != "GET":
            is_local_page &= self.headers.get("Sec-Fetch-Site", "same-origin") == "same-origin"
        token, slash, path = self.path.removeprefix("/").partition("/")
        is_known = hmac.compare_digest(token.encode(), view.token.encode())
        if is_local_page and is_known and slash:
            return path.partition("?")[0]
        self._send_text(
            HTTPStatus.FORBIDDEN, "Open the address that beamdae printed, including its token."
        )
        return None

    def _send_text(self, status: HTTPStatus, text: str) -> None:
        self._send(status, "text/plain; charset=utf-8", text)

    def _send(self, status: HTTPStatus, kind: str, text: str) -> None:
        content = text.encode("utf-8", "replace")
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(content))),
            ("Content-Security-Policy", self.server.view.policy),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *arguments: Any) -> None:
        """Do not print requests."""


def view(
    model: Model,
    ranges: Mapping[str, Any] | None = None,
    t_end: float | None = None,
    *,
    time_limit: float = DEFAULT_TIME_LIMIT,
    port: int = 0,
    browser: bool = False,
) -> LiveView:
    """Return the live view of a model, see `Model.view`."""
    opens = require_choice("view", "browser", browser, (True, False))
    live = LiveView(create_session(model, ranges, t_end, time_limit), port)
    if opens:
        live.open()
    return live


def create_session(
    model: Model, ranges: Mapping[str, Any] | None, t_end: float | None, time_limit: float
) -> LiveSession:
    """Return the session of a live view; see `view` for arguments and errors."""
    require_positive("view", "time_limit", time_limit)
    end = model.t_end if t_end is None else require_positive("view", "t_end", t_end)
    return LiveSession(model, ranges, end, time_limit)
