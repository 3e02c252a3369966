"""The page of a viewer, and the messages to it: through a websocket, or through the channel of a notebook.

Of pictures, the newest replaces one that waits. WebP was measured and is slower here: `yester.study.speed.live`.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .session import Session, Viewer

__all__ = ["Mail", "Message", "packed", "page"]

#: A picture as made by `packed`, or anything else in words.
Message = bytes | dict[str, Any]


def page() -> str:
    """The page, a static file that needs nothing else."""
    return files(__package__).joinpath("page.html").read_text("utf-8")


def packed(header: Mapping[str, Any], images: Sequence[memoryview]) -> bytes:
    """Four bytes (little-endian) with the length of the header; the header in JSON; the RGBA bytes of each image."""
    text = json.dumps(header).encode()
    return b"".join([len(text).to_bytes(4, "little"), text, *images])


class Mail:
    """Messages for one viewer, sent by the running event loop. A picture waits until the one before it is shown."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._words: list[dict[str, Any]] = []
        self._picture: bytes | None = None
        self._news = asyncio.Event()
        self._free = True
        self._sent = 0.0

    def put(self, message: Message) -> None:
        """Take a message, from any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._take, message)

    def _take(self, message: Message) -> None:
        if isinstance(message, bytes):
            self._picture = message
        else:
            self._words.append(message)
        self._news.set()

    def answer(self, session: Session, viewer: Viewer, message: Any) -> None:
        """Do what a page asks for; ValueError if it is nothing that `Session.tell` knows."""
        if not isinstance(message, dict):
            raise ValueError(f"message: expected an object, got {message!r:.80}")
        if message.pop("shown", None) is not None:
            self._take({"transport": round(1e3 * (time.perf_counter() - self._sent), 2)})
            self._free = True
        if message:
            session.tell(viewer, message)

    async def deliver(self, send: Callable[[Message], Awaitable[None]]) -> None:
        """Send what there is, until cancelled."""
        while True:
            await self._news.wait()
            self._news.clear()
            words, self._words = self._words, []
            for message in words:
                await send(message)
            if self._free and self._picture is not None:
                picture, self._picture, self._free = self._picture, None, False
                self._sent = time.perf_counter()
                await send(picture)
