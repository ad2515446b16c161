"""Laws of the command line: exit codes, one-line messages without a traceback, help that loads nothing heavy."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
import tyro

from preshape.control.distances import NORMS
from preshape.control.field import FIELD_MODES
from preshape.control.groups import TIES
from preshape.hal.device import DeviceUnreachable
from preshape.tools import cli, command_run, run_options
from preshape.tools.exit_codes import ExitCode
from preshape.tools.report import decode_report
from preshape.tools.run_directory import run_directory

HEAVY = ("numpy", "mujoco", "numba", "placo", "ruckig", "rerun", "zenoh", "joblib")


def exit_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert isinstance(ended.value.code, int)
    return ended.value.code


def scenario(folder: Path, text: str) -> str:
    file = folder / "scenario.toml"
    file.write_text(f'name = "case"\n{text}\n')
    return str(file)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[box]\nfricton = 0.5", ("box.fricton", "unknown key", "friction")),
        ("[box]\nmass_kg = 'heavy'", ("box.mass_kg", "'heavy'", "a number > 0 and <= 3")),
        ("[box]\nsize_m = [0.06, -0.09, 0.2]", ("box.size_m[1]", "-0.09", "> 0")),
        ("[opening]\nface = '-z'", ("opening.face", "-z", "+x, -x, +y, -y")),
        ("[box\n", ("scenario.toml", "not TOML")),
    ],
)
def test_a_bad_scenario_is_refused_with_one_line_and_no_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: tuple[str, ...]
) -> None:
    out = tmp_path / "out"
    assert exit_code("run", "--scenario", scenario(tmp_path, text), "--out", str(out)) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1 and printed.out == ""
    assert printed.err.startswith("preshape run: ")
    assert all(word in printed.err for word in words)
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--scenario", "no/such/file.toml"), "No such file"),
        (("--scenario", "teabox"), "tea_box"),
        (("--set", "box.friction"), "TABLE.FIELD=VALUE"),
        (("--set", "box.friction=9"), "box.friction: got 9"),
        (("--seed", "-1"), "--seed: got -1, allowed is >= 0"),
        (("--time-limit-s", "0"), "--time-limit-s: got 0"),
        (("--until-task", "6"), "--until-task: got 6, allowed is 1 .. 5"),
        (("--device", "hydraulics"), "--device"),
        (("--norm", "l3"), "--norm"),
        (("--seed", "one"), "--seed"),
        (("--strength-scale", "2"), "--strength-scale"),
    ],
)
def test_a_bad_option_is_refused_by_name(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], word: str
) -> None:
    assert exit_code("run", *arguments) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert word in printed.out + printed.err
    assert "Traceback" not in printed.out + printed.err


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert exit_code("run", "--out", str(tmp_path / "file" / "below")) == ExitCode.USAGE
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "cause"),
    [
        ("box.size_m=[0.25, 0.25, 0.4]", "no span"),
        ("arms.right_base_m=[-2.0, -1.0, 0.0]", "unreachable: the right hand"),
    ],
)
def test_what_nobody_can_do_fails_by_name_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], override: str, cause: str
) -> None:
    assert exit_code("run", "--set", override, "--out", str(tmp_path)) == ExitCode.TASK_FAILED
    printed = capsys.readouterr()
    assert cause in printed.out and "Traceback" not in printed.out + printed.err
    report = decode_report((tmp_path / "report.json").read_bytes())
    assert report.cause is not None and report.cause.startswith(cause)
    assert report.loop.ticks == 0 and report.sim.seconds == 0.0


def test_a_run_writes_all_its_files_and_prints_the_folder_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert exit_code("run", "--time-limit-s", "0.2", "--seed", "5", "--out", str(out)) == ExitCode.TASK_FAILED
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == str(out)
    assert any("task 1 grasp: look" in line for line in lines)
    assert any("storyboard.png" in line for line in lines)
    names = {path.name for path in out.iterdir()}
    assert names == {"report.json", "report.html", "recording.rrd", "recording.mcap", "plan.png", "storyboard.png"}
    assert decode_report((out / "report.json").read_bytes()).seed == 5
    assert exit_code("replay", str(out)) == ExitCode.DONE
    assert "equal: 101 commands" in capsys.readouterr().out
    assert exit_code("replay", str(out), "--set", "loop.max_ticks=50") == ExitCode.TASK_FAILED
    assert "ended early" in capsys.readouterr().out
    assert exit_code("replay", str(out), "--set", "loop.max_tick=50") == ExitCode.USAGE
    assert "loop.max_tick: unknown key" in capsys.readouterr().err
    assert exit_code("replay", str(out / "report.json")) == ExitCode.USAGE


def test_the_default_folder_names_scenario_and_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code("run", "--time-limit-s", "0.01", "--no-record", "--no-pictures") == ExitCode.TASK_FAILED
    printed = capsys.readouterr().out.splitlines()[-1]
    assert (tmp_path / printed / "report.json").is_file()
    assert printed.startswith("runs/") and printed.endswith("-tea_box-0")


def test_a_device_that_cannot_be_reached_has_its_own_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unreachable(options: object) -> int:
        raise DeviceUnreachable("physics process: no answer within 5 s")

    monkeypatch.setattr(command_run, "execute", unreachable)
    assert exit_code("run") == ExitCode.UNREACHABLE == 3
    assert capsys.readouterr().err == "preshape run: physics process: no answer within 5 s\n"


def test_a_defect_is_not_disguised_as_a_users_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(options: object) -> int:
        raise RuntimeError("defect")

    monkeypatch.setattr(command_run, "execute", defect)
    with pytest.raises(RuntimeError, match="defect"):
        cli.main(("run",))


def test_usage_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("--help") == ExitCode.DONE
    printed = capsys.readouterr().out
    assert all(name in printed for name in cli.COMMANDS)
    assert exit_code() == ExitCode.USAGE
    assert exit_code("walk") == ExitCode.USAGE
    assert "run" in capsys.readouterr().err
    assert exit_code("--version") == ExitCode.DONE


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_example_of_a_commands_help_is_understood(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    module, read = cli.command_module(name), list[object]()
    with pytest.raises(SystemExit):
        cli.run_command((name, "--help"))
    shown = capsys.readouterr().out.partition("examples:")[2].strip().splitlines()
    assert len(shown) == len(module.EXAMPLES) >= 2
    for line in shown:
        program, command, *arguments = shlex.split(line, comments=True)
        assert (program, command) == ("preshape", name)
        read.append(tyro.cli(module.Options, prog=line, args=arguments))
    assert len({repr(options) for options in read}) == len(shown)


@pytest.mark.parametrize("name", ["", *cli.COMMANDS])
def test_help_loads_nothing_heavy(name: str) -> None:
    arguments = [name, "--help"] if name else ["--help"]
    program = (
        "import sys\nfrom preshape.tools import cli\n"
        f"try:\n    cli.main({arguments!r})\n"
        f"except SystemExit as ended:\n    heavy = [m for m in {HEAVY!r} if m in sys.modules]\n"
        "    sys.exit(f'loaded {heavy}' if heavy else ended.code)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "preshape" in done.stdout


def test_the_options_offer_exactly_what_the_controller_knows() -> None:
    assert set(get_args(run_options.FieldName)) == set(FIELD_MODES)
    assert set(get_args(run_options.TiesName)) == set(TIES)
    assert set(get_args(run_options.NormName)) == set(NORMS)


@pytest.mark.parametrize(("there", "written", "stays"), [(0, 0, False), (0, 1, True), (1, 0, True)])
def test_a_run_that_cannot_begin_leaves_no_folder_unless_it_was_there_or_has_files(
    tmp_path: Path, there: bool, written: bool, stays: bool
) -> None:
    folder = tmp_path / "run"
    if there:
        folder.mkdir()
    with pytest.raises(DeviceUnreachable), run_directory(folder, "tea_box", 0) as made:
        assert made == folder and folder.is_dir()
        if written:
            (folder / "recording.mcap").touch()
        raise DeviceUnreachable("nothing there")
    assert folder.exists() == stays
