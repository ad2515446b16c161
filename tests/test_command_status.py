"""Laws of `preshape status`: what it shows is the robot's own word, and silence is said in one line."""

from __future__ import annotations

import io
import os
import signal

import msgspec
import pytest
from rich.console import Console
from zenoh_robot import client, running_robot, until

from preshape.hal.device import DeviceUnreachable
from preshape.tools import cli
from preshape.tools.exit_codes import ExitCode
from preshape.tools.status_client import ask_status
from preshape.tools.status_table import status_table
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_messages import Health
from preshape.tools.telemetry_requests import Status


def test_status_shows_rates_ages_and_every_part_as_table_and_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    with running_robot() as (loop, endpoint):
        assert until(lambda: loop.tick > 200)
        with client(endpoint) as session:
            status = ask_status(session, Keys())
        assert cli.run_command(["status", "--endpoint", endpoint, "--json"]) == ExitCode.DONE
        printed = msgspec.json.decode(capsys.readouterr().out, type=Status)
        assert cli.run_command(["status", "--endpoint", endpoint]) == ExitCode.DONE
        table = capsys.readouterr().out
    assert status.loop is not None and status.joints is not None and status.task is not None
    assert status.loop.rate_hz > 100.0 and status.loop.compute_us is not None
    assert status.joints.age_ms is not None and status.joints.age_ms.p50 == pytest.approx(0.5, abs=0.01)
    assert status.parts == {"loop": "running", "telemetry": "running"}
    assert printed.loop is not None and printed.loop.count >= status.loop.count
    for word in ("robot box on fake", "approach", "loop", "fake", "telemetry", "300 / 300"):
        assert word in table


def test_buses_and_what_is_wrong_stand_in_the_table() -> None:
    bus = Health(
        seq=0, stamp_ns=0, mono_ns=0, device="right_hand", status="WARNING", fault="", count=10, rate_hz=1000.0,
        bus_load=0.42, bus_errors=3, temperature_c={"thumb": 41.0, "fore": 38.0},
    )  # fmt: skip
    status = Status(
        robot="box", device="can", loop=None, joints=None, buses=[bus], telemetry=bus, task=None,
        parts={"loop": "stopped"}, stop_reason="me: enough", parameters={},
    )  # fmt: skip
    console = Console(file=io.StringIO(), width=140)
    console.print(status_table(status))
    printed = console.file.getvalue()  # pyright: ignore
    for word in ("42% 3 err", "41 thumb", "loop is stopped", "stop asked for: me: enough"):
        assert word in printed


def test_silence_is_named() -> None:
    with running_robot() as (loop, endpoint), client(endpoint) as session:
        assert until(lambda: loop.tick > 50)
        pid = loop.telemetry.process.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(DeviceUnreachable, match="robot box: no answer within 0.3 s: not running, or stopped"):
            ask_status(session, Keys(), 0.3)
        os.kill(pid, signal.SIGCONT)
        ask_status(session, Keys(), 5.0)


def test_no_robot_is_exit_code_3_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run_command(["status", "--endpoint", "tcp/127.0.0.1:1"]) == ExitCode.UNREACHABLE
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("preshape status: Zenoh session at tcp/127.0.0.1:1: ")
