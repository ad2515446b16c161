"""A real vcan for every test machine: on its own kernel, or in a guest; `tests/on_vcan/` holds what runs there."""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from preshape.hal.can.dbc import DBC_FILE
from preshape.tools import vcan_guest, with_vcan
from preshape.tools.configuration import load_scenario
from preshape.tools.rehearsal import prepare_kernels
from preshape.tools.report import decode_report
from preshape.tools.run_options import RunOptions
from preshape.tools.vcan_guest import TIMED_OUT, init_script, run_in_guest
from preshape.tools.vcan_host import VcanUnavailable
from preshape.tools.watch_wire import frames_of_log, watch
from preshape.tools.wire_monitor import WireMonitor
from preshape.tools.with_vcan import run_with_vcan

HERE = Path(__file__).parent
RATE_HZ, PACE = 250, 0.2
"""The run over vcan goes five times slower than real time: system calls are slow in a guest."""
WIRE_HZ = RATE_HZ * PACE
"""Commands of each group a second that are on the wire."""
PATIENCE_CYCLES = 50
"""As `on_vcan/first_grasp.sh` asks for."""
TRIES, STALLED_S = 3, 1.0
"""So often the run is tried on a machine that stalls, for longer than this in all, s."""
NAMED = re.compile(r":: \w+\(.+\)$")


def _run(script: str, interfaces: tuple[str, ...] = ("vcan0",), time_limit_s: float = 60.0) -> tuple[int, str]:
    output = io.BytesIO()
    status = run_with_vcan(["sh", "-c", script], interfaces, time_limit_s, output)
    return status, output.getvalue().decode()


@pytest.mark.bus
@pytest.mark.slow
def test_driver_and_kernel_keep_their_laws_on_a_real_vcan() -> None:
    files = [str(HERE / "on_vcan" / f"{name}.py") for name in ("frames", "conformance", "interfaces")]
    command = [str(Path(sys.executable).with_name("pytest")), "-q", "--color=no", "-p", "no:cacheprovider", *files]
    output = io.BytesIO()
    status = run_with_vcan(command, ("vcan0", "vcan1", "vcan2"), 400.0, output)
    assert status == 0, output.getvalue().decode()
    assert " skipped" not in output.getvalue().decode()


@pytest.mark.bus
@pytest.mark.slow
@pytest.mark.guest
def test_the_first_grasp_over_a_real_vcan_is_done_and_the_shipped_dbc_names_every_frame(tmp_path: Path) -> None:
    prepare_kernels(load_scenario("tea_box"), 0, RunOptions(device="can", until_task=1))
    path = f"PATH={Path(sys.executable).parent}:{os.environ['PATH']}"
    command = ["env", path, "sh", str(HERE / "on_vcan" / "first_grasp.sh"), str(tmp_path), str(RATE_HZ), str(PACE)]
    written = tmp_path / "out" / "report.json"
    for _ in range(TRIES):
        output = io.BytesIO()
        status = run_with_vcan(command, time_limit_s=900.0, output=output)
        printed = output.getvalue().decode()
        assert written.exists(), printed
        report = decode_report(written.read_bytes())
        # Only a machine that stood still for long excuses a run in real time.
        if status == 0 or report.sim.slipped_s < STALLED_S:
            break
    assert status == 0, printed
    assert (report.success, report.tasks[0].outcome, report.loop.rate_hz) == (True, "done", RATE_HZ)
    assert WIRE_HZ >= 50

    log = tmp_path / "can.log"
    decoded = _cantools_decode(log)
    assert len(decoded) == len(log.read_text().splitlines()) > 10_000
    assert all(NAMED.search(line) for line in decoded)
    # Rules are about the modules' time, which goes slowly here.
    verdict = watch(WireMonitor(1.0 / RATE_HZ, patience_cycles=PATIENCE_CYCLES), frames_of_log(log), PACE)
    # How evenly commands come is for the machine to say: timing is measured elsewhere.
    assert not set(verdict.broken) - {"rate"}, verdict.violations
    assert (dict(verdict.unknown), verdict.damaged, verdict.errors) == ({}, 0, 0)
    assert sum(verdict.frames.values()) == len(decoded)


def _cantools_decode(log: Path) -> list[str]:
    """Return what cantools makes of a log with the shipped DBC file, line by line."""
    program = Path(sys.executable).with_name("cantools")
    with log.open() as frames:
        ended = subprocess.run(
            [str(program), "decode", "--single-line", str(DBC_FILE)], stdin=frames, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
    return ended.stdout.splitlines()


@pytest.mark.bus
def test_a_command_keeps_its_directory_environment_output_and_exit_status(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PRESHAPE_TEST", "two  words; $HOME 'quoted'")
    monkeypatch.chdir(tmp_path)
    status, printed = _run('printf "%s\\n" "$PRESHAPE_TEST" "$PWD" & wait; echo error >&2; ip -br link; exit 7',
                           interfaces=("vcan0", "can_left"))  # fmt: skip
    assert status == 7
    lines = printed.splitlines()
    assert lines[:3] == ["two  words; $HOME 'quoted'", str(tmp_path), "error"]
    assert [line.split()[0] for line in lines if "LOWER_UP" in line and "vcan0" in line] == ["vcan0"]
    assert any(line.startswith("can_left") and "UP" in line for line in lines)


@pytest.mark.bus
def test_a_command_that_does_not_end_is_ended_at_its_time_limit() -> None:
    status, printed = _run("echo begun; sleep 1000; echo over", time_limit_s=10.0)
    assert (status, printed) == (TIMED_OUT, "begun\n")


@pytest.mark.bus
def test_where_the_kernel_has_can_the_command_runs_on_it_without_a_guest() -> None:
    inner = shlex.join(["--interfaces", "vcan0", "vcan5", "--", "sh", "-c", "ip -br link; sleep 1000 & exit 3"])
    status, printed = _run(f"PATH=$PATH:/usr/sbin {sys.executable} -m {with_vcan.__name__} {inner}")
    assert status == 3, printed
    assert "vcan5" in printed


def test_without_can_and_without_a_guest_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vcan_guest, "MODULES", Path("/nowhere"))
    monkeypatch.setattr(vcan_guest, "KERNEL", "no-such-kernel")
    monkeypatch.setattr(vcan_guest, "NEEDED", {"no-such-kernel": "user-mode-linux", "sh": "dash"})
    with pytest.raises(VcanUnavailable) as caught:
        run_in_guest(["true"], ["vcan0"], 1.0, io.BytesIO())
    assert str(caught.value) == "no guest with CAN either: sudo apt-get install user-mode-linux"


def test_the_guests_script_quotes_whatever_a_command_holds(tmp_path: Path) -> None:
    words = ["printf", "%s|", "a b", "$(reboot)", "it's", "; exit 3", ""]
    script = init_script(words, ["vcan0"], tmp_path / "the status", tmp_path, {"ODD": "x'; y\n$z"})
    assert subprocess.run(["sh", "-n"], input=script, text=True, check=False).returncode == 0
    line = script[script.index("env -i ") : script.index(" >/dev/shm/printed")]
    got = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=True,
                         env={"PATH": os.environ["PATH"]})  # fmt: skip
    assert got.stdout == "".join(f"{word}|" for word in words[2:])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["true"], "put -- before the command"),
        (["--"], "at least one word"),
        (["--time-limit-s", "0", "--", "true"], "more than 0 s"),
        (["--time-limit-s", "soon", "--", "true"], "invalid float value: 'soon'"),
    ],
)
def test_wrong_usage_is_named_and_exits_with_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        with_vcan.main(arguments)
    assert caught.value.code == 2
    assert words in capsys.readouterr().err


def test_candump_is_there_for_the_logs_of_a_bus() -> None:
    assert shutil.which("candump") is not None, "apt-get install can-utils"
