"""`cape replay`: a clip with a cape, to a recording, a kept take or an export."""

import json as json_format
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cape.air.record import read_wind
from cape.air.wind import Wind
from cape.assembly.self_contact import contact_thickness
from cape.cli.character import Character
from cape.cli.exports.writing import begun, require_writable
from cape.cli.figures.checking import check_rows, checked, step_error_facts, step_error_rows
from cape.cli.figures.fitting import fit_facts, fit_rows
from cape.cli.figures.looping import loop_facts, loop_rows
from cape.cli.figures.retargeting import retarget_facts, retarget_rows
from cape.cli.figures.rows import print_rows
from cape.cli.figures.tearing import tearing_facts, tearing_rows
from cape.cli.output import open_viewer, output_path
from cape.cli.reading import Reading, named_pairs
from cape.cli.running import ended_before_interrupts, simulated
from cape.cli.scenes.file import SceneFile
from cape.cli.scenes.meshes import MeshOptions, mesh_scene
from cape.cli.scenes.tables import NONE, Tables
from cape.cli.staging import Staged, staged
from cape.cli.words import gathered
from cape.cloth.drawn.textures import read_textures
from cape.cloth.fabric import Fabric
from cape.garments import registry
from cape.measure.self_crossings import share_crossed
from cape.record import LAYERS
from cape.record.layers import check_layers
from cape.results.fit import fit_of
from cape.results.take import Take
from cape.run.auto import Auto
from cape.scene.dress import dress
from cape.scene.jumps import Cuts
from cape.scene.scene import Scene
from cape.scene.tearing import Tearing
from cape.scenes.registry import NamedScene
from cape.solvers import Solver, solver
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError

CUTS = {"carry": Cuts(then="carry"), "reset": Cuts(then="reset"), "off": None}
TABS = ("cape", "hitboxes")

LOOKED_AT = 24  # frames in which it is looked whether layers pass through each other


@dataclass(frozen=True)
class Cut:
    """The cape and how to simulate it, as asked on the command line, and in the tables of a scene file."""

    garment: str = registry.DEFAULT
    fabric: str = "cape"
    spacing: float | None = None
    length: float | None = None
    solver: str | None = None
    substeps: int | None = None
    tolerance: float | None = None
    budget: float | None = None
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gusts: float = 0.0
    turbulence: float = 0.0
    seed: int = 0
    wind_file: Path | None = None
    shelter: bool = False
    cuts: str = "carry"
    self_contact: bool | None = None
    strain_limit: bool | None = None
    hold: tuple[str, ...] = ()
    tear: float | None = None
    tear_force: float | None = None
    loop: bool = False
    tables: Tables = NONE
    garments: tuple[str, ...] = ()
    fabrics: tuple[str, ...] = ()
    mesh: MeshOptions = field(default_factory=MeshOptions)

    @property
    def worn(self) -> tuple[str, ...]:
        """What is worn, the outermost first."""
        return self.garments or (self.garment,)

    def scene(self, who: Character) -> Scene:
        """The cape on a character.

        Raises:
            UserError: a value is out of range, or the body lacks what wears a cape.
        """
        self.tables.require_bones(who.track)
        if self.mesh.cloth is not None:
            return self.tables.added_to(mesh_scene(self, self.mesh.cloth, who), who.track)
        scene = dress(
            who.body,
            who.track,
            garment=self.worn[0],
            garments=self.worn if len(self.worn) > 1 else None,
            length=self.length,
            spacing=self.spacing,
            fabric={garment: self.tables.fabric(name) for garment, name in self.fabric_names().items()},
            colliders=(*who.hitboxes.solids, *self.tables.colliders),
            wind=self.air(),
            self_contact=self.self_contact,
            strain_limit=self.strain_limit,
            hold=self.held(),
            tearing=self.tearing(),
        )
        if self.mesh.texture is not None:
            scene = replace(scene, cloth=replace(scene.cloth, textures=read_textures(self.mesh.texture)))
        return self.tables.added_to(scene, who.track)

    def cloth_fabric(self) -> Fabric:
        """What is made of which no other fabric is told.

        Raises:
            UnknownNameError: there is no such fabric.
        """
        return self.tables.fabric(self.fabric)

    def fabric_names(self) -> dict[str, str]:
        """Names of the fabrics of what is worn, by garment.

        Raises:
            UserError: one is told of what is not worn, or two of all.
        """
        own = named_pairs(self.fabrics, "--fabric", "one fabric for all, and GARMENT=FABRIC")
        for garment in own:
            if garment not in self.worn:
                raise UserError(f"--fabric tells of the {garment}, but worn is: {', '.join(self.worn)}")
        return {garment: own.get(garment, self.fabric) for garment in self.worn}

    def check(self) -> None:
        """Look at all names and numbers that can be told wrong before a motion is read.

        Raises:
            UserError: one of them is; its text says which there are.
        """
        self.cloth_fabric()
        for name in self.worn:
            registry.garment(name)
        for name in self.fabric_names().values():
            self.tables.fabric(name)
        self.air()
        self.held()
        self.tearing()
        self.mesh.check()
        if self.mesh.cloth is not None and len(self.worn) > 1:
            raise UserError("--cloth is worn alone: leave out --garment")
        if self.mesh.cloth is not None and self.fabrics:
            raise UserError("--cloth is of one fabric: leave out the garment of --fabric")
        self.method()
        self.way_at_cuts()

    def air(self) -> Wind:
        """The wind.

        Raises:
            UserError: its file can't be read, or a number is out of range.
        """
        return Wind(
            velocity=self.wind,
            gusts=self.gusts,
            turbulence=self.turbulence,
            seed=self.seed,
            record=None if self.wind_file is None else read_wind(self.wind_file),
            shelter=self.shelter,
        )

    def held(self) -> dict[str, str]:
        """The bones that hold parts of the garment, by what they hold.

        Raises:
            UserError: one of them is not named so.
        """
        return named_pairs(self.hold, "--hold", "EDGE=BONE")

    def tearing(self) -> Tearing | None:
        """When the cape parts, None for never.

        Raises:
            ValueRangeError: a value is out of range.
        """
        if self.tear is None and self.tear_force is None:
            return None
        return Tearing(strain=self.tear, force=self.tear_force)

    def way_at_cuts(self) -> Cuts | None:
        """What happens where the bones jump, None for nothing.

        Raises:
            UnknownNameError: there is no such way.
        """
        if self.cuts not in CUTS:
            raise UnknownNameError("way to treat a cut", self.cuts, CUTS)
        return CUTS[self.cuts]

    def method(self) -> Solver | Auto:
        """The solver, or what is asked of it, from millimetres and milliseconds.

        Raises:
            UnknownNameError: there is no such solver.
            ValueRangeError: a value is out of range, or a solver or its substeps are given besides what chooses them.
        """
        if self.tolerance is None and self.budget is None and self.solver != Auto.name:
            return solver(self.solver or "euler", substeps=self.substeps)
        if self.solver not in (None, Auto.name) or self.substeps is not None:
            raise ValueRangeError("a tolerance or a budget chooses the solver and its steps: leave those out")
        return Auto(
            tolerance=None if self.tolerance is None else 1e-3 * self.tolerance,
            budget=None if self.budget is None else 1e-3 * self.budget,
        )


def run(
    reading: Reading,
    cut: Cut,
    *,
    scene: SceneFile | NamedScene | None,
    output: Path | None,
    hitboxes: str | None,
    layers: list[str] | None,
    check: bool,
    crossings: bool,
    tab: str,
    spawn: bool,
    json: bool,
) -> int:
    """Simulate, record, report; gives the exit status."""
    require_writable(output or Path("x.rrd"), recorded_only={"--layers": layers is not None, "--spawn": spawn})
    who, path = prepared(reading, cut, scene=scene, output=output, hitboxes=hitboxes, layers=layers, tab=tab)
    with ended_before_interrupts() as begin_to_end, begun(path, who, loop=cut.loop, layers=layers, tab=tab) as end:
        take = simulated(
            who.scene, who, solver=cut.method(), cuts=cut.way_at_cuts(), check_steps=check, loop=cut.loop,
            on_frame=end.on_frame, modules=end.modules,
        )  # fmt: skip
        begin_to_end()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            end.finish(take)
    notes = [*take.warnings, *(str(w.message) for w in caught if w.category is UserWarning)]
    facts = _facts(take, who.scene, len({who.track.index(bone) for bone in who.scene.bones}), notes, path)
    if len(cut.worn) > 1:
        facts["garments"] = list(cut.worn)
    if cut.fabrics:
        facts["fabrics"] = cut.fabric_names()
    if who.retargeted is not None:
        facts["retarget"] = retarget_facts(who.retargeted)
    if check:
        facts["check"] = checked(take)
    if crossings:
        facts["layers_crossed"] = round(share_crossed(take.positions, take.triangles_at, most=LOOKED_AT), 3)
    if json:
        print(json_format.dumps(facts))
    else:
        _print_table(take, facts, end.kind)
    if spawn:
        open_viewer(path)
    if (full := end.full()) is not None:
        raise FileError(f"can't write all of {path}: {full}")
    return 130 if take.result.startswith("stopped") else 0


def checked_cut(cut: Cut, *, scene: SceneFile | NamedScene | None, layers: list[str] | None, tab: str) -> Cut:
    """Check what is asked for besides the motion; gives the cut with what a scene file adds to it.

    Raises:
        UserError: something is out of range, or a name is not known.
    """
    if isinstance(scene, SceneFile):
        cut = replace(cut, tables=scene.tables)
    cut.check()
    check_layers(layers, LAYERS)
    if tab not in TABS:
        raise UnknownNameError("tab", tab, TABS)
    return cut


def prepared(
    reading: Reading,
    cut: Cut,
    *,
    scene: SceneFile | NamedScene | None,
    output: Path | None,
    hitboxes: str | None,
    layers: list[str] | None,
    tab: str,
) -> tuple[Staged, Path]:
    """Look at all that was asked for, and build it: what is simulated, and where it is written.

    Raises:
        UserError: something can't be read, is out of range, or does not go with the rest.
    """
    file = scene if isinstance(scene, SceneFile) else None
    named = scene if isinstance(scene, NamedScene) else None
    cut = checked_cut(cut, scene=scene, layers=layers, tab=tab)
    inputs = (*reading.files, *cut.mesh.files, hitboxes, None if file is None else file.path)
    if output is not None:
        output_path(output, "", inputs=inputs)
    own_cloth = named is not None and named.make is not None
    who = staged(reading if own_cloth else reading.or_walk(), cut, scene=named, hitboxes=hitboxes)
    name = who.name if scene is None else scene.name
    return who, output_path(output, name, inputs=inputs)


def _facts(take: Take, scene: Scene, bones: int, notes: list[str], path: Path) -> dict[str, Any]:
    frames = len(take.positions)
    fps = take.bones.fps if frames > 1 else 0.0
    seconds = (frames - 1) / fps if frames > 1 else 0.0
    return {
        "frames": frames,
        "fps": round(fps, 3),
        "vertices": take.positions.shape[1],
        "bones": bones,
        "capsules": len(take.capsules),
        "hitboxes": sum(collider.bone is not None for collider in take.colliders),
        "solver": take.solver,
        "substeps": take.substeps,
        "step_error": step_error_facts(take),
        "compile_s": round(take.compile_s, 3),
        "settle_s": round(take.settle_s, 3),
        "solve_s": round(take.solve_s, 3),
        "realtime_factor": round(seconds / take.solve_s, 2) if take.solve_s > 0.0 else None,
        "stretch_max": round(float(take.stretch_max.max()), 5),
        "stretch_p99": round(take.stretch_p99, 5),
        **fit_facts(fit_of(take, scene.cloth, scene.wearer)),
        "penetration_max_mm": round(float(take.penetration.max()) * 1000.0, 3),
        "self_contact_mm": None if scene.self_contact is None else round(1000.0 * contact_thickness(scene), 3),
        "left_out": dict(take.left_out),
        **tearing_facts(take),
        **loop_facts(take.loop),
        "jumps": list(take.jumps),
        "put_on_anew": list(take.renewed),
        "result": take.result,
        "warnings": notes,
        "output": str(path),
    }


def _print_table(take: Take, facts: dict[str, Any], kind: str) -> None:
    frame = int(take.stretch_max.argmax())
    deepest = int(take.penetration.argmax())
    where = take.colliders[take.penetrated[deepest]].name if take.penetrated[deepest] >= 0 else ""
    penetration = f"{facts['penetration_max_mm']:.1f} mm" + (f" in {where} at frame {deepest}" if where else "")
    stretch = f"{take.stretch_max[frame]:.1%} at frame {frame}, 99 % of edges below {take.stretch_p99:.1%}"
    factor = facts["realtime_factor"]
    rows = [
        ("motion", f"{facts['frames']} frames at {facts['fps']:g} fps"),
        ("bones, hitboxes", f"{facts['bones']}, {facts['hitboxes']}"),
        *retarget_rows(facts.get("retarget", {})),
        *(("left out", f"{name}: {reason}") for name, reason in take.left_out.items()),
        ("cape", f"{facts['vertices']} vertices"),
        ("solver", f"{facts['solver']}, {facts['substeps']} substeps a frame"),
        *step_error_rows(facts["step_error"]),
        *_self_contact_rows(facts),
        ("compile time", f"{facts['compile_s']:.2f} s, and {facts['settle_s']:.2f} s to put the cape on"),
        ("run time", f"{facts['solve_s']:.2f} s" + (f", {factor:g} times real time" if factor else "")),
        ("largest stretch", stretch),
        *fit_rows(facts),
        ("deepest penetration", penetration),
        *tearing_rows(facts),
        *loop_rows(facts),
        *check_rows(facts.get("check", {})),
        ("result", facts["result"]),
        *(("", note) for note in gathered(facts["warnings"])),
        (kind, facts["output"]),
    ]
    print_rows(rows)


def _self_contact_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    thickness, crossed = facts["self_contact_mm"], facts.get("layers_crossed")
    rows = [] if thickness is None else [("self-contact", f"layers of the cape stay {thickness:.1f} mm apart")]
    return rows if crossed is None else [*rows, ("layers pass through each other", f"in {crossed:.0%} of the frames")]
