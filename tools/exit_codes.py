"""What the exit code of every command means, and which one an error stands for."""

from __future__ import annotations

from enum import IntEnum


class ExitCode(IntEnum):
    """The exit codes of `preshape`."""

    DONE = 0
    TASK_FAILED = 1
    USAGE = 2
    UNREACHABLE = 3
    SAFETY_STOP = 4


def expected_error(error: Exception) -> ExitCode | None:
    """Return the exit code of an error that a user can cause; None for all others, which are defects."""
    from preshape.hal.device import DeviceUnreachable
    from preshape.hal.recording import RecordingError
    from preshape.tools.configuration_error import ConfigurationError

    if isinstance(error, ConfigurationError | RecordingError):
        return ExitCode.USAGE
    if isinstance(error, DeviceUnreachable):
        return ExitCode.UNREACHABLE
    return None
