"""The topology: every joint once, limits of numbers, and errors that name what is wrong."""

from __future__ import annotations

import dataclasses

import pytest

from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.topology import TOPOLOGY, BusSpec, Group, Module, Topology, robot_topology
from preshape.hal.layout import LAYOUT


def test_the_robot_has_every_joint_on_exactly_one_module() -> None:
    joints = [joint for module in TOPOLOGY.modules for joint in module.joints]
    assert sorted(joints) == sorted(LAYOUT.names)


def test_thumbs_have_four_actuators_fingers_three_and_arm_modules_up_to_four() -> None:
    counts = {module.name: len(module.joints) for module in TOPOLOGY.modules}
    for side in ("right", "left"):
        assert [counts[f"{side}_{f}"] for f in ("thumb", "fore", "middle", "ring")] == [4, 3, 3, 3]
        assert [counts[f"{side}_shoulder"], counts[f"{side}_wrist"]] == [4, 3]


def test_a_group_lists_its_joints_module_by_module() -> None:
    group = TOPOLOGY.groups[0]
    for module in group.modules:
        offset = group.offset(module)
        assert group.joints[offset : offset + len(module.joints)] == module.joints
        assert [LAYOUT.names[index] for index in module.indices] == list(module.joints)
        assert TOPOLOGY.group_of(module) is group


def test_values_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        TOPOLOGY.buses = ()  # type: ignore[misc]


@pytest.mark.parametrize("node", [0, 32, -1])
def test_a_node_outside_its_block_of_identifiers_is_refused(node: int) -> None:
    with pytest.raises(ValueError, match=rf"node of module m: got {node}, allowed is 1 \.\. 31"):
        Module("m", node, ("right_arm_1",))


def test_too_many_actuators_and_unknown_joints_are_refused() -> None:
    with pytest.raises(ValueError, match="got 5 of them, allowed is 1 .. 4"):
        Module("m", 1, LAYOUT.names[:5])
    with pytest.raises(ValueError, match="got 'elbow', allowed are right_arm_1"):
        Module("m", 1, ("elbow",))


def test_what_occurs_twice_is_named() -> None:
    one, two = Module("a", 1, ("right_arm_1",)), Module("b", 1, ("right_arm_2",))
    with pytest.raises(ValueError, match="got node 1 twice, allowed is once"):
        Topology((BusSpec("bus", (Group("g", 0, "arm", (one, two)),)),))
    again = dataclasses.replace(two, node=2, joints=("right_arm_1",))
    with pytest.raises(ValueError, match="got joint right_arm_1 twice"):
        Topology((BusSpec("bus", (Group("g", 0, "arm", (one, again)),)),))


def test_a_group_that_no_frame_can_command_is_refused() -> None:
    modules = tuple(Module(f"m{k}", k + 1, LAYOUT.names[3 * k : 3 * k + 3]) for k in range(6))
    with pytest.raises(ValueError, match="joints of group all: got 18, allowed is 1 .. 13"):
        CommandCodec(Group("all", 0, "hand", modules))


def test_bit_rates_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="data_bit_per_s of bus b: got 5, allowed is 10000"):
        BusSpec("b", robot_topology().groups, data_bit_per_s=5)
