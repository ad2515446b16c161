"""The example of access control in docs/zenoh: a viewer sees everything, and can neither command nor speak."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from zenoh_robot import Loop, ask, free_endpoint, request, running_robot, until

from preshape.hal.device import DeviceUnreachable
from preshape.tools.telemetry_file import load_telemetry
from preshape.tools.telemetry_states import STATES
from preshape.tools.zenoh_session import open_session

ROOT = "preshape/box"
EXAMPLES = Path(__file__).parents[1] / "docs" / "zenoh"
USUAL = "tcp/127.0.0.1:7447"


class Guarded:
    """A robot with the example's rules at a free port, and the ways in."""

    def __init__(self, loop: Loop, folder: Path, endpoint: str) -> None:
        self.loop, self._folder, self._endpoint = loop, folder, endpoint

    def session(self, user: str, password: str) -> zenoh.Session:
        """Return the example client's session for a user."""
        text = (EXAMPLES / "viewer.json5").read_text().replace(USUAL, self._endpoint)
        text = text.replace('user: "viewer"', f'user: "{user}"').replace('"change-me"', json.dumps(password))
        file = self._folder / f"{user}.json5"
        file.write_text(text)
        return open_session({"listen/endpoints": [], "connect/endpoints": []}, file)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder, endpoint = tmp_path_factory.mktemp("access"), free_endpoint()
    text = (EXAMPLES / "robot.json5").read_text()
    for usual, here in ((USUAL, endpoint), ("docs/zenoh/users.txt", str(EXAMPLES / "users.txt"))):
        assert usual in text
        text = text.replace(usual, here)
    (folder / "robot.json5").write_text(text)
    with running_robot(zenoh_config=str(folder / "robot.json5")) as (loop, _):
        yield Guarded(loop, folder, endpoint)


def test_a_viewer_sees_every_stream_and_may_ask_for_what_was_said(guarded: Guarded) -> None:
    with guarded.session("viewer", "change-me") as viewer:
        seen: set[str] = set()
        viewer.declare_subscriber(f"{ROOT}/**", lambda sample: seen.add(str(sample.key_expr).removeprefix(ROOT + "/")))
        assert until(lambda: set(STATES) <= seen and "alive/loop" in seen and "health/loop" in seen)
        assert len(ask(viewer, f"{ROOT}/info/*")) == 3
        assert ask(viewer, f"{ROOT}/call/status")[0]["robot"] == "box"
        alive = [str(reply.ok.key_expr) for reply in viewer.liveliness().get("preshape/**") if reply.ok]
        assert sorted(alive) == [f"{ROOT}/alive/loop", f"{ROOT}/alive/telemetry"]


def test_a_viewer_cannot_command(guarded: Guarded) -> None:
    with guarded.session("viewer", "change-me") as viewer:
        for call in ("stop", "arm", "start", "goal"):
            answers = viewer.get(f"{ROOT}/call/{call}", payload=request(1), timeout=0.5)
            assert not [answer for answer in answers if answer.ok]
        assert not [
            a for a in viewer.get(f"{ROOT}/param/joints_hz", payload=request(2, value=1.0), timeout=0.5) if a.ok
        ]
        for every in ("preshape/*/call/stop", "preshape/**/call/stop", "preshape/**"):
            answers = viewer.get(every, payload=request(3), timeout=0.5)
            assert not [answer for answer in answers if answer.ok and "/call/" in str(answer.ok.key_expr)]
        time.sleep(0.2)
    assert guarded.loop.stops == []


def test_a_viewer_cannot_speak_for_the_robot(guarded: Guarded) -> None:
    with guarded.session("viewer", "change-me") as liar, guarded.session("operator", "change-me-as-well") as listener:
        heard: list[bytes] = []
        listener.declare_subscriber("preshape/**", lambda sample: heard.append(sample.payload.to_bytes()))
        liar.declare_queryable(f"{ROOT}/call/*", lambda query: query.reply(query.key_expr, b"lie"))
        assert until(lambda: heard)
        for tail in (*STATES, "event", "health/loop", "alive/loop", "info/robot"):
            liar.put(f"{ROOT}/{tail}", b"lie")
            liar.delete(f"{ROOT}/{tail}")
        liar.put("preshape/another/state/task", b"lie")
        count = len(heard)
        assert until(lambda: len(heard) > count + 20)
        assert b"lie" not in heard and b"" not in heard
        answers = [reply.ok.payload.to_bytes() for reply in listener.get(f"{ROOT}/call/status") if reply.ok]
        assert len(answers) == 1 and answers != [b"lie"]


def test_a_wrong_password_and_an_unknown_user_do_not_come_in(guarded: Guarded) -> None:
    for user, password in (("viewer", "guessed"), ("nobody", "change-me")):
        with pytest.raises(DeviceUnreachable):
            guarded.session(user, password)


def test_an_operator_can_stop(guarded: Guarded) -> None:
    with guarded.session("operator", "change-me-as-well") as operator:
        assert ask(operator, f"{ROOT}/call/stop", request(1, reason="enough"))[0]["code"] == "done"
    assert until(lambda: guarded.loop.stops == ["test: enough"])


def test_the_example_is_read_with_its_configuration_beside_it() -> None:
    config = load_telemetry(EXAMPLES / "telemetry.toml")
    assert config.zenoh_config is not None and Path(config.zenoh_config).samefile(EXAMPLES / "robot.json5")
