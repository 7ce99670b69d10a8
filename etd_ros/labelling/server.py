"""Serves the page, the pictures and the labels, on the loopback interface and to whoever knows the address's token."""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any

from etd_ros.errors import EtdError
from etd_ros.labelling.key_frames import LabellingError
from etd_ros.labelling.pictures import Pictures
from etd_ros.labelling.session import LabelSession

HOST = "127.0.0.1"
BODY_BYTES_MAX = 1 << 16
IDLE_S = 120
PAGE_TYPES = {
    "index.html": "text/html; charset=utf-8",
    "label.css": "text/css; charset=utf-8",
    "label.js": "text/javascript; charset=utf-8",
    "view.js": "text/javascript; charset=utf-8",
    "timeline.js": "text/javascript; charset=utf-8",
}
"""The page's files: nothing else in the folder is served."""


class LabelServer:
    """The page at `url`, until `close`.

    No other user or web page gets in: the address holds a random token, the name that it is called by must be the
    machine's own (a page elsewhere could have its name point here), and changes must come from the page itself.

    Args:
        session: the labels.
        pictures: what is labelled.
        title: shown above the page.
        port: where to listen; 0 takes a free one.

    Raises:
        LabellingError: the port is taken.
    """

    def __init__(self, session: LabelSession, pictures: Pictures, *, title: str, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(16)
        handler = type("Handler", (_Handler,), {"token": self._token, "routes": _Routes(session, pictures, title)})
        try:
            self._server = ThreadingHTTPServer((HOST, port), handler)
        except (OSError, OverflowError) as err:
            msg = f"port {port} cannot be used ({err}): give another --port, or none"
            raise LabellingError(msg) from err
        self._server.daemon_threads = True

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{HOST}:{self._server.server_address[1]}/{self._token}/"

    def serve(self) -> None:
        """Answer requests until `close`, called from another thread, or an interrupt."""
        self._server.serve_forever(poll_interval=0.1)

    def stop(self) -> None:
        """Have `serve`, in another thread, return."""
        self._server.shutdown()

    def close(self) -> None:
        """Give the port back."""
        self._server.server_close()


class _Routes:
    """What is answered to which request."""

    def __init__(self, session: LabelSession, pictures: Pictures, title: str) -> None:
        self._session = session
        self._pictures = pictures
        self._title = title

    def get(self, name: str) -> tuple[str, bytes]:
        """(type, content) of a path below the token.

        Raises:
            LookupError: there is nothing of this name.
        """
        folder, _, number = name.partition("/")
        if folder == "pictures" and number.isdecimal() and len(number) < 10:
            return "image/png", self._pictures.png(int(number))
        if name == "sequence":
            return _json(self._sequence())
        if name == "labels":
            return _json(self._session.state())
        name = name or "index.html"
        return PAGE_TYPES[name], (resources.files(__package__) / "page" / name).read_bytes()

    def post(self, name: str, content: Any) -> tuple[str, bytes]:
        """(type, content) after a change.

        Raises:
            LookupError: there is nothing of this name.
            EtdError: the change is refused.
        """
        actions: dict[str, Callable[[], dict[str, Any]]] = {
            "edit": lambda: self._session.edit(content),
            "save": self._session.save,
        }
        if not isinstance(content, dict):
            msg = "a change must be a JSON object"
            raise LabellingError(msg)
        return _json(actions[name]())

    def _sequence(self) -> dict[str, Any]:
        stamps = self._pictures.stamps
        return {
            "title": self._title,
            "output": str(self._session.output),
            "kind": self._pictures.kind,
            "width": self._pictures.width,
            "height": self._pictures.height,
            "times_s": ((stamps - stamps[0]) / 1e9).round(6).tolist(),
        }


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = IDLE_S
    token: str
    routes: _Routes

    def do_GET(self) -> None:
        name = self._name_below_token()
        if name is not None:
            self._answer(lambda: self.routes.get(name))

    def do_POST(self) -> None:
        name = self._name_below_token()
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Origin", self._own_origin()) != self._own_origin():
            self._refuse(HTTPStatus.FORBIDDEN, "another page sent this")
        elif self.headers.get_content_type() != "application/json":
            # Only scripts of the page itself can send this type: a form elsewhere cannot.
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "send JSON")
        elif not length.isdecimal() or len(length) > 9 or int(length) > BODY_BYTES_MAX:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long")
        else:
            body = self.rfile.read(int(length))
            self._answer(lambda: self.routes.post(name, _parsed(body)))

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - the base class's name
        """The terminal is for what the user must know: the page shows what goes wrong."""

    def _own_origin(self) -> str:
        return f"http://{self.headers.get('Host')}"

    def _name_below_token(self) -> str | None:
        """The path below the token, without its query; None, after the answer, where the request must not be here."""
        port = self.connection.getsockname()[1]
        token, slash, name = self.path.partition("?")[0].removeprefix("/").partition("/")
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self._refuse(HTTPStatus.FORBIDDEN, "another name for this machine")
        elif not slash or not hmac.compare_digest(token.encode(), self.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN, "open the address that `label` printed")
        else:
            return name
        return None

    def _answer(self, route: Callable[[], tuple[str, bytes]]) -> None:
        try:
            kind, content = route()
        except LookupError:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing of this name")
        except EtdError as err:
            self._refuse(HTTPStatus.BAD_REQUEST, str(err), close=False)
        else:
            self._send(HTTPStatus.OK, kind, content)

    def _refuse(self, status: HTTPStatus, reason: str, *, close: bool = True) -> None:
        # What follows of a request that was not read would be taken for the next one.
        self.close_connection = close
        self._send(status, *_json({"error": reason}))

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "private, max-age=86400" if kind == "image/png" else "no-store")
        self.send_header("Content-Security-Policy", "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(content)


def _json(content: dict[str, Any]) -> tuple[str, bytes]:
    return "application/json", json.dumps(content).encode()


def _parsed(body: bytes) -> Any:
    try:
        return json.loads(body)
    except (ValueError, RecursionError) as err:
        msg = "the change is no JSON"
        raise LabellingError(msg) from err
