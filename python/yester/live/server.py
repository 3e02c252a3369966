"""The server of one session: this machine alone, one page, and a websocket for each viewer."""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
from collections.abc import Callable
from typing import Any

from aiohttp import WSMsgType, web

from .messages import Mail, Message, page
from .session import Session, Viewer

__all__ = ["Server", "listen"]

_HOST = "127.0.0.1"
#: The page loads nothing but its own websocket, and no other page may show it.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: Largest message of a page, in bytes.
_LARGEST = 1 << 16


def listen(port: int) -> socket.socket:
    """Take a port of the loopback interface, 0 for any that is free; OSError if it is in use."""
    try:
        return socket.create_server((_HOST, port))
    except OSError as error:
        raise OSError(f"port: expected one that is free, got {port}: {error.strerror}") from None


class Server:
    """Serves a session on the loopback interface, at an address with a random token.

    Parameters
    ----------
    session : Session
    listening : socket
        From `listen`.
    """

    def __init__(self, session: Session, listening: socket.socket) -> None:
        self.session = session
        self._listening = listening
        self.port: int = listening.getsockname()[1]
        self.token = secrets.token_urlsafe(18)
        self._links: set[web.WebSocketResponse] = set()

    @property
    def address(self) -> str:
        """The address of the page."""
        return f"http://{_HOST}:{self.port}/{self.token}/"

    async def serve(self, started: Callable[[], None]) -> None:
        """Serve until cancelled; `started` is called when the page can be opened."""
        app = web.Application(middlewares=[self._guarded])
        app.router.add_get("/{token}/", self._page)
        app.router.add_get("/{token}/live", self._live)
        app.on_shutdown.append(self._goodbye)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1)
        await runner.setup()
        try:
            await web.SockSite(runner, self._listening).start()
            started()
            await asyncio.Event().wait()
        finally:
            await runner.cleanup()

    async def _goodbye(self, _: web.Application) -> None:
        for link in [*self._links]:
            await link.close(code=1001, message=b"the server has ended")

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Refuse requests without the token, by another name of this machine, or from another page."""
        hosts = {f"{name}:{self.port}" for name in (_HOST, "localhost")}
        if self.port == 80:  # which browsers leave out
            hosts |= {_HOST, "localhost"}
        token = request.match_info.get("token", "")
        if request.host not in hosts or not hmac.compare_digest(token.encode(), self.token.encode()):
            raise web.HTTPForbidden(text="The address lacks its token: use the one that yester live has printed.\n")
        origin = request.headers.get("Origin")
        needed = request.path.endswith("/live")
        if (origin is not None or needed) and origin not in {f"http://{host}" for host in hosts}:
            raise web.HTTPForbidden(text="The request comes from another page.\n")
        response: web.StreamResponse = await handler(request)
        return response

    async def _page(self, _: web.Request) -> web.Response:
        headers = {
            "Content-Security-Policy": _POLICY,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }
        return web.Response(text=page(), content_type="text/html", headers=headers)

    async def _live(self, request: web.Request) -> web.WebSocketResponse:
        link = web.WebSocketResponse(max_msg_size=_LARGEST, compress=False, heartbeat=20)
        await link.prepare(request)
        self._links.add(link)
        mail = Mail()
        viewer = Viewer(mail.put)

        async def send(message: Message) -> None:
            await (link.send_bytes(message) if isinstance(message, bytes) else link.send_json(message))

        sending = asyncio.create_task(mail.deliver(send))
        await asyncio.to_thread(self.session.join, viewer)
        try:
            async for message in link:
                if message.type is not WSMsgType.TEXT:
                    continue
                try:
                    mail.answer(self.session, viewer, json.loads(message.data))
                except ValueError as error:
                    mail.put({"error": str(error)})
        finally:
            self.session.leave(viewer)
            sending.cancel()
            self._links.discard(link)
        return link
