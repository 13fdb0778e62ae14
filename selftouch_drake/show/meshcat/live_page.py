"""A live page: Meshcat's own, served with a title and a legend over it.

Drake serves the same page for every Meshcat. Its HTML is fetched from there and served on a port of
our own, with what a reader needs; what happens in the scene goes straight from Meshcat to the
browser.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from pydrake.geometry import Meshcat

from selftouch_drake.show.meshcat.legend import WIDE, with_legend
from selftouch_drake.show.meshcat.stage import open_meshcat

# Ports that are tried, as by Meshcat.
_PORTS = range(7000, 8000)
_HOST = "localhost"
# Where Meshcat's page says from which server it hears of the scene.
_WHERE = "url = location.toString();"


@contextlib.contextmanager
def shown_page(
    name: str,
    port: int | None = None,
    announce: Callable[[str], None] = print,
    *,
    text: str = "",
    colors: Sequence[tuple[str, str]] = (),
    wide: float = WIDE,
    beside: bool = False,
) -> Iterator[Meshcat]:
    """Opens a Meshcat for what goes on inside, until its end or Ctrl-C.

    Args:
        name: the title of the page.
        port: of the page; by default the first free one from 7000 on.
        announce: called with where to look, and at the end.
        text: all else is as in `with_legend`.
        colors: see there.
        wide: see there.
        beside: see there.

    Raises:
        ValueError: the port is taken.
    """
    with _server(port) as server:
        meshcat = open_meshcat()
        # Its own thread alone may ask it.
        meshcat_port = meshcat.port()

        def finished(page: str) -> str:
            url = f'url = "http://" + location.hostname + ":{meshcat_port}/";'
            page = page.replace(_WHERE, url, 1)
            return with_legend(page, name, text, colors, wide=wide, beside=beside)

        server.RequestHandlerClass = _handler(meshcat_port, finished)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        announce(f"{name} at http://{_HOST}:{server.server_port} (Ctrl-C to end)")
        try:
            with contextlib.suppress(KeyboardInterrupt):
                yield meshcat
        finally:
            server.shutdown()
        announce("ended")


@contextlib.contextmanager
def _server(port: int | None) -> Iterator[ThreadingHTTPServer]:
    """A server on a port, or on the first free one, that does not answer yet."""
    for number in _PORTS if port is None else (port,):
        with contextlib.suppress(OSError):
            server = ThreadingHTTPServer((_HOST, number), BaseHTTPRequestHandler)
            break
    else:
        taken = f"--port {port} is" if port is not None else "ports 7000 to 7999 are"
        raise ValueError(f"{taken} in use; give another, or leave it out")
    try:
        yield server
    finally:
        server.server_close()


def _handler(port: int, finished: Callable[[str], str]) -> type[BaseHTTPRequestHandler]:
    """What answers with the files of the Meshcat at a port; its page is `finished` first."""

    class FromMeshcat(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            connection = HTTPConnection(_HOST, port)
            connection.request("GET", self.path)
            found = connection.getresponse()
            content, kind = found.read(), found.getheader("Content-Type", "")
            connection.close()
            if self.path.partition("?")[0] == "/":
                content, kind = finished(content.decode()).encode(), "text/html; charset=utf-8"
            self.send_response(found.status)
            if kind:
                self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as inherited
            """Says nothing."""

    return FromMeshcat
