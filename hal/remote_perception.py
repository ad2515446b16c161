"""What another process sees of the scene: object pose, obstacles, images, over Zenoh."""

from __future__ import annotations

import numpy as np

from preshape.hal.device import DeviceUnreachable
from preshape.hal.remote_calls import Seen, decode_reply, decode_seen
from preshape.hal.remote_line import RemoteLine
from preshape.hal.world import CameraModel, Image, OrientedBox, PoseSample


class RemotePerception:
    """`preshape.hal.world.Perception` behind a `RemoteLine`; `image` blocks its thread until the image has come."""

    def __init__(self, line: RemoteLine, camera: CameraModel) -> None:
        """Take the line, and the camera that the server's images are of."""
        self._line, self._camera = line, camera
        self._payload: bytes | None = None
        self._seen: Seen | None = None

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the newest pose sample that has arrived."""
        seen = self._newest()
        if seen is None or seen.stamp_ns is None:
            return None
        return PoseSample(seen.stamp_ns, np.array(seen.X_world_box).reshape(4, 4))

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the obstacles of the newest message."""
        seen = self._newest()
        if seen is None:
            return ()
        return tuple(
            OrientedBox(one.name, np.array(one.X_world_box).reshape(4, 4), np.array(one.half)) for one in seen.obstacles
        )

    def image(self, now_ns: int) -> Image:
        """Have an image taken."""
        answer, pixels = self._line.ask_bytes("image")
        reply, shape = decode_reply(answer), (self._camera.height, self._camera.width)
        if reply.refused or len(pixels) != shape[0] * shape[1]:
            raise DeviceUnreachable(f"image: {reply.refused or f'got {len(pixels)} pixels, allowed are {shape}'}")
        return Image(reply.now_ns, np.frombuffer(pixels, np.uint8).reshape(shape), self._camera)

    def _newest(self) -> Seen | None:
        payload = self._line.newest("perception")
        if payload is not None and payload is not self._payload:
            self._payload, self._seen = payload, decode_seen(payload)
        return self._seen
