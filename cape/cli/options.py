"""Options that several commands share, and how those of one kind are gathered to what they describe."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cape.cli import marks
from cape.cli.marks import MayBeFile, OneOf

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut
    from cape.cli.reading import Reading

CLIP_HELP = (
    "A BVH file, a character (GLB, glTF, VRM), AMASS's NPZ, the name of a shipped clip (cape clips lists them), or a "
    "robot's motion (CSV, NPZ)."
)
Clip = Annotated[str | None, typer.Argument(help=CLIP_HELP, show_default=False), MayBeFile()]
Script = Annotated[
    str | None,
    typer.Option(
        metavar="STEPS",
        help='Clips to join, in place of CLIP; without a time one plays once: "idle 2s, walk 3s, kick".',
    ),
    MayBeFile(script=True),
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="The recording; by default CLIP.rrd, here.")]
Result = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        help="The recording, by default CLIP.rrd, here; or the take itself (.npz), or an export as of cape export.",
    ),
]
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
    MayBeFile(),
]
Rate = Annotated[
    float | None,
    typer.Option(
        help="Frames per second of the motion, whatever a BVH file says; of a robot's that tells none, 60 by default."
    ),
]
Packages = Annotated[
    list[Path] | None, typer.Option(help="A folder with packages that a URDF file names; may be repeated.")
]
Animation = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Which of a GLB's animations, or a file (GLB, VRMA) whose animation it takes; by default its first.",
    ),
]
Hitboxes = Annotated[
    str | None,
    typer.Option(
        "--hitboxes",
        metavar="WHICH",
        help="Of a robot or a GLB: limbs (the default) or all, fitted to its meshes. Of anyone: body, by human "
        "proportions, or a TOML file.",
    ),
    MayBeFile(),
]
Layers = Annotated[
    str | None,
    typer.Option(help="Layers to record, separated by commas; by default all."),
    OneOf(marks.layers, separator=","),
]
Verbose = Annotated[bool, typer.Option("--verbose", help="Tell all that there is to tell, however long it is.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Crossings = Annotated[
    bool | None,
    typer.Option(
        "--crossings/--no-crossings",
        help="Look at some frames whether layers pass through each other; by default with --check or --json.",
    ),
]
Spawn = Annotated[bool, typer.Option("--spawn", help="Open the recording in the Rerun viewer.")]
Tab = Annotated[
    str,
    typer.Option(help="Which tab the recording opens with: cape or hitboxes."),
    OneOf(lambda: ("cape", "hitboxes")),
]
Start = Annotated[float | None, typer.Option(help="Begin at this time of the clip [s].")]
End = Annotated[float | None, typer.Option(help="End at this time of the clip [s].")]
Fps = Annotated[float | None, typer.Option(help="Frames per second; by default the clip's own, 60 at most.")]


def _scene(context: typer.Context, text: str | None) -> Any:
    from cape.cli.scenes.option import take_options

    return take_options(context, text)


Scene = Annotated[
    Any,
    typer.Option(
        "--scene",
        metavar="FILE",
        parser=str,
        is_eager=True,
        callback=_scene,
        help="A scene file (cape scene init writes one), or a scene's name (cape scenes lists them); further options "
        "override what it says.",
    ),
]


def gathered(
    *, leave_out: tuple[str, ...] = (), **kinds: Callable[..., Any]
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Give a command all options of some kinds; it gets what each kind makes of its own.

    A command that takes its context may be given a scene, whose options give way to those of the command line.

    Args:
        leave_out: options of these kinds that the command has no use for.
        kinds: by the name of the command's parameter what takes the options and gives its value.
    """

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        parameters: list[inspect.Parameter] = []
        of_kind: dict[str, list[str]] = {}
        for own in inspect.signature(command).parameters.values():
            taken = [own]
            if own.name in kinds:
                taken = [p for p in inspect.signature(kinds[own.name]).parameters.values() if p.name not in leave_out]
                of_kind[own.name] = [p.name for p in taken]
            parameters += [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in taken]

        context = next((p.name for p in parameters if p.annotation is typer.Context), None)

        def run(**given: Any) -> int:
            if context is not None:
                from cape.cli.scenes.option import without_rivals

                given = without_rivals(given[context], given)
            made = {name: kinds[name](**{own: given.pop(own) for own in names}) for name, names in of_kind.items()}
            return command(**made, **given)

        run.__name__, run.__doc__ = command.__name__, command.__doc__
        run.__annotations__ = {p.name: p.annotation for p in parameters} | {"return": int}
        run.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
        return run

    return decorate


def motion(
    clip: Clip = None,
    script: Script = None,
    robot: Robot = None,
    fps: Fps = None,
    unit: Unit = None,
    up: Up = None,
    height: Height = None,
    start: Start = None,
    end: End = None,
    attach: Attach = None,
    rate: Rate = None,
    packages: Packages = None,
    animation: Animation = None,
    verbose: Verbose = False,
) -> "Reading":
    """The motion, who makes it, and how to read both."""
    from cape.cli.reading import Reading
    from cape.cli.words import be_verbose

    be_verbose(verbose)
    return Reading(
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
        animation=animation,
    )


def cut(
    garment: Annotated[
        list[str] | None,
        typer.Option(
            help="What is worn (cape garments lists them), by default a shoulder_cape; repeated, the outermost first, "
            "for garments that are worn over each other."
        ),
        OneOf(marks.garments),
    ] = None,
    fabric: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[GARMENT=]FABRIC",
            help="Name of a fabric (cape fabrics lists them), by default cape; repeated, such as skirt=denim, for "
            "garments that have one of their own.",
        ),
        OneOf(marks.fabrics, of=marks.garments),
    ] = None,
    spacing: Annotated[
        float | None, typer.Option(help="Mean distance of the cloth's vertices [m]; by default for 1,500 of them.")
    ] = None,
    length: Annotated[float | None, typer.Option(help="Length of the garment [m]; by default its own.")] = None,
    solver: Annotated[
        str | None,
        typer.Option(help="euler (the default), xpbd, backward_euler, tr_bdf2, or auto to have one chosen."),
        OneOf(marks.solvers),
    ] = None,
    substeps: Annotated[int | None, typer.Option(help="Steps per frame; by default as many as needed.")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="Error that the time step may cause [mm]; chooses solver and steps.")
    ] = None,
    budget: Annotated[
        float | None, typer.Option(help="Wall time that a frame may take [ms]; chooses the most accurate that fits.")
    ] = None,
    wind: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y Z", help="Velocity of the air [m/s], Z up.")
    ] = (0.0, 0.0, 0.0),
    gusts: Annotated[
        float, typer.Option(metavar="SHARE", help="Gusts: root mean square, as a share of the wind's mean.")
    ] = 0.0,
    turbulence: Annotated[
        float,
        typer.Option(metavar="M/S", help="Eddies that the wind carries along: root mean square of each component."),
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of gusts and eddies: the same one gives the same wind.")] = 0,
    wind_file: Annotated[
        Path | None, typer.Option(help="A wind that was measured: lines of time [s], x, y, z [m/s] between commas.")
    ] = None,
    shelter: Annotated[
        bool, typer.Option("--shelter", help="Let the body keep the wind off what is behind it.")
    ] = False,
    cuts: Annotated[
        str,
        typer.Option(help="Where the bones jump, carry the cape along or reset it; off takes jumps as motion."),
        OneOf(marks.cuts),
    ] = "carry",
    self_contact: Annotated[
        bool | None,
        typer.Option(
            "--self-contact/--no-self-contact",
            help="Keep the cape from passing through itself; by default where its folds meet.",
        ),
    ] = None,
    strain_limit: Annotated[
        bool | None,
        typer.Option(
            "--strain-limit/--no-strain-limit",
            help="Hold threads back from stretching further than their fabric allows, 4 % if woven; by default where "
            "they can't part.",
        ),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(
            "--hold",
            metavar="EDGE=BONE",
            help="Have a bone, by its name or role, hold a named part of the garment, such as collar=neck; repeatable. "
            "Of a mesh also where an image is bright (mask.png=chest), or what is that near to the bone (0.05=chest).",
        ),
    ] = None,
    tear: Annotated[
        float | None,
        typer.Option(metavar="STRAIN", help="Strain at which threads part, such as 0.3; nothing then limits it."),
    ] = None,
    tear_force: Annotated[
        float | None, typer.Option(metavar="N/M", help="Force per width at which the cloth parts [N/m]; the same.")
    ] = None,
    cloth: Annotated[
        Path | None,
        typer.Option(
            metavar="MESH",
            help="Wear a mesh (GLB, OBJ, PLY; metres), modelled on the body as it stands at the origin.",
        ),
    ] = None,
    cloth_up: Annotated[
        str | None, typer.Option(help="Up axis of an OBJ or PLY mesh: y (facing +Z, the default) or z (facing -Y).")
    ] = None,
    place: Annotated[
        str | None, typer.Option(metavar="BONE", help="The mesh is modelled in the frame of this bone or role.")
    ] = None,
    scale_to_body: Annotated[
        float | None,
        typer.Option(metavar="HEIGHT", help="Scale the mesh from a body of this height, in its own unit, to this one."),
    ] = None,
    cloth_arms: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Angle between down and the arms that the mesh is modelled on; by default the widest that fits.",
        ),
    ] = None,
    remesh: Annotated[
        float | None, typer.Option(metavar="SPACING", help="Simulate the mesh with edges of this length [m].")
    ] = None,
    cloth_visual: Annotated[
        Path | None, typer.Option(metavar="MESH", help="Draw this mesh in place of the one that is simulated.")
    ] = None,
    texture: Annotated[
        Path | None, typer.Option(metavar="IMAGE", help="Lay this image over the cloth's texture coordinates.")
    ] = None,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop", help="Go on until the cape repeats as the clip does: the last frame leads into the first."
        ),
    ] = False,
) -> "Cut":
    """The cape and how to simulate it."""
    from cape.cli.commands.replay import Cut
    from cape.cli.scenes.meshes import MeshOptions

    for_all = [name for name in fabric or () if "=" not in name][:1]
    return Cut(
        garments=tuple(garment or ()),
        fabric=for_all[0] if for_all else Cut.fabric,
        fabrics=tuple(name for name in fabric or () if name not in for_all),
        spacing=spacing,
        length=length,
        solver=solver,
        substeps=substeps,
        tolerance=tolerance,
        budget=budget,
        wind=wind,
        gusts=gusts,
        turbulence=turbulence,
        seed=seed,
        wind_file=wind_file,
        shelter=shelter,
        cuts=cuts,
        self_contact=self_contact,
        strain_limit=strain_limit,
        hold=tuple(hold or ()),
        tear=tear,
        tear_force=tear_force,
        loop=loop,
        mesh=MeshOptions(
            cloth=cloth,
            up=cloth_up,
            place=place,
            modelled_height=scale_to_body,
            arms=cloth_arms,
            remesh=remesh,
            visual=cloth_visual,
            texture=texture,
        ),
    )


def help_alone(context: typer.Context) -> None:
    """Print the help of a group of commands where none of them is named, and exit with status 2."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)
