"""Turn a camera by hand and watch history work: a scene rendered at one path a pixel, denoised, in a browser.

`run` is the command ``yester live``; `Widget` shows the same in a notebook.
"""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import webbrowser
from collections.abc import Coroutine
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .widget import Widget

__all__ = ["Widget", "run"]


def __getattr__(name: str) -> Any:
    """Import the widget when it is asked for: the command does without its dependencies."""
    if name == "Widget":
        from .widget import Widget

        return Widget
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def run(
    scene: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] | None = None,
    port: int = 0,
    browser: bool = True,
    folder: str | os.PathLike[str] = ".",
) -> None:
    """Serve a scene until interrupted, and open it in a browser.

    Only this machine can connect, and only with the random token in the address that is printed.

    Parameters
    ----------
    scene : path-like, optional
        A Mitsuba scene, an XML file; by default the Cornell box of the demo with its flying cube.
    size : (int, int), optional
        Largest width and height, from which the resolution is adapted; by default those of the scene, or 640×480.
    port : int, default 0
        0 for any that is free.
    browser : bool, default True
        Open the page in a browser.
    folder : path-like, default "."
        Where recordings go.

    Raises
    ------
    OSError
        If the scene does not exist, or the port is in use.
    ValueError
        If the scene has no perspective camera, or cannot be read.
    ImportError
        If Mitsuba or aiohttp is not installed.
    """
    from .scene import World
    from .server import Server, listen
    from .session import Session

    with listen(port) as listening:  # before the scene is loaded, which takes longer
        session = Session(World(scene, size), folder=os.fspath(folder))
        server = Server(session, listening)

        def started() -> None:
            print(f"{server.address}  (Ctrl-C ends)", flush=True)
            if browser:
                webbrowser.open(server.address)

        try:
            with suppress(KeyboardInterrupt):
                asyncio.run(_until_ended(server.serve(started)))
        finally:
            session.close()


async def _until_ended(served: Coroutine[Any, Any, None]) -> None:
    """Serve until the process, or its terminal, is to end, so that a recording is completed. Ctrl-C is asyncio's."""
    task = asyncio.ensure_future(served)
    known = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # Not where nohup ignores them, or the program has handlers of its own. Only the main thread may set any.
    main = threading.current_thread() is threading.main_thread()
    for number in known if main and os.name != "nt" else ():
        if signal.getsignal(number) == signal.SIG_DFL:
            asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with suppress(asyncio.CancelledError):
        await task
