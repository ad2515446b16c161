"""The README's subscriber, run as it stands there against a robot."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

from zenoh_robot import running_robot

from preshape.hal.layout import LAYOUT
from preshape.tools.telemetry_keys import SCHEMAS, message_type
from preshape.tools.telemetry_messages import schema_of
from preshape.tools.telemetry_states import STATES

README = Path(__file__).parents[1] / "README.md"
SECONDS = 4.0


def subscriber() -> str:
    """Return the program in the section on Zenoh."""
    section = README.read_text("utf-8").partition("## Watch it over Zenoh")[2].partition("\n## ")[0]
    return re.findall(r"```python\n(.*?)```", section, re.DOTALL)[0]


def test_the_subscriber_of_the_readme_gets_every_stream_and_is_about_20_lines() -> None:
    program = subscriber()
    assert len([line for line in program.splitlines() if line.strip()]) <= 20
    with running_robot() as (_, endpoint):
        process = subprocess.Popen([sys.executable, "-c", program, endpoint], stdout=subprocess.PIPE, text=True)
        time.sleep(SECONDS)
        process.terminate()
        printed, _ = process.communicate(timeout=10.0)
    first, *lines = printed.splitlines()
    assert first.split()[1:] == list(LAYOUT.names)
    counts: Counter[str] = Counter()
    for line in lines:
        key, schema, *rest = line.split()
        tail = key.removeprefix("preshape/box/")
        kind = message_type(tail)
        assert kind is not None and schema == schema_of(kind)
        assert "lost" not in rest
        counts[tail] += 1
    assert set(STATES) <= set(counts) and counts["alive/loop"] > 10 and "health/loop" in counts
    assert all(counts[tail] >= 50 for tail in STATES if tail != "state/task")


def test_the_table_of_the_readme_names_every_key() -> None:
    section = README.read_text("utf-8").partition("## Watch it over Zenoh")[2]
    for tail in {tail.split("/")[0] for tail in SCHEMAS}:
        assert f"| `{tail}" in section
