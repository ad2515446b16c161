"""Which joint hangs on which module, which modules share a command, and which bus they are on. Configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from preshape.hal.can.identifiers import GROUPS, NODES
from preshape.hal.can.scales import SCALES, JointKind, Scale
from preshape.hal.layout import LAYOUT, SIDES, Side, arm_joint_names, hand_joint_names
from preshape.hal.sah_hand import FINGERS

Profile = Literal["fd", "classic"]

MOST_ACTUATORS = 4
"""Actuators that one module drives at most."""


@dataclass(frozen=True, slots=True)
class Module:
    """One node of a bus: an electronics board that drives up to four joints.

    Raises:
        ValueError: on construction, for a node number or joints that cannot be.
    """

    name: str
    node: int
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.node not in NODES:
            raise ValueError(f"node of module {self.name}: got {self.node}, allowed is {NODES[0]} .. {NODES[-1]}")
        if not 1 <= len(self.joints) <= MOST_ACTUATORS:
            got = len(self.joints)
            raise ValueError(f"joints of module {self.name}: got {got} of them, allowed is 1 .. {MOST_ACTUATORS}")
        unknown = [joint for joint in self.joints if joint not in LAYOUT.names]
        if unknown:
            raise ValueError(f"joints of module {self.name}: got {unknown[0]!r}, allowed are {', '.join(LAYOUT.names)}")

    @property
    def indices(self) -> tuple[int, ...]:
        """Places of the joints in the layout."""
        return tuple(LAYOUT.index(joint) for joint in self.joints)


@dataclass(frozen=True, slots=True)
class Group:
    """Modules of one kind that share one command broadcast; the joints stand in it in the modules' order.

    Raises:
        ValueError: on construction, for a group number that cannot be or no modules.
    """

    name: str
    number: int
    kind: JointKind
    modules: tuple[Module, ...]

    def __post_init__(self) -> None:
        if self.number not in GROUPS:
            raise ValueError(f"number of group {self.name}: got {self.number}, allowed is 0 .. {GROUPS[-1]}")
        if not self.modules:
            raise ValueError(f"modules of group {self.name}: got none, allowed is at least one")

    @property
    def scale(self) -> Scale:
        """What a count means in this group's frames."""
        return SCALES[self.kind]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints, in the command's order."""
        return tuple(joint for module in self.modules for joint in module.joints)

    @property
    def indices(self) -> tuple[int, ...]:
        """Places of all joints in the layout, in the command's order."""
        return tuple(index for module in self.modules for index in module.indices)

    def offset(self, module: Module) -> int:
        """Return how many joints stand before a module's own in the group's command."""
        return sum(len(other.joints) for other in self.modules[: self.modules.index(module)])


@dataclass(frozen=True, slots=True)
class BusSpec:
    """One bus: its bit rates and the groups on it. A bus of the classic profile has one bit rate."""

    name: str
    groups: tuple[Group, ...]
    profile: Profile = "fd"
    nominal_bit_per_s: int = 1_000_000
    data_bit_per_s: int = 5_000_000

    def __post_init__(self) -> None:
        for name, value in (("nominal", self.nominal_bit_per_s), ("data", self.data_bit_per_s)):
            if not 10_000 <= value <= 20_000_000:
                raise ValueError(f"{name}_bit_per_s of bus {self.name}: got {value}, allowed is 10000 .. 20000000")

    @property
    def modules(self) -> tuple[Module, ...]:
        """All modules on this bus."""
        return tuple(module for group in self.groups for module in group.modules)


@dataclass(frozen=True, slots=True)
class Topology:
    """All buses. Names, nodes, groups and joints occur once each; what is on no bus is not driven.

    Raises:
        ValueError: on construction, naming what occurs twice.
    """

    buses: tuple[BusSpec, ...]

    def __post_init__(self) -> None:
        _once("bus", (bus.name for bus in self.buses))
        _once("group", (group.name for group in self.groups))
        _once("group number", (group.number for group in self.groups))
        _once("module", (module.name for module in self.modules))
        _once("node", (module.node for module in self.modules))
        _once("joint", (joint for module in self.modules for joint in module.joints))

    def on_one_bus(self) -> Topology:
        """Return the same groups on one bus, with the first one's name and bit rates."""
        first = self.buses[0]
        return Topology((replace(first, groups=self.groups),))

    @property
    def groups(self) -> tuple[Group, ...]:
        """All groups, bus by bus."""
        return tuple(group for bus in self.buses for group in bus.groups)

    @property
    def modules(self) -> tuple[Module, ...]:
        """All modules, bus by bus."""
        return tuple(module for bus in self.buses for module in bus.modules)

    def group_of(self, module: Module) -> Group:
        """Return the group that a module belongs to."""
        return next(group for group in self.groups if module in group.modules)


def _once(what: str, names: Iterable[str | int]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"topology: got {what} {twice[0]} twice, allowed is once")


def hand_group(side: Side, number: int, first_node: int) -> Group:
    """Return one hand's group: a thumb module with 4 actuators and three finger modules with 3."""
    names = hand_joint_names(side)
    modules = tuple(
        Module(
            f"{side}_{finger}",
            first_node + place,
            tuple(name for name in names if name.startswith(f"{side}_{finger}_")),
        )
        for place, finger in enumerate(FINGERS)
    )
    return Group(f"{side}_hand", number, "hand", modules)


def arm_group(side: Side, number: int, first_node: int) -> Group:
    """Return one arm's group: shoulder module with 4 actuators, wrist module with 3."""
    names = arm_joint_names(side)
    modules = (
        Module(f"{side}_shoulder", first_node, names[:MOST_ACTUATORS]),
        Module(f"{side}_wrist", first_node + 1, names[MOST_ACTUATORS:]),
    )
    return Group(f"{side}_arm", number, "arm", modules)


def robot_topology(profile: Profile = "fd") -> Topology:
    """Return this robot's buses: one for each hand, one for both arms."""
    right, left = SIDES
    hands = hand_group(right, 0, 1), hand_group(left, 1, 5)
    arms = arm_group(right, 2, 9), arm_group(left, 3, 11)
    return Topology(
        (
            BusSpec("right_hand", (hands[0],), profile),
            BusSpec("left_hand", (hands[1],), profile),
            BusSpec("arms", arms, profile),
        )
    )


TOPOLOGY = robot_topology()
"""The default: three CAN FD buses, 12 modules, 40 joints."""
