"""What lid and tab truly do; an object that has none keeps them shut."""

from __future__ import annotations

from preshape.sim_backend.simulation import Simulation


class LidTruth:
    """Reads tears and hinge angles of a simulation's box."""

    def __init__(self, simulation: Simulation) -> None:
        """Find the hinges, if the object has them."""
        self._simulation = simulation
        self._qpos = simulation.data.qpos
        model = simulation.model
        self._addresses = (
            None
            if simulation.tearing is None
            else tuple(int(model.jnt_qposadr[model.joint(name).id]) for name in ("tab", "lid"))
        )

    @property
    def shut(self) -> bool:
        """Whether any perforation point holds the lid."""
        tearing = self._simulation.tearing
        return tearing is None or bool(tearing.intact.any())

    @property
    def tab_torn(self) -> bool:
        """Whether the tab's perforation has torn."""
        tearing = self._simulation.tearing
        return tearing is not None and tearing.tab_torn

    @property
    def torn_fraction(self) -> float:
        """Share of the lid's perforation points that have torn."""
        tearing = self._simulation.tearing
        return 0.0 if tearing is None else tearing.torn_fraction

    def angles(self) -> tuple[float, float]:
        """Return how far the tab swings inward and the lid outward, rad."""
        if self._addresses is None:
            return 0.0, 0.0
        tab, lid = self._addresses
        qpos = self._simulation.data.qpos
        return float(qpos[tab]), float(qpos[lid])
