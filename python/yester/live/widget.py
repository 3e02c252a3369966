"""The page in a notebook."""

from __future__ import annotations

import asyncio
import os
import re
from typing import Any

import anywidget

from .messages import Mail, Message, page
from .scene import World
from .session import Session, Viewer

__all__ = ["Widget"]


def _module() -> tuple[str, str]:
    """The page as a module and a style sheet: its markup and its main function, with the kernel as its channel."""
    text = page()
    (markup,) = re.findall(r'<template id="markup">(.*?)</template>', text, re.S)
    (style,) = re.findall(r"<style>(.*?)</style>", text, re.S)
    script = re.findall(r"<script>(.*?)</script>", text, re.S)[0]
    render = """
export default { render({ model, el }) {
  const root = el.appendChild(document.createElement("div"));
  root.className = "live";
  const channel = { send: (message) => model.send(message) };
  live(root, html, channel, false);
  const heard = (message, buffers) => channel.heard(buffers?.length ? buffers[0] : message);
  model.on("msg:custom", heard);
  model.send({ ready: true });
  return () => model.off("msg:custom", heard);
} };
"""
    return f"{script}\nconst html = {markup!a};{render}", style.replace("body { margin: 0; }", "")


class Widget(anywidget.AnyWidget):
    """The page of ``yester live`` in a notebook: turn the camera of a scene, and watch it being denoised.

    It works in Jupyter and VS Code, without a server of its own. Rendering and denoising run in threads of the kernel
    and rest while a cell is computed; `close` ends them.

    Parameters
    ----------
    scene : path-like, optional
        A Mitsuba scene, an XML file, with a perspective camera; by default, the Cornell box of the demo.
    size : (int, int), optional
        Largest width and height in pixels, from which the resolution is adapted; by default those of the scene, or
        640×480.
    folder : path-like, default "."
        Where recordings go.

    Raises
    ------
    OSError
        If the scene does not exist.
    ValueError
        If it has no perspective camera, or cannot be read.
    RuntimeError
        If there is no event loop, as outside of a notebook.
    ImportError
        If the extra ``live`` is not installed.

    See Also
    --------
    yester.io.mitsuba.render_sequence : Renders frames along a given path of the camera.

    Examples
    --------
    In a cell of a notebook::

        from yester.live import Widget
        Widget(size=(320, 240))
    """

    _esm, _css = _module()

    def __init__(
        self,
        scene: str | os.PathLike[str] | None = None,
        *,
        size: tuple[int, int] | None = None,
        folder: str | os.PathLike[str] = ".",
    ) -> None:
        mail = Mail()
        super().__init__()
        session = Session(World(scene, size), folder=os.fspath(folder))
        viewer = Viewer(mail.put)
        self._session: Session | None = session

        async def send(message: Message) -> None:
            if isinstance(message, bytes):
                self.send({}, [message])
            else:
                self.send(message)

        def told(_: Any, message: dict[str, Any], __: Any) -> None:
            try:
                if message.pop("ready", False):
                    session.join(viewer)
                else:
                    mail.answer(session, viewer, message)
            except ValueError as error:
                mail.put({"error": str(error)})

        self._sending = asyncio.get_running_loop().create_task(mail.deliver(send))
        self.on_msg(told)

    def close(self) -> None:
        """End the threads, and remove the widget from the notebook."""
        if (session := getattr(self, "_session", None)) is not None:
            self._session = None
            self._sending.cancel()
            session.close()
        super().close()
