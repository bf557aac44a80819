"""Everything that a simulation needs to know and that does not change while it runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cape.air.wind import Wind
from cape.cloth.cloth import Cloth, MeshCloth
from cape.scene.colliders import Collider, Enclosing
from cape.scene.holding.attachments import Attachment
from cape.scene.holding.confinement import Confinement
from cape.scene.holding.tethers import Tethers
from cape.scene.self_contact import SelfContact
from cape.scene.tearing import Tearing
from motions.border import checked_first
from motions.errors import ValueRangeError
from motions.limits import LARGEST_NUMBER, MOST_COLLIDERS
from skeleton.shapes import require_known

FloatArray = NDArray[np.float64]

# Bones, or their roles, that place the wearer's frame.
WEARER_ROLES = ("left_upper_arm", "right_upper_arm", "pelvis")
GRAVITY = (0.0, 0.0, -9.81)  # m/s2


@checked_first
@dataclass(frozen=True, eq=False)
class Scene:
    """A cloth, what holds it, what it can't enter and what acts on it.

    Attributes:
        cloth: the cloth.
        attachments: vertices that bones carry; none for a free cloth.
        colliders: shapes on bones or in the world; none for no contact.
        gravity: [m/s2].
        wind: the air, None for vacuum.
        friction: Coulomb coefficient of colliders that have none of their own.
        thickness: distance at which colliders stop the cloth [m]: half of the cloth's own thickness, and room for
            what lies between the vertices.
        self_contact: how the cloth touches itself; None to let it pass through itself.
        tethers: how far the cloth may get from what is held hard; None for as far as its springs let it.
        confinements: how far vertices may get from where bones would carry them, or behind that; none for anywhere.
        wearer: the bones, or their roles, at which the left and the right arm begin, and the pelvis: where a cape is.
        dressing: origin [m] and unit quaternion bone_to_wearer wxyz of each of `bones` in the wearer's frame, where the
            cloth is put on, before they go to where the motion begins; None to put it on there.
        strain_limit: whether threads stop stretching at the limits of their fabric (`Fabric.limit_warp`, `limit_weft`),
            or follow their stiffness alone; those of a grid, or of a mesh that tells which of its edges they are.
        tearing: when the cloth parts; None for never.
        left_out: why solids of the wearer are not among the colliders, by name: to be told.
    """

    cloth: Cloth
    attachments: Sequence[Attachment] = ()
    colliders: Sequence[Collider] = ()
    gravity: tuple[float, float, float] = GRAVITY
    wind: Wind | None = None
    friction: float = 0.3
    thickness: float = 0.005
    self_contact: SelfContact | None = None
    tethers: Tethers | None = None
    confinements: Sequence[Confinement] = ()
    wearer: tuple[str, str, str] = WEARER_ROLES
    dressing: Mapping[str, tuple[FloatArray, FloatArray]] | None = None
    strain_limit: bool = False
    tearing: Tearing | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what can be checked without bones.

        Raises:
            UnknownNameError: a collider is of no shape in `skeleton.shapes.SHAPES`.
            ValueRangeError: an attachment is of another cloth, a vertex is attached or confined twice, two colliders
                share a name or there are too many, a value is out of range, strain is to be limited in a mesh of
                unknown threads, something goes by what is held and nothing is, or pieces of several fabrics are sewn
                together.
        """
        if isinstance(self.cloth, MeshCloth) and self.cloth.patchwork is not None:
            self.cloth.patchwork.require(self.cloth.faces, self.cloth.fabric)
        for attachment in self.attachments:
            _require_of(self.cloth, attachment)
        require_held_once([a.vertices for a in self.attachments if a.within is None])
        require_held_once([c.animated.vertices for c in self.confinements], "confined")
        require_known(self.colliders)
        if len(self.colliders) > MOST_COLLIDERS:
            raise ValueRangeError(f"a scene has at most {MOST_COLLIDERS} colliders, not {len(self.colliders)}")
        doubled = sorted(name for name, times in Counter(c.name for c in self.colliders).items() if times > 1)
        if doubled:
            raise ValueRangeError(f"two colliders are named {doubled[0]!r}")
        if len(self.gravity) != 3 or not (np.abs(self.gravity) <= LARGEST_NUMBER).all():
            raise ValueRangeError(f"gravity must be three finite numbers, not {self.gravity}")
        if self.tethers is not None and not any(attachment.hard for attachment in self.attachments):
            raise ValueRangeError("tethers need vertices that are held hard")
        if not len(self.attachments) and any(confinement.needs_holds for confinement in self.confinements):
            raise ValueRangeError("a bound by the distance from what is held needs an attachment")
        if self.strain_limit and not self.cloth.has_threads:
            raise ValueRangeError("only threads have a strain limit: this cloth is a mesh that does not tell its own")
        for name in ("friction", "thickness"):
            if not 0.0 <= getattr(self, name) <= LARGEST_NUMBER:
                raise ValueRangeError(f"{name} must be zero or more and finite, not {getattr(self, name)}")

    @cached_property
    def bones(self) -> tuple[str, ...]:
        """Names of the bones, or roles, that the scene uses, each once."""
        used = [bone for a in self.attachments for bone in a.bones]
        used += [bone for c in self.confinements for bone in c.animated.bones]
        used += [c.bone for c in self.colliders if c.bone is not None]
        if self.cloth.frame == "wearer":
            used += self.wearer
        return tuple(dict.fromkeys(used))

    @cached_property
    def enclosing(self) -> Enclosing:
        """Balls around the colliders."""
        return Enclosing.of(self.colliders, self.bones)


def _require_of(cloth: Cloth, attachment: Attachment) -> None:
    count, beyond = cloth.vertices, (attachment.vertices < 0) | (attachment.vertices >= cloth.vertices)
    if attachment.cloth_vertices not in (None, count) or beyond.any():
        own = attachment.cloth_vertices or int(attachment.vertices.max()) + 1
        raise ValueRangeError(
            f"what {attachment.bone!r} holds belongs to another cloth, of {own} vertices: this one has {count}"
        )


def require_held_once(held: Sequence[NDArray[np.int64]], how: str = "attached") -> None:
    """Check that no vertex is in two of the attachments' vertices, or of what else they are said to be.

    Raises:
        ValueRangeError: one is.
    """
    values, counts = np.unique(np.concatenate([*held, np.empty(0, dtype=np.int64)]), return_counts=True)
    if (counts > 1).any():
        raise ValueRangeError(f"vertex {values[counts > 1][0]} is {how} more than once")
