"""The command line: imports only the module of the command that is asked for, and turns errors into exit codes."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from types import ModuleType

from preshape import __version__
from preshape.tools.exit_codes import ExitCode, expected_error

COMMANDS: dict[str, str] = {
    "plan": "plan a task: priorities, areas, preshaping boxes, preshapes; nothing moves",
    "run": "carry out the procedure and write a report",
    "dash": "watch a running robot, or a recording, in the rerun viewer",
    "record": "write down what a running robot publishes over Zenoh",
    "replay": "feed a recording through the controller again and compare its commands bit for bit",
    "sweep": "run scenarios over many seeds in parallel and count",
    "hand-bus": "simulate the joint modules on CAN buses, for a run or a driver elsewhere",
    "serve": "hold a device for a controller in another process (run --device zenoh)",
    "status": "show how a running robot is: rates, ages, jitter, overruns, buses, temperatures",
    "doctor": "show this machine, and what the grip holds beside what opening asks",
    "bench": "measure what the parts cost on this machine",
}
"""Name -> what it does. Its module is `command_<name>`, with a dataclass `Options`, `EXAMPLES` and
`execute(options) -> int`."""


def usage() -> str:
    """Return what `preshape --help` prints."""
    width = max(len(name) for name in COMMANDS)
    lines = [f"  {name:<{width}}  {summary}" for name, summary in COMMANDS.items()]
    return "\n".join(
        [
            "usage: preshape COMMAND [OPTIONS]",
            "",
            "Plans and runs box-opening procedures for two arms with torque-sensing hands.",
            "",
            "commands:",
            *lines,
            "",
            "`preshape COMMAND --help` shows a command's options; `preshape --version` the version.",
            "exit codes: 0 done, 1 the task failed, 2 usage or configuration, 3 hardware unreachable, 4 safety stop",
        ]
    )


def command_module(name: str) -> ModuleType:
    """Import and return the module of a command; it loads nothing heavy before `execute`."""
    return importlib.import_module(f"preshape.tools.command_{name.replace('-', '_')}")


def examples(module: ModuleType) -> str:
    """Return what a command's help ends with: lines to be pasted, each with what it does."""
    width = max(len(line) for line, _ in module.EXAMPLES)
    return "\n".join(["examples:", *(f"  {line:<{width}}  # {what}" for line, what in module.EXAMPLES)])


def run_command(arguments: Sequence[str]) -> int:
    """Run the command that the arguments name and return its exit code."""
    if not arguments:
        print(usage(), file=sys.stderr)
        return ExitCode.USAGE
    name, *rest = arguments
    if name in ("-h", "--help"):
        print(usage())
        return ExitCode.DONE
    if name == "--version":
        print(f"preshape {__version__}")
        return ExitCode.DONE
    if name not in COMMANDS:
        print(f"preshape: no command {name!r}, allowed are {', '.join(COMMANDS)}", file=sys.stderr)
        return ExitCode.USAGE
    return _execute(name, rest)


def _execute(name: str, arguments: Sequence[str]) -> int:
    module = command_module(name)
    try:
        return int(module.execute(_options(module, name, arguments)))
    except Exception as error:
        code = expected_error(error)
        if code is None:
            raise
        print(f"preshape {name}: {error}", file=sys.stderr)
        return code


def _options(module: ModuleType, name: str, arguments: Sequence[str]) -> object:
    """Return a command's options; `SystemExit` after its help, or after what is wrong with them has been said."""
    import tyro

    try:
        return tyro.cli(module.Options, prog=f"preshape {name}", args=list(arguments))
    except SystemExit as ended:
        if not ended.code:
            print(examples(module))
        raise


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `preshape`: run a command and exit with its code."""
    try:
        code = run_command(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        print("preshape: interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)
