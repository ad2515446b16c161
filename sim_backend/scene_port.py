"""The door of a running hand bus' scene: a place in the file system where one run at a time finds it."""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path

from preshape.hal.can.bus_address import BusAddress
from preshape.hal.device import DeviceUnreachable


class ScenePlace:
    """A folder of this user's own, named by the buses: it holds the door (a socket) and the published scene."""

    def __init__(self, addresses: Mapping[str, BusAddress]) -> None:
        """Name the place of a hand bus by its first address."""
        first = next(iter(addresses.values()))
        name = f"{first.interface}-{first.channel}".replace("/", "_").replace(":", "_")
        self.folder = Path(tempfile.gettempdir()) / f"preshape-{os.getuid()}" / name
        self.door = self.folder / "scene.sock"
        self.state = self.folder / "scene.state"

    def make(self) -> None:
        """Make the folder, closed to others. `DeviceUnreachable` if another hand bus lives there."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if self.door.exists() and self._answers():
            raise DeviceUnreachable(f"{self.door}: another hand bus serves these buses: end it first")
        self.door.unlink(missing_ok=True)

    def connect(self) -> Connection:
        """Return a connection through the door; `DeviceUnreachable` if nobody is behind it."""
        knock = socket.socket(socket.AF_UNIX)
        try:
            knock.connect(str(self.door))
        except OSError as error:
            knock.close()
            raise DeviceUnreachable(
                f"no scene at {self.door} ({error.strerror}): start `preshape hand-bus --physics mujoco` on the same "
                "interface and channels, with the same scenario and seed"
            ) from error
        return Connection(knock.detach())

    def _answers(self) -> bool:
        try:
            self.connect().close()
        except DeviceUnreachable:
            return False
        return True


class ScenePort:
    """`preshape.sim_backend.paced_physics.RequestPort` that listens: one client at a time; a new one may follow."""

    def __init__(self, place: ScenePlace) -> None:
        """Listen at a place that has been made."""
        self._door = socket.socket(socket.AF_UNIX)
        self._door.bind(str(place.door))
        self._door.listen(1)
        self._door.setblocking(False)
        self._client: Connection | None = None
        self._request: object = None

    def poll(self) -> bool:
        """Return whether a client has asked something; a client that has gone makes room for the next."""
        if self._client is None:
            self._admit()
        if self._client is None or not self._client.poll():
            return False
        try:
            self._request = self._client.recv()
        except (EOFError, OSError):
            self._client.close()
            self._client = None
            return False
        return True

    def recv(self) -> object:
        """Return what `poll` has found."""
        return self._request

    def send(self, obj: object, /) -> None:
        """Answer the present client; one that has gone misses it."""
        if self._client is not None:
            try:
                self._client.send(obj)
            except OSError:
                self._client = None

    def close(self) -> None:
        """Close the door."""
        self._door.close()
        if self._client is not None:
            self._client.close()

    def _admit(self) -> None:
        try:
            client, _ = self._door.accept()
        except BlockingIOError:
            return
        client.setblocking(True)
        self._client = Connection(client.detach())
