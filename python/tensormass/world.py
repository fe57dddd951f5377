"""A tissue that moves: its state, and what instruments add to it."""
from __future__ import annotations

from typing import Any, Optional, Sequence, Tuple

from .instruments import Contact, Cut, Friction, Grasp, Instrument
from .patch import PatchBuilder
from .solve import ComplianceFactor
from .state import WorldState


class World(WorldState):
    """A tissue that moves, with the stages every scene has: force and integrate. What is not added costs nothing. State, step, loads, supports and
    snapshots are of WorldState, which it is.

    dt_s: 0, the guaranteed critical step times `step_fraction`; above the guaranteed step: StepError. damped: False, the undamped integrator
    (materials' damping must then be 0). threads: a step is divided among so many, fewer where the tissue is small; the same bits for any number.

    u_m and its like are views of memory that the integrator turns over: take them anew after a step. They may be written between steps.
    One world from one thread at a time; the GIL is free while it steps.
    """

    def add_contact(self, instruments: Sequence[Instrument], **options: Any) -> Contact:
        """Instruments that touch; see Contact."""
        return Contact(self, instruments, **options)

    def add_grasp(self, contact: Contact, **options: Any) -> Grasp:
        """Graspers hold what their jaws close upon; see Grasp."""
        return Grasp(self, contact, **options)

    def add_friction(self, contact: Contact, coefficients: Sequence[Tuple[float, float]]) -> Friction:
        """Instruments rub on the tissue, (static, kinetic) of each; see Friction."""
        return Friction(self, contact, coefficients)

    def add_cut(self, contact: Contact, **options: Any) -> Cut:
        """Cauteries remove what they touch; see Cut."""
        return Cut(self, contact, **options)

    def add_patch(self, contact: Contact, source: Optional[ComplianceFactor] = None, **options: Any) -> PatchBuilder:
        """The surface near a tool with its compliance; see PatchBuilder."""
        return PatchBuilder(self, contact, source, **options)
