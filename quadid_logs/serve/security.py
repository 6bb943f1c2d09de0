"""What stands between any web page in the same browser and the logs of its owner.

Other pages can send requests to a server on this machine, and by a name that
they control even read the answers (DNS rebinding [1]_). So every request must
name this server by an address that nobody else controls, an unsafe one must
come from our own page [2]_, and all must carry the cookie that only whoever
started the server gets.

References
----------
.. [1] https://developer.chrome.com/blog/local-network-access
.. [2] https://web.dev/articles/fetch-metadata
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
import socket
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: Of every page of ours: only its own files, nothing written into the page is run, nobody may frame it.
PAGE_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'; "
    "require-trusted-types-for 'script'"
)
#: Of a report: its own scripts run (its own policy names them by their hashes), without our origin, cookie
#: or any connection; only our page may frame it.
REPORT_POLICY: Final = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)
_HEADERS: Final[Mapping[str, str]] = {
    "Content-Security-Policy": PAGE_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), usb=()",
    "Cache-Control": "no-store",
}
_SAFE_METHODS: Final = frozenset({"GET", "HEAD"})
#: What a person's click, or our own page, causes; of the others `same-site` is another port of this machine.
_OURS: Final = frozenset({"same-origin", "none"})
#: Everybody may have these: the page that takes the token, and how it looks.
_OPEN_PATHS: Final = frozenset({"/start", "/static/serve.css"})
#: Of all pages together, a few dozen each.
_MOST_REQUESTS: Final = 200
_RETRY_S: Final = "2"
LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Who may come in: addresses of this server as ``host:port``, the token, and what cookies are made with.

    Attributes
    ----------
    hosts : frozenset of str
        As a browser puts them into ``Host``.
    any_address : bool
        Whether numerical addresses will do: of a server that listens on all of the machine's.
    port : int
    token : str
        Of the start address.
    secret : bytes
    """

    hosts: frozenset[str]
    port: int
    secret: bytes = field(repr=False)
    token: str = field(repr=False, default_factory=lambda: secrets.token_urlsafe(32))
    any_address: bool = False
    salt: str = field(repr=False, default="")

    @property
    def cookie_name(self) -> str:
        """Its name holds the port: browsers give cookies to every port of a host."""
        return f"quadid-{self.port}"

    @property
    def cookie(self) -> str:
        """Its value; it stays the same over a restart, another token that the owner chose makes another."""
        return hmac.new(self.secret, f"session {self.salt}".encode(), hashlib.sha256).hexdigest()

    def knows_token(self, given: str) -> bool:
        """Return whether a token is the right one, in a time that does not tell how much of it is."""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def knows_cookie(self, header: str) -> bool:
        """Return whether a request's cookies hold the right one."""
        cookies: SimpleCookie = SimpleCookie()
        try:
            cookies.load(header)
        except CookieError:
            return False
        found = cookies.get(self.cookie_name)
        return found is not None and hmac.compare_digest(found.value.encode(), self.cookie.encode())

    def is_ours(self, host: str) -> bool:
        """Return whether a ``Host`` or the rest of an ``Origin`` names this server."""
        return host.lower() in self.hosts or (self.any_address and _is_address(host, self.port))


def hosts_of(host: str, port: int) -> Iterable[str]:
    """Yield how a browser may name this server.

    Parameters
    ----------
    host : str
        That it listens on.
    """
    for name in dict.fromkeys((*LOOPBACK, host, *((socket.gethostname(),) if not is_loopback(host) else ()))):
        shown = f"[{name}]" if ":" in name else name
        yield f"{shown}:{port}".lower()
        if port == 80:
            yield shown.lower()


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address.

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0"), is_loopback("example.org")
    (True, True, False, False)
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _is_address(host: str, port: int) -> bool:
    """Return whether it is a numerical address with our port: no name server has a say in that."""
    name, _, given = host.rpartition(":")
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return given == str(port)


class Guard:
    """ASGI middleware: refuses what is not ours, and adds the headers that keep the browser strict."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access
        self._n_open = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refused = self._refusal(scope["method"], scope["path"], Headers(scope=scope))
        if refused is None and self._n_open >= _MOST_REQUESTS:
            refused = PlainTextResponse(
                "Too many requests at once. Try again.", 503, {"Retry-After": _RETRY_S}
            )
        if refused is not None:
            await refused(scope, receive, send_with_headers)
            return
        self._n_open += 1
        try:
            await self._app(scope, receive, send_with_headers)
        finally:
            self._n_open -= 1

    def _refusal(self, method: str, path: str, headers: Headers) -> Response | None:
        """Return what to answer to a request that is not let in."""
        access = self._access
        if not access.is_ours(headers.get("host", "")):
            return PlainTextResponse("This server does not have that name.", 421)
        # No other site may have caused it; what is unsafe must prove that.
        if method not in _SAFE_METHODS:
            site, origin = headers.get("sec-fetch-site", ""), headers.get("origin", "")
            comes_from_us = site in ("", "same-origin") and self._is_own_origin(origin)
        else:
            # A link on another site may lead to the start; nothing else there may use what is here.
            is_link = (
                headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
            )
            comes_from_us = is_link or self._may_read(headers)
        if not comes_from_us:
            return PlainTextResponse("Only this server's own page may request this.", 403)
        if path in _OPEN_PATHS or (
            self._may_read(headers) and access.knows_cookie(headers.get("cookie", ""))
        ):
            return None
        if method in _SAFE_METHODS and headers.get("sec-fetch-dest", "document") == "document":
            from quadid_logs.serve.pages import start_page

            return start_page("", status=401)
        return PlainTextResponse("Open the address that quadid-log serve printed.", 401)

    def _may_read(self, headers: Headers) -> bool:
        """Return whether our own page or a person asks: other ports of this machine have the cookie as well.

        Where the browser does not say who asks, an ``Origin`` of another page does.
        """
        site, origin = headers.get("sec-fetch-site", ""), headers.get("origin", "")
        return site in _OURS or (not site and (not origin or self._is_own_origin(origin)))

    def _is_own_origin(self, origin: str) -> bool:
        scheme, _, host = origin.partition("://")
        return scheme == "http" and self._access.is_ours(host)
