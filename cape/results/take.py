"""What a simulation leaves behind."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth
from cape.measure.contact_points import ContactPoints
from cape.results.loop import Loop
from cape.results.topology import Topology, since
from cape.scene.colliders import Collider
from cape.scene.scene import Scene
from motions.border import checked
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StepError:
    """The error that a run has gathered over one part of its motion, for want of shorter steps.

    Attributes:
        time: since the start, at the part's end [s].
        rms: distance, at the part's end, from where the same solver would have ended it in ever shorter steps, with the
            same contact model, from the run's own state at the part's start: root mean square over the vertices [m];
            infinite where shorter steps broke off.
        solver: name of the run's solver.
        substeps: in its last frame.
        seconds: length of the part [s].
        order: power of the step by which errors were seen to shrink, in the shortest steps that were tried.
    """

    time: float
    rms: float
    solver: str
    substeps: int
    seconds: float = math.nan
    order: float = math.nan


@checked
@dataclass(frozen=True, eq=False)
class Take:
    """A simulated cloth on its bones over F frames, and how the run went.

    Attributes:
        name: what it is called, by default the clip's name.
        bones: the bones' poses at the F frames, and the mesh that they move, if any; every bone that the colliders name
            is among them.
        colliders: what the cloth couldn't enter.
        triangles: vertex indices of the T triangles, shape (T, 3); of a cloth that tears, as they are at first.
        texcoords: texture coordinates of the V vertices, 0 to 1 over the cloth, shape (V, 2).
        positions: of the V vertices in the world [m], single precision, shape (F, V, 3). Where the cloth tears these
            are all that there are in the end; until one splits off, it is where it will split off from.
        stretch_max: largest strain of a structural edge in each frame (0.01 is 1 %), shape (F,).
        stretch_p99: its 99th percentile over all edges and frames.
        penetration: deepest penetration of a vertex into a collider in each frame [m], 0 where none is, shape (F,).
        penetrated: index of the collider of that penetration, -1 for none, shape (F,).
        kinetic_energy: of the cloth at each frame [J], shape (F,).
        solver: name of the solver.
        substeps: steps in each frame.
        compile_s: time spent on compiling before the first step [s].
        settle_s: time spent on putting the cloth on and letting it settle before the first frame [s].
        solve_s: time spent on the steps of the F frames [s].
        thickness: of the colliders that have none of their own [m].
        held: indices of the vertices that bones hold.
        left_out: why colliders were left out of the run, by name.
        contacts: of the vertices that no bone holds with all colliders, at the end of each frame; None if not noted.
        jumps: frames at which the bones had jumped and the cloth was carried along or put on anew.
        renewed: those of the jumps at which it was put on anew.
        step_errors: what the time step has cost in accuracy, where that was measured, part by part of the motion.
        cloth: what was simulated, whose fabric tells how it is drawn; None where that is not known.
        topologies: which vertices the triangles have from some frames on, the first of them 0; none where the cloth
            stays as it is.
        tears: how many edges have parted.
        mass: of the cloth in the first and in the last frame [kg]; not a number where it is not known.
        loop: how well its last frame leads into its first, None where it was not made to.
        result: "finished", "finished with warnings", "diverged at frame N", or "stopped at frame N" by the user.
        warnings: what to look at, a sentence each.
    """

    name: str
    bones: BoneTrack
    colliders: Sequence[Collider]
    triangles: NDArray[np.int32]
    texcoords: NDArray[np.float32]
    positions: NDArray[np.float32]
    stretch_max: FloatArray
    stretch_p99: float
    penetration: FloatArray
    penetrated: NDArray[np.int64]
    kinetic_energy: FloatArray
    solver: str
    substeps: int
    compile_s: float
    settle_s: float
    solve_s: float
    thickness: float = Scene.thickness
    held: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    left_out: Mapping[str, str] = field(default_factory=dict)
    contacts: ContactPoints | None = None
    jumps: tuple[int, ...] = ()
    renewed: tuple[int, ...] = ()
    step_errors: tuple[StepError, ...] = ()
    cloth: Cloth | None = None
    topologies: tuple[Topology, ...] = ()
    tears: int = 0
    mass: tuple[float, float] = (math.nan, math.nan)
    loop: Loop | None = None
    result: str = "finished"
    warnings: tuple[str, ...] = field(default=())

    @property
    def step_error(self) -> float:
        """What the time step costs this run, as one number [m]: the root mean square of `step_errors`.

        So far are its vertices, a part of the motion after any of its states, from where the same solver would have
        taken them in infinitely short steps. Not a number where it was not measured.
        """
        squares = [error.rms**2 for error in self.step_errors]
        return math.sqrt(sum(squares) / len(squares)) if squares else math.nan

    def triangles_at(self, frame: int) -> NDArray[np.int32]:
        """Vertex indices of the T triangles in a frame, shape (T, 3)."""
        known = [topology.triangles for topology in self.topologies if topology.frame <= frame]
        return known[-1] if known else self.triangles

    def part(self, first: int, end: int) -> "Take":
        """The frames from one on, which is frame 0 of the part, up to another that is no more part of it.

        What is told of the run as a whole, such as its times, its tears and its warnings, is still that of all of it.

        Raises:
            ValueRangeError: no frame would be left, or the first is negative.
        """
        bones, kept = self.bones.part(first, end), slice(first, end)
        topologies = since([topology for topology in self.topologies if topology.frame < end], first)
        return replace(
            self,
            bones=bones,
            triangles=topologies[0].triangles if topologies else self.triangles,
            positions=self.positions[kept],
            stretch_max=self.stretch_max[kept],
            penetration=self.penetration[kept],
            penetrated=self.penetrated[kept],
            kinetic_energy=self.kinetic_energy[kept],
            contacts=None if self.contacts is None else self.contacts.select(np.arange(first, first + bones.frames)),
            jumps=tuple(frame - first for frame in self.jumps if first <= frame < end),
            renewed=tuple(frame - first for frame in self.renewed if first <= frame < end),
            topologies=topologies,
        )

    @property
    def thicknesses(self) -> FloatArray:
        """Distance at which each collider stops the cloth [m], shape (C,)."""
        return np.array([self.thickness if c.thickness is None else c.thickness for c in self.colliders], dtype=float)

    @property
    def capsules(self) -> tuple[Capsule, ...]:
        """Those of the colliders that are capsules."""
        return tuple(c for c in self.colliders if isinstance(c, Capsule))

    def save(
        self,
        path: str | PathLike[str],
        *,
        layers: Iterable[str] | None = None,
        surfaces: Sequence[LinkSurface] = (),
        skin: Skin | None = None,
    ) -> None:
        """Write a recording for the Rerun viewer; `cape.record` documents what is in it.

        Args:
            path: the recording, by custom with the suffix .rrd; one that is there is replaced when the new one is
                complete.
            layers: which of `cape.record.LAYERS` to write, such as "cape" or "hitboxes", None for all.
            surfaces: meshes that the bones carry, such as a robot's `skeleton.link_surfaces(body, "visual")`.
            skin: mesh that the bones move, drawn in place of a body by proportions; None for the bones' own, if any.

        Raises:
            MissingPackageError: rerun-sdk isn't installed.
            UnknownNameError: a layer doesn't exist.
            ValueRangeError: no frame is finite.
            FileError: the file can't be written.
        """
        from cape import record

        record.save(self, path, layers=layers, surfaces=surfaces, skin=skin)

    def show(
        self,
        *,
        width: int = 900,
        height: int = 600,
        layers: Iterable[str] | None = None,
        surfaces: Sequence[LinkSurface] = (),
        skin: Skin | None = None,
    ) -> None:
        """Show it in the Rerun viewer, in the output of a Jupyter notebook's cell.

        Args:
            width: of the viewer [pixels].
            height: the same.
            layers: which of `cape.record.LAYERS`, None for all.
            surfaces: meshes that the bones carry.
            skin: mesh that the bones move; None for the bones' own, if any.

        Raises:
            UserError: what shows it is not installed, or this is no notebook.
            UnknownNameError: a layer doesn't exist.
            ValueRangeError: no frame is finite.
        """
        from cape.notebooks.show import show

        show(self, width=width, height=height, layers=layers, surfaces=surfaces, skin=skin)

    def keep(self, path: str | PathLike[str]) -> None:
        """Write all that the take holds, to be read by `Take.load`; documented in `cape.results.take_file`.

        Args:
            path: the file, by custom with the suffix .npz; one that is there is replaced when the new one is complete.

        Raises:
            ValueRangeError: the take is larger than what can be read again, 1 GB.
            FileError: the file can't be written.
        """
        from cape.results import take_file

        take_file.keep(self, path)

    @staticmethod
    def load(path: str | PathLike[str]) -> "Take":
        """Read a take that was kept.

        Raises:
            FileError: the file is missing or damaged, or holds no take.
        """
        from cape.results import take_file

        return take_file.load(path)

    def export(self, path: str | PathLike[str], *, joints: int | None = None) -> tuple[Path, ...]:
        """Write the cloth in motion for other programs, in the format of the path's suffix; gives all files made.

        USD and GLB hold the character's mesh as well, where the bones move one.

        Args:
            path: the file, with one of the suffixes in `cape.exports.FORMATS`, such as .usd, .glb or .obj; files that
                are there are replaced.
            joints: of a GLB, bake the motion to so many joints in chains with skin weights, which game engines play; a
                warning tells how far they are off. None keeps every vertex where it was.

        Raises:
            UnknownNameError: there is no such format; lists them.
            UserError: what writes it is not installed; its text says how to get it.
            ValueRangeError: the first frame isn't finite, or the format can't hold so many.
            FileError: a file can't be written.
        """
        from cape import exports

        return exports.export(self, path, joints=joints)
