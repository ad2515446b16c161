"""The referee's verdict as a value: what `report.json` carries under `referee`, and whether it is a success."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

TASK_NAMES = {1: "grasp", 2: "inspect", 3: "regrasp", 4: "crush", 5: "open"}
"""The paper's tasks."""
LIFT_TASK_NAMES = {1: "grasp", 2: "hold"}
"""The tasks of an object that has no lid."""

TORQUE_RATIO_ALLOWED = 1.2
"""Link-side torque over limit that must not last."""
COMMANDED_RATIO_ALLOWED = 1.0 + 1e-9
SLIP_ALLOWED_MM = 5.0
TORN_FRACTION_NEEDED = 0.9

Contact = tuple[str, str, float]
"""One link, the other geom, and the time of their first touch, s."""


@dataclass(frozen=True, slots=True)
class TaskTruth:
    """One task by true events: when it could begin (the one before had ended), whether and when it was done."""

    task: int
    name: str
    done: bool
    start_s: float | None
    end_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """All that the referee has seen; times in s since the start of the simulation.

    Attributes:
        undesired_contacts: first touch of each pair that the table of its stage does not allow.
        self_contacts: first touch of each pair of parts of one hand; not undesired.
        desired_contacts_made: by task, the contact that it asks for.
        max_torque_ratio: largest link-side torque over limit that lasted longer than 10 ms.
        peak_torque_ratio: the same without regard to how long.
        max_commanded_ratio: largest torque or torque limit asked of a joint, over its limit.
        hold_slip_mm: sliding at the holding hand's contacts, weighted by load; of the two hands', the larger.
        worst_link_slip_mm: the same of the one hand part that slid most.
        regrasp_motion_mm: farthest the box moved, beyond what its holding hand was told to do, while the other hand
            took it: from that hand's first touch until it bears more load.
        max_panel_load_n: largest force into one face of the box that lasted for the tear time, by face.
        tab_angle_deg, lid_angle_deg: at the end; `max_` the largest.
        opening_error: of the reported opening, (m, rad), None before a report.
        events: truth time of each event.
        until_task: the last task that was asked for; what comes after it counts for nothing.
    """

    undesired_contacts: tuple[Contact, ...]
    self_contacts: tuple[Contact, ...]
    desired_contacts_made: Mapping[str, bool]
    dropped: bool
    crushed: bool
    max_torque_ratio: float
    max_torque_joint: str
    peak_torque_ratio: float
    max_commanded_ratio: float
    hold_slip_mm: float
    worst_link_slip_mm: float
    regrasp_motion_mm: float
    max_panel_load_n: Mapping[str, float]
    tab_angle_deg: float
    max_tab_angle_deg: float
    lid_angle_deg: float
    max_lid_angle_deg: float
    tab_torn: bool
    torn_fraction: float
    opening_error: tuple[float, float] | None
    tasks: tuple[TaskTruth, ...]
    events: Mapping[str, float] = field(default_factory=dict)
    until_task: int = len(TASK_NAMES)

    @property
    def undone(self) -> tuple[TaskTruth, ...]:
        """The tasks asked for that have not been done."""
        return tuple(task for task in self.tasks if not task.done and task.task <= self.until_task)

    @property
    def failures(self) -> tuple[str, ...]:
        """Name everything that keeps this from being a success; empty if it is one."""
        checks = {
            **{f"task {task.task} ({task.name}) not done": True for task in self.undone},
            "undesired contact": bool(self.undesired_contacts),
            "dropped": self.dropped,
            "crushed": self.crushed,
            f"torque above {TORQUE_RATIO_ALLOWED} x limit": self.max_torque_ratio > TORQUE_RATIO_ALLOWED,
            "commanded torque above limit": self.max_commanded_ratio > COMMANDED_RATIO_ALLOWED,
            f"slip above {SLIP_ALLOWED_MM:g} mm": self.hold_slip_mm > SLIP_ALLOWED_MM,
            f"torn fraction below {TORN_FRACTION_NEEDED}": self._torn_too_little,
        }
        return tuple(name for name, failed in checks.items() if failed)

    @property
    def _torn_too_little(self) -> bool:
        return self.until_task == len(TASK_NAMES) and self.torn_fraction < TORN_FRACTION_NEEDED

    @property
    def success(self) -> bool:
        """Whether the tasks asked for, by default all, were done as DESIGN.md asks."""
        return not self.failures

    def as_dict(self) -> dict[str, object]:
        """Return the `referee` object of `preshape/report/1`, with the fields beyond the contract added."""
        return {**asdict(self), "success": self.success, "failures": list(self.failures)}
