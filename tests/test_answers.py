"""Laws of what the controller was told: recorded, sent to another process and replayed without losing a bit."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

from preshape.hal.answers import AnyAnswer, decode_answer, encode_answer
from preshape.hal.byte_ring import PIECE, PIECE_BYTES, ByteReader, ByteWriter
from preshape.hal.device import DeviceUnreachable
from preshape.hal.recorded_perception import RecordedPerception
from preshape.hal.recording import Recording
from preshape.hal.replay import ReplayEnded, ReplayPerception
from preshape.hal.tick_record import TICK
from preshape.hal.tick_ring import RingReader, RingWriter, ring_memory
from preshape.hal.transform import exp_so3, transform
from preshape.hal.world import CameraModel, Image, OrientedBox, PoseSample
from preshape.tools.answer_pack import pack, unpack

PERIOD_NS = 2_000_000
CAMERA = CameraModel(transform((0.1, 0.2, 1.3), exp_so3(np.array([0.1, 2.0, 0.3]))), 1.0 / 3.0, 40, 30)


class Drawn:
    """A perception that answers by chance: samples at a lower rate, an obstacle that comes and moves, images."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.sample: PoseSample | None = None
        self.images = 0

    def object_pose(self, now_ns: int) -> PoseSample | None:
        if self.rng.random() < 0.1:
            self.sample = PoseSample(now_ns - 7, transform(self.rng.normal(size=3), exp_so3(self.rng.normal(size=3))))
        return self.sample

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        if now_ns < 50 * PERIOD_NS:
            return ()
        return (OrientedBox("pillar", transform((now_ns * 1e-9 / 3.0, 0.0, 0.0)), np.full(3, 0.1)),)

    def image(self, now_ns: int) -> Image:
        self.images += 1
        if self.images == 2:
            raise DeviceUnreachable("camera: unplugged")
        return Image(now_ns - 3, self.rng.integers(0, 256, (30, 40), dtype=np.uint8), CAMERA)


class Heard:
    """A listener whose answers have been through JSON and through the pack that goes to another process."""

    def __init__(self) -> None:
        self.answers: list[AnyAnswer] = []
        self.images: dict[int, np.ndarray] = {}

    def __call__(self, answer: AnyAnswer, pixels: np.ndarray | None) -> None:
        answer, pixels = unpack(pack(decode_answer(encode_answer(answer)), pixels))
        self.answers.append(answer)
        if pixels is not None:
            self.images[answer.call] = pixels

    def recording(self) -> Recording:
        return Recording(b"{}", np.zeros(0, TICK), tuple(self.answers), self.images, True)


def ask(perception: Drawn | RecordedPerception | ReplayPerception, tick: int) -> list[bytes]:
    """Ask as a controller would, and return all bits of the answers."""
    now_ns = tick * PERIOD_NS
    sample = perception.object_pose(now_ns)
    told = [b"" if sample is None else sample.X_world_box.tobytes() + str(sample.stamp_ns).encode()]
    told += [o.name.encode() + o.X_world_box.tobytes() + o.half.tobytes() for o in perception.obstacles(now_ns)]
    if tick % 40 == 5:
        try:
            image = perception.image(now_ns)
            told.append(image.pixels.tobytes() + str(image.stamp_ns).encode() + image.model.X_world_camera.tobytes())
            told.append(np.float64(image.model.focal_px).tobytes())
        except DeviceUnreachable as error:
            told.append(str(error).encode())
    return told


def test_a_replay_answers_every_call_bit_for_bit() -> None:
    heard = Heard()
    recorded = RecordedPerception(Drawn(3), heard)
    before = [ask(recorded, tick) for tick in range(200)]
    assert before == [ask(inner, tick) for inner in [Drawn(3)] for tick in range(200)]
    assert len(heard.answers) < 200, "answers that were as before are not recorded again"
    replay = ReplayPerception(heard.recording())
    assert [ask(replay, tick) for tick in range(200)] == before


def test_a_question_at_another_time_ends_the_replay() -> None:
    heard = Heard()
    recorded = RecordedPerception(Drawn(3), heard)
    for tick in range(30):
        ask(recorded, tick)
    replay = ReplayPerception(heard.recording())
    with pytest.raises(ReplayEnded, match="object_pose"):
        replay.object_pose(1)
    with pytest.raises(ReplayEnded, match="image"):
        for _ in range(9):
            replay.image(5 * PERIOD_NS)


def test_messages_of_any_length_arrive_whole_and_in_order() -> None:
    memory = ring_memory(multiprocessing.get_context("spawn"), 64, PIECE)
    writer, reader = ByteWriter(RingWriter(memory, PIECE)), ByteReader(RingReader(memory, 0, PIECE))
    rng = np.random.default_rng(1)
    sent = [rng.bytes(size) for size in (0, 1, PIECE_BYTES - 1, PIECE_BYTES, PIECE_BYTES + 1, 5 * PIECE_BYTES + 3)]
    for message in sent:
        writer.send(message)
    assert reader.read() == sent and reader.lost == 0


def test_a_message_of_which_a_piece_is_lost_is_left_out_whole_and_counted() -> None:
    memory = ring_memory(multiprocessing.get_context("spawn"), 4, PIECE)
    writer, reader = ByteWriter(RingWriter(memory, PIECE)), ByteReader(RingReader(memory, 0, PIECE))
    writer.send(bytes(3 * PIECE_BYTES))
    writer.send(b"a")
    writer.send(b"b")
    writer.send(b"c")
    assert reader.read() == [b"a", b"b", b"c"] and reader.lost == 1
