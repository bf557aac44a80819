"""Commands and their options; what they do stands in a module each."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Hang a simulated cape on a moving character and record it for the Rerun viewer.",
)

CLIP_HELP = "A BVH file, the name of a shipped clip (cape clips lists them), or a robot's motion (CSV, NPZ)."
Clip = Annotated[str, typer.Argument(help=CLIP_HELP)]
Script = Annotated[
    str | None,
    typer.Option(
        metavar="STEPS",
        help='Clips to join, in place of CLIP; without a time one plays once: "idle 2s, walk 3s, kick".',
    ),
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="The recording; by default CLIP.rrd, here.")]
Unit = Annotated[str | None, typer.Option(help="Unit of the file: m, cm, mm, inch, cmu, or metres per unit.")]
Up = Annotated[str | None, typer.Option(help="Axis of the file that points up: x, y, z, -x, -y or -z.")]
Height = Annotated[float | None, typer.Option(help="Scale the body to this standing height [m].")]
Attach = Annotated[
    list[str] | None,
    typer.Option("--attach", metavar="ROLE=BONE", help="Name the bone that plays a role by hand; may be repeated."),
]
Robot = Annotated[
    str | None,
    typer.Option("--skeleton", metavar="ROBOT", help="A robot that makes the motion: a URDF file, or a name like g1."),
]
Rate = Annotated[float | None, typer.Option(help="Frames per second of a robot's motion that tells none; 60 if unset.")]
Packages = Annotated[
    list[Path] | None, typer.Option(help="A folder with packages that a URDF file names; may be repeated.")
]
Hitboxes = Annotated[
    str | None,
    typer.Option(
        "--hitboxes",
        metavar="WHICH",
        help="Of a robot: limbs (the default) or all, fitted to its meshes. Of anyone: body, by human proportions, "
        "or a TOML file.",
    ),
]
Layers = Annotated[str | None, typer.Option(help="Layers to record, separated by commas; by default all.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Spawn = Annotated[bool, typer.Option("--spawn", help="Open the recording in the Rerun viewer.")]
Start = Annotated[float | None, typer.Option(help="Begin at this time of the clip [s].")]
End = Annotated[float | None, typer.Option(help="End at this time of the clip [s].")]
Fps = Annotated[float | None, typer.Option(help="Frames per second; by default the clip's own, 60 at most.")]


@app.command()
def replay(
    clip: Annotated[str | None, typer.Argument(help=CLIP_HELP, show_default="walk")] = None,
    script: Script = None,
    output: Output = None,
    robot: Robot = None,
    garment: Annotated[str, typer.Option(help="What is worn (cape garments lists them).")] = "back_cape",
    fabric: Annotated[str, typer.Option(help="Name of a fabric (cape fabrics lists them).")] = "cape",
    spacing: Annotated[
        float | None, typer.Option(help="Mean distance of the cloth's vertices [m]; by default for 1,500 of them.")
    ] = None,
    length: Annotated[float | None, typer.Option(help="Length of the cape [m]; by default to the shins.")] = None,
    solver: Annotated[
        str | None, typer.Option(help="euler (the default), xpbd, backward_euler, tr_bdf2, or auto to have one chosen.")
    ] = None,
    substeps: Annotated[int | None, typer.Option(help="Steps per frame; by default as many as needed.")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Error that the time step may cause [mm]; chooses solver and steps.")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(help="Wall time that a frame may take [ms]; chooses the most accurate that fits.")
    ] = None,
    fps: Fps = None,
    wind: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y Z", help="Velocity of the air [m/s], Z up.")
    ] = (0.0, 0.0, 0.0),
    cuts: Annotated[
        str,
        typer.Option(help="Where the bones jump, carry the cape along or reset it; off takes jumps as motion."),
    ] = "carry",
    self_contact: Annotated[
        bool, typer.Option("--self-contact", help="Keep the cape from passing through itself.")
    ] = False,
    unit: Unit = None,
    up: Up = None,
    height: Height = None,
    start: Start = None,
    end: End = None,
    attach: Attach = None,
    rate: Rate = None,
    packages: Packages = None,
    hitboxes: Hitboxes = None,
    layers: Layers = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Measure the error of the time step, and apart from the solver how deep vertices and faces are.",
        ),
    ] = False,
    spawn: Spawn = False,
    json: Json = False,
) -> int:
    """Simulate a cape on a character that moves as the clip tells, and record it."""
    from cape.cli.commands.replay import Cut, run
    from cape.cli.reading import Reading

    if clip is None and script is None:
        clip = "walk"
    return run(
        Reading(
            clip,
            unit=unit,
            up=up,
            height=height,
            start=start,
            end=end,
            fps=fps,
            attach=tuple(attach or ()),
            script=script,
            skeleton=robot,
            rate=rate,
            packages=tuple(packages or ()),
        ),
        Cut(
            garment=garment,
            fabric=fabric,
            spacing=spacing,
            length=length,
            solver=solver,
            substeps=substeps,
            tolerance=tolerance,
            budget=budget,
            wind=wind,
            cuts=cuts,
            self_contact=self_contact,
        ),
        output=output,
        hitboxes=hitboxes,
        layers=_split(layers),
        check=check,
        spawn=spawn,
        json=json,
    )


@app.command()
def hitboxes(
    clip: Annotated[str | None, typer.Argument(help=CLIP_HELP, show_default=False)] = None,
    script: Script = None,
    output: Output = None,
    fps: Fps = None,
    unit: Unit = None,
    up: Up = None,
    height: Height = None,
    start: Start = None,
    end: End = None,
    attach: Attach = None,
    robot: Robot = None,
    rate: Rate = None,
    packages: Packages = None,
    which: Hitboxes = None,
    write: Annotated[
        Path | None, typer.Option(help="Write the hitboxes to this TOML file, to be edited and used by --hitboxes.")
    ] = None,
    bare: Annotated[
        bool, typer.Option("--bare", help="Skeleton and capsules alone, at once: nothing is simulated.")
    ] = False,
    spawn: Spawn = False,
) -> int:
    """Record what the cape meets: named colliders, the shells of their thickness, and the contacts of each frame."""
    from cape.cli.commands.hitboxes import run
    from cape.cli.reading import Reading

    reading = Reading(
        clip,
        unit=unit,
        up=up,
        height=height,
        start=start,
        end=end,
        fps=fps,
        attach=tuple(attach or ()),
        script=script,
        skeleton=robot,
        rate=rate,
        packages=tuple(packages or ()),
    )
    return run(reading, output=output, hitboxes=which, write=write, bare=bare, spawn=spawn)


@app.command()
def clips() -> int:
    """List the clips that come with the package."""
    from cape.cli.commands.info import list_clips

    return list_clips()


@app.command()
def fabrics(json: Json = False) -> int:
    """List the fabrics that a cape may be of: how each drapes, weight, stiffness (warp / weft), and who measured it."""
    from cape.cli.commands.fabrics import run

    return run(json=json)


@app.command()
def garments(json: Json = False) -> int:
    """List what a character may wear."""
    from cape.cli.commands.garments import run

    return run(json=json)


@app.command()
def info(
    clip: Annotated[
        str | None, typer.Argument(help=CLIP_HELP + " A robot's name or URDF file tells of the robot.")
    ] = None,
    script: Script = None,
    unit: Unit = None,
    up: Up = None,
    height: Height = None,
    attach: Attach = None,
    robot: Robot = None,
    rate: Rate = None,
    packages: Packages = None,
    which: Hitboxes = None,
    json: Json = False,
) -> int:
    """Tell what a motion or a robot holds: joints, roles, unit, what was decided while reading, what to look at."""
    from cape.cli.commands.info import run
    from cape.cli.reading import Reading

    reading = Reading(
        clip,
        unit=unit,
        up=up,
        height=height,
        attach=tuple(attach or ()),
        script=script,
        skeleton=robot,
        rate=rate,
        packages=tuple(packages or ()),
    )
    return run(reading, hitboxes=which, json=json)


@app.command("warm-up")
def warm_up(
    everything: Annotated[
        bool, typer.Option("--all", help="All that any command but bench and report may need, for minutes.")
    ] = False,
    json: Json = False,
) -> int:
    """Compile ahead what cape replay needs on this machine, as its first run would."""
    from cape.cli.commands.warm_up import run

    return run(everything=everything, json=json)


@app.command()
def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Fewer sizes and shorter runs.")] = False,
    json: Json = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for bench.json and the plot, bench.png.")
    ] = None,
) -> int:
    """Measure what the solvers cost on this machine; what a first run compiles takes minutes and counts apart."""
    from cape.cli.commands.bench import bench as measure

    return measure(quick=quick, json=json, output=output)


@app.command()
def report(
    output: Annotated[Path, typer.Option("-o", "--output", help="A folder for all files; made if needed.")] = Path(
        "report"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Two scenes, shorter motions, fewer settings and cases.")
    ] = False,
    scene: Annotated[
        list[str] | None, typer.Option("--scene", help="Only this standard scene; may be repeated.")
    ] = None,
    solver: Annotated[list[str] | None, typer.Option("--solver", help="Only this solver; may be repeated.")] = None,
    only: Annotated[
        str | None, typer.Option("--only", help="One section alone: scenes, stress, spacings, energy or world.")
    ] = None,
) -> int:
    """Measure error against run time of every solver: a page, diagrams, report.json, and recordings side by side."""
    from cape.cli.commands.report import report as measure

    return measure(output=output, quick=quick, scenes=tuple(scene or ()), solvers=tuple(solver or ()), only=only)


def _split(layers: str | None) -> list[str] | None:
    return None if layers is None else [name.strip() for name in layers.split(",") if name.strip()]
