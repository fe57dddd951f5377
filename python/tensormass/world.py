"""The world: a tissue's state with instruments."""
from __future__ import annotations

from typing import Any, Optional, Sequence, Tuple

from ._core import lib
from .bodies import Tie, Ties, Touch
from .instruments import Contact, Cut, Friction, Grasp, Instrument
from .patch import PatchBuilder
from .solve import ComplianceFactor
from .state import WorldState


class World(WorldState):
    """A tissue that moves, with the stages of every scene: force and integrate. Effects that are not added cost nothing. State, step, loads, supports and
    snapshots are inherited from WorldState.

    dt_s: 0 takes the guaranteed critical step times `step_fraction`; a longer step raises StepError. damped: False selects the undamped integrator; the
    materials' damping must then be 0. threads: threads of a step, fewer for small tissue; results are bit-identical for any number.

    u_m and similar arrays are views of buffers that the integrator swaps: get them again after each step. They may be written between steps. Use a world
    from one thread at a time; the GIL is released during a step.
    """

    def add_contact(self, instruments: Sequence[Instrument], **options: Any) -> Contact:
        """Adds instruments that can touch the tissue; see Contact."""
        return Contact(self, instruments, **options)

    def add_grasp(self, contact: Contact, **options: Any) -> Grasp:
        """Adds grasping: graspers hold the tissue between their jaws; see Grasp."""
        return Grasp(self, contact, **options)

    def add_friction(self, contact: Contact, coefficients: Sequence[Tuple[float, float]]) -> Friction:
        """Adds friction with (static, kinetic) coefficients of each instrument; see Friction."""
        return Friction(self, contact, coefficients)

    def add_cut(self, contact: Contact, **options: Any) -> Cut:
        """Adds cutting: cauteries remove the tetrahedra that they touch; see Cut."""
        return Cut(self, contact, **options)

    def add_patch(self, contact: Contact, source: Optional[ComplianceFactor] = None, **options: Any) -> PatchBuilder:
        """Adds patches: the surface near a tool with its compliance; see PatchBuilder."""
        return PatchBuilder(self, contact, source, **options)

    def add_touch(self, bodies: Any = None, pairs: Optional[Sequence[Tuple[int, int]]] = None, friction: Tuple[float, float] = (0.0, 0.0), **options: Any) -> Touch:
        """Adds contact of tissue with tissue: bodies touch each other and themselves; see Touch."""
        return Touch(self, bodies, pairs, friction, **options)

    def add_ties(self, ties: Sequence[Tie], **options: Any) -> Ties:
        """Adds ligaments and fat between bodies; see Ties."""
        return Ties(self, ties, **options)

    @property
    def touch(self) -> Optional[Touch]:
        """The stage "touch", such as a scene's; None: there is none."""
        handle = lib.tm_world_touching(self)
        return Touch._of(self, handle) if handle else None

    @property
    def ties(self) -> Optional[Ties]:
        """The stage "ties", such as a scene's; None: there is none."""
        handle = lib.tm_world_ties(self)
        return Ties._of(self, handle) if handle else None
