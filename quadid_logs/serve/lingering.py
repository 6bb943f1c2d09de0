"""Let whoever still sends a body hear the answer to it.

A connection that is closed with bytes unread is reset, and with the reset the answer is lost: a browser whose
upload is refused would say that the server does not answer, and try again [1]_.

References
----------
.. [1] RFC 9112, HTTP/1.1, section 9.6: a server reads on after the response, for a while, before it closes.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from starlette.datastructures import Headers, MutableHeaders

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: For so long what is sent is read and dropped [s]: some gigabytes on one machine, and no reason to stay.
_LINGER_S: Final = 5.0


class Lingering:
    """ASGI middleware: reads on after an answer that came before the end of the request's body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        headers = Headers(scope=scope) if scope["type"] == "http" else {}
        if headers.get("content-length", "0") == "0" and "transfer-encoding" not in headers:
            await self._app(scope, receive, send)
            return
        is_sending = True

        async def received() -> Message:
            nonlocal is_sending
            message = await receive()
            is_sending = message["type"] == "http.request" and message.get("more_body", False)
            return message

        async def answered(message: Message) -> None:
            if message["type"] == "http.response.start" and is_sending:
                MutableHeaders(scope=message)["Connection"] = "close"
            if message["type"] != "http.response.body" or message.get("more_body", False) or not is_sending:
                await send(message)
                return
            await send({**message, "more_body": True})
            try:
                async with asyncio.timeout(_LINGER_S):
                    while is_sending:
                        await received()
            except TimeoutError:
                pass
            await send({"type": "http.response.body", "body": b"", "more_body": False})

        await self._app(scope, received, answered)
