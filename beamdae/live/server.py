"""Server of the live view, which answers only pages that it has served on this computer."""

from __future__ import annotations

import atexit
import hmac
import html
import json
import secrets
import sys
import threading
import webbrowser
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_choice,
    require_positive,
    short_repr,
)
from beamdae.live.session import LiveSession
from beamdae.model_functions import Model
from beamdae.report.page.content import encode
from beamdae.report.page.page_file import fill_template

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
