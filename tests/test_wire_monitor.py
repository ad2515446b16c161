"""The passive monitor: quiet while the rules are kept, and each rule, once broken, is named with who, how and when."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_script import DATABASE, MODULES, PERIOD_S, WireScript, counts_of, frame, joints

from preshape.hal.layout import LAYOUT
from preshape.tools.wire_monitor import WireMonitor
from preshape.tools.wire_table import KINDS, FrameTable, frame_tables

JOINT = "right_fore_flex"
SPEED = float(LAYOUT.velocity[LAYOUT.index(JOINT)])


@pytest.fixture
def script() -> WireScript:
    script = WireScript()
    script.begin()
    return script


def test_a_session_that_keeps_all_rules_breaks_none(script: WireScript) -> None:
    step = 0.99 * SPEED * PERIOD_S
    for _ in range(100):
        script.position[JOINT] += step
        script.cycles(1)
    verdict = script.monitor.verdict()
    assert verdict.ok and not verdict.violations
    assert verdict.frames["right_hand_command"] == 125
    assert (verdict.damaged, verdict.errors, dict(verdict.unknown)) == (0, 0, {})
    assert verdict.torque_limit_ratio == pytest.approx(1.0, abs=1e-3)
    assert verdict.speed_ratio == pytest.approx(0.99, abs=0.05)


@pytest.mark.parametrize("over", [1.01, 2.0])
def test_a_torque_limit_above_the_joints_own_is_named(script: WireScript, over: float) -> None:
    script.command(limit=over)
    assert set(script.broken()) == {"torque limit"}
    assert "limit of right_thumb_opp" in str(script.monitor.verdict().violations[0])


def test_the_limit_of_a_joint_that_is_not_enabled_does_not_count(script: WireScript) -> None:
    script.command(limit=2.0, enable=0)
    assert script.broken() == {}


def test_the_limit_of_a_hold_counts_too(script: WireScript) -> None:
    script.command(limit=2.0, mode="hold")
    assert set(script.broken()) == {"torque limit"}


@pytest.mark.parametrize("mode", ["hold", "torque", "brake"])
def test_what_leads_a_joint_after_another_mode_begins_where_it_is(script: WireScript, mode: str) -> None:
    script.command(mode=mode)
    script.command({JOINT: script.position[JOINT] + 0.5 * SPEED * PERIOD_S})
    assert script.broken() == {"first command": 1}


def test_a_target_that_moves_faster_than_its_joint_may_is_named(script: WireScript) -> None:
    script.command({JOINT: script.position[JOINT] + 1.2 * SPEED * PERIOD_S})
    assert script.broken() == {"speed": 1}
    assert f"target of {JOINT} moves at" in str(script.monitor.verdict().violations[0])


def test_after_lost_commands_the_target_may_have_moved_as_far_as_they_took(script: WireScript) -> None:
    script.sequence += 3
    script.time_s += 3 * PERIOD_S
    script.command({JOINT: script.position[JOINT] + 3.9 * SPEED * PERIOD_S})
    assert script.broken() == {}
    script.command({JOINT: script.position[JOINT] - 0.1 * SPEED * PERIOD_S})
    assert script.broken() == {"speed": 1}


def test_commands_caught_up_in_a_burst_are_named(script: WireScript) -> None:
    script.time_s += 10 * PERIOD_S
    for _ in range(10):
        script.command()
        script.time_s += 1e-4
    assert script.broken() == {"rate": 1}


def test_a_late_command_followed_by_one_on_time_is_no_burst(script: WireScript) -> None:
    for number in range(100):
        script.time_s += 1.9 * PERIOD_S if number % 10 == 0 else (0.1 * PERIOD_S if number % 10 == 1 else PERIOD_S)
        script.command()
    assert script.broken() == {}


@pytest.mark.parametrize("back", [0, 1, 30])
def test_a_sequence_number_that_is_not_newer_is_named(script: WireScript, back: int) -> None:
    script.sequence = (script.sequence - 1 - back) % (1 << 16)
    script.command()
    assert script.broken() == {"sequence": 1}


def test_polls_between_commands_change_nothing(script: WireScript) -> None:
    script.position[JOINT] += 0.02
    for _ in range(30):
        script.command({JOINT: 0.3}, mode="poll", session=0, enable=0)
        script.time_s += PERIOD_S
    script.command({JOINT: 0.3})
    assert script.broken() == {}


def test_sequence_numbers_may_wrap_and_begin_anew_with_a_session() -> None:
    script = WireScript()
    script.sequence = (1 << 16) - 20
    script.begin()
    script.cycles(5)
    script.session, script.sequence = 8, 0
    script.arm()
    script.cycles(5)
    assert script.broken() == {}


def test_a_module_that_takes_a_command_that_nobody_sent_is_named(script: WireScript) -> None:
    script.answer(taken=1, sequence=script.sequence + 5)
    assert script.broken() == {"sequence": len(MODULES)}


@pytest.mark.parametrize(("off", "rules"), [(0.0, {}), (1e-4, {}), (3e-4, {"first command": 1})])
def test_the_first_command_of_a_session_is_the_measured_position_within_a_count(
    script: WireScript, off: float, rules: dict[str, int]
) -> None:
    script.session = 8
    script.arm()
    script.command({JOINT: script.position[JOINT] + off})
    assert script.broken() == rules


def test_a_module_that_is_armed_without_being_told_is_named() -> None:
    script = WireScript()
    script.state = "armed"
    script.answer()
    assert script.broken() == {"arming": len(MODULES)}


def test_a_module_that_was_stopped_needs_to_be_told_again(script: WireScript) -> None:
    script.state = "stopped"
    script.answer()
    script.state = "armed"
    script.answer()
    assert script.broken() == {"arming": len(MODULES)}


def test_after_a_quick_stop_nothing_moves_until_a_new_session_is_armed(script: WireScript) -> None:
    script.take("quick_stop")
    script.command()
    script.state = "stopped"
    script.answer()
    script.time_s += 0.05
    script.command(mode="poll")
    script.answer()
    script.session = 9
    script.arm()
    script.cycles(5)
    assert script.broken() == {}


def test_a_session_that_goes_on_after_a_quick_stop_is_named(script: WireScript) -> None:
    script.take("quick_stop")
    script.state = "stopped"
    script.answer()
    script.time_s += 0.03
    script.command()
    assert script.broken() == {"stop": 1}


def test_a_module_that_stays_armed_after_a_quick_stop_is_named_once(script: WireScript) -> None:
    script.take("quick_stop")
    for _ in range(20):
        script.time_s += PERIOD_S
        script.answer()
    assert script.broken() == {"stop": len(MODULES)}


def test_a_module_that_is_armed_long_after_the_last_command_is_named(script: WireScript) -> None:
    # The last command came one period ago. Five periods and 10 ms are 20 ms.
    script.time_s += 0.017
    script.take("right_fore_heartbeat", state="armed")
    script.take("right_fore_emergency", state="fault", error="watchdog")
    assert script.broken() == {}
    script.time_s += 0.002
    script.take("right_fore_heartbeat", state="fault")
    script.take("right_fore_emergency", state="fault", error="sensor")
    assert script.broken() == {}
    script.take("right_fore_heartbeat", state="armed")
    script.take("right_ring_emergency", state="fault", error="watchdog")
    assert script.broken() == {"silence": 2}
    assert "right_fore: armed 0.021 s after the last command" in str(script.monitor.verdict().violations[0])


def test_a_module_that_has_not_been_commanded_since_it_was_armed_may_wait(script: WireScript) -> None:
    script.time_s += 1.0
    script.arm()
    script.time_s += 1.0
    script.take("right_fore_heartbeat", state="armed")
    assert script.broken() == {}


def test_a_quick_stop_is_for_its_own_bus(script: WireScript) -> None:
    script.monitor.take(script.time_s, *frame("quick_stop"), channel="another")
    script.cycles(30)
    assert script.broken() == {}


@pytest.mark.parametrize(("seconds", "rules"), [(0.008, {}), (0.014, {"torque": 1})])
def test_torque_above_a_fifth_over_the_limit_may_last_ten_milliseconds(
    script: WireScript, seconds: float, rules: dict[str, int]
) -> None:
    script.torque[JOINT] = -1.3 * float(LAYOUT.torque[LAYOUT.index(JOINT)])
    script.cycles(round(seconds / PERIOD_S))
    script.torque[JOINT] = 0.0
    script.cycles(10)
    assert script.broken() == rules
    assert script.monitor.verdict().torque_ratio == pytest.approx(1.3, abs=0.01)


def test_damaged_unknown_and_error_frames_are_counted_and_mean_nothing(script: WireScript) -> None:
    identifier, data = frame("right_hand_command", session=9, mode="position", enable=1)
    script.monitor.take(script.time_s, identifier, data[:-1] + bytes([data[-1] ^ 1]))
    script.monitor.take(script.time_s, identifier, data[:20])
    script.monitor.take(script.time_s, 0x3AB, b"")
    script.monitor.take(script.time_s, 0x40, bytes(8), is_error=True)
    verdict = script.monitor.verdict()
    assert (verdict.damaged, dict(verdict.unknown), verdict.errors, verdict.ok) == (2, {0x3AB: 1}, 1, True)


def test_every_message_of_the_file_has_a_kind_an_owner_and_its_length() -> None:
    tables = frame_tables()
    assert {table.kind for table in tables.values()} == set(KINDS)
    for message in DATABASE.messages:
        table = tables[message.frame_id]
        assert (table.name, table.length) == (message.name, message.length)
        assert (table.owner == "") == (table.kind == "quick_stop")


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_tables_say_what_cantools_says(data: st.DataObject) -> None:
    message = data.draw(st.sampled_from([m for m in DATABASE.messages if not m.is_multiplexed()]))
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    table = FrameTable(message)
    said = message.decode(payload, decode_choices=False, scaling=True)
    for what, column in table.columns.items():
        wanted = [said[f"{joint}_{what}"] for joint in column.joints]
        assert counts_of(column.read(payload), column.scale) == [round(value / column.scale) for value in wanted]
        assert column.read(payload) == pytest.approx(wanted, abs=1e-12)
    for signal in message.signals:
        if not any(signal.name.startswith(joint) for joint in LAYOUT.names):
            got = table.number(signal.name, payload)
            assert got == (said[signal.name] % (1 << signal.length))


def test_the_script_names_the_hands_thirteen_joints() -> None:
    assert len(joints("right_hand")) == 13
    assert sorted(joints("right_hand")) == sorted(name for module in MODULES for name in joints(module))


def test_an_empty_wire_breaks_no_rule() -> None:
    verdict = WireMonitor().verdict()
    assert verdict.ok and not verdict.frames
