"""The rerun viewer as a child process that listens on this machine only, in a window or for a browser."""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import quote

from preshape.hal.device import DeviceUnreachable

LOOPBACK = "127.0.0.1"
READY_S = 30.0
"""Longest time until it listens, s."""


def rerun_binary() -> Path:
    """Return the viewer's own program: the script of the same name would leave its child behind when it is ended."""
    found = importlib.util.find_spec("rerun_cli")
    folder = None if found is None or found.origin is None else Path(found.origin).parent
    binary = None if folder is None else folder / "rerun"
    if binary is None or not binary.exists():
        raise DeviceUnreachable("rerun viewer: its program is not installed; pip install rerun-sdk")
    return binary


def free_port() -> int:
    """Return a port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def has_display() -> bool:
    """Return whether this process can open a window."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class RerunViewer:
    """One viewer; a context manager that ends it. `url` is where streams connect to, `page` what a browser opens."""

    def __init__(self, web: bool, files: tuple[Path, ...] = (), port: int = 0, web_port: int = 0) -> None:
        """Start it, with files open; ports that are 0 are chosen. Without a display it serves a browser in any case.

        Raises:
            DeviceUnreachable: it does not come up.
        """
        web = web or not has_display()
        port, web_port = port or free_port(), web_port or free_port()
        self.url = f"rerun+http://{LOOPBACK}:{port}/proxy"
        self.page = f"http://{LOOPBACK}:{web_port}/?url={quote(self.url, safe='')}" if web else ""
        command = [str(rerun_binary()), "--bind", LOOPBACK, "--port", str(port), "--hide-welcome-screen"]
        command += ["--serve-web", "--web-viewer-port", str(web_port)] if web else []
        command += [str(file) for file in files]
        quiet = os.environ | {"RUST_LOG": "error"}
        self._said = tempfile.TemporaryFile()
        # In a session of its own: Ctrl-C is for us, who then end it.
        self._process = subprocess.Popen(
            command, env=quiet, stdout=subprocess.DEVNULL, stderr=self._said, start_new_session=True
        )
        try:
            for wanted in (port, *((web_port,) if web else ())):
                self._await(wanted)
        except DeviceUnreachable:
            self.close()
            raise

    @property
    def where(self) -> str:
        """Where to look, as the end of a sentence."""
        return f" at {self.page}" if self.page else " in its window"

    @property
    def running(self) -> bool:
        """Whether it is still there: its user may have closed the window."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Wait until its user closes it."""
        self._process.wait()

    def close(self) -> None:
        """End it; may be called twice."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._said.close()

    def __enter__(self) -> RerunViewer:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()

    def _await(self, port: int) -> None:
        deadline_s = time.monotonic() + READY_S
        while time.monotonic() < deadline_s:
            if self._process.poll() is not None:
                self._said.seek(0)
                lines = self._said.read().decode("utf-8", "replace").strip().splitlines() or ["it said nothing"]
                raise DeviceUnreachable(f"rerun viewer: ended at once: {lines[0]}")
            with socket.socket() as probe:
                if probe.connect_ex((LOOPBACK, port)) == 0:
                    return
            time.sleep(0.05)
        raise DeviceUnreachable(f"rerun viewer: does not listen at port {port} within {READY_S:g} s")
