"""Commands and their options; what they do stands in a module each."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cape.cli.options import (
    Crossings,
    Hitboxes,
    Json,
    Layers,
    Output,
    Result,
    Robot,
    Scene,
    Spawn,
    Tab,
    cut,
    gathered,
    help_alone,
    motion,
)
from cape.cli.scenes.commands import scene_files

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut
    from cape.cli.reading import Reading

app = typer.Typer(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    help="Hang a simulated cape on a moving character and record it for the Rerun viewer.",
)


def _tell_version(asked: bool) -> None:
    if asked:
        from cape.version import VERSION

        print(f"cape {VERSION}")
        raise typer.Exit


@app.callback()
def any_command(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What all commands share."""
    help_alone(context)


app.add_typer(scene_files, name="scene")


@app.command()
@gathered(reading=motion, cape=cut)
def replay(
    context: typer.Context,
    reading: "Reading",
    cape: "Cut",
    scene: Scene = None,
    output: Result = None,
    hitboxes: Hitboxes = None,
    layers: Layers = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Measure the error of the time step, and apart from the solver how deep vertices and faces are.",
        ),
    ] = False,
    crossings: Crossings = None,
    tab: Tab = "cape",
    spawn: Spawn = False,
    json: Json = False,
) -> int:
    """Simulate a cape on a character that moves as the clip tells (walk, if none is given), and record it."""
    from cape.cli.commands.replay import run
    from cape.cli.scenes.option import telling

    with telling(context, scene):
        return run(
            reading,
            cape,
            scene=scene,
            tab=tab,
            output=output,
            hitboxes=hitboxes,
            layers=split(layers),
            check=check,
            crossings=check or json if crossings is None else crossings,
            spawn=spawn,
            json=json,
        )


@app.command()
@gathered(reading=motion, cape=cut, leave_out=("clip", "script"))
def batch(
    context: typer.Context,
    reading: "Reading",
    cape: "Cut",
    clips: Annotated[
        list[str], typer.Argument(help="BVH files, folders of them, and clips as of cape replay.", show_default=False)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="A folder for all; made if needed.")],
    sweep: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=A,B", help="Run all clips with each value of this option; several are combined."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Runs at a time; by default one a core.")] = None,
    format: Annotated[
        str, typer.Option(help="What a run writes, as the suffix of cape replay -o: rrd, npz, usd, glb, ...")
    ] = "rrd",
    pictures: Annotated[bool, typer.Option(help="Draw a picture of each recording.")] = True,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Have the workers of this dask scheduler (tcp:// or tls://HOST:PORT) do the runs. It must be trusted.",
        ),
    ] = None,
    tls_ca: Annotated[Path | None, typer.Option(help="Certificates that the cluster's are signed by (PEM).")] = None,
    tls_cert: Annotated[Path | None, typer.Option(help="Your certificate for the cluster (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="The private key of your certificate (PEM).")] = None,
    scene: Scene = None,
    hitboxes: Hitboxes = None,
    layers: Layers = None,
    check: Annotated[bool, typer.Option("--check", help="As of cape replay.")] = False,
    crossings: Crossings = None,
    tab: Tab = "cape",
    json: Json = False,
) -> int:
    """Run cape replay on many clips, a process each, with a table and a page of results.

    Other options are those of cape replay. What stands complete in the folder, of the same clip and options, is not
    run again. The exit status is 1 where a run failed.
    """
    from cape.cli.batch.cluster import Cluster
    from cape.cli.batch.command import Asked, run
    from cape.cli.batch.passing import handed_on, replay_keys
    from cape.cli.scenes.option import given

    asked = Asked(
        output=output,
        arguments=handed_on(context),
        given=tuple(given(context, replay_keys())),
        sweep=tuple(sweep or ()),
        format=format,
        jobs=jobs,
        cluster=None if cluster is None else Cluster(cluster, tls_ca, tls_cert, tls_key),
        drawn=pictures,
    )
    return run(clips, asked, json=json)


@app.command()
@gathered(leave_out=("loop", "tolerance", "budget"), reading=motion, cape=cut)
def live(
    context: typer.Context,
    reading: "Reading",
    cape: "Cut",
    scene: Scene = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Record: .rrd, a take (.npz), or an export as of cape export.")
    ] = None,
    hitboxes: Hitboxes = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in a browser instead of a window.")] = False,
    by_hand: Annotated[
        bool, typer.Option("--by-hand", help="Show it on a page on which it can be dragged; needs cape[live].")
    ] = False,
    no_viewer: Annotated[bool, typer.Option("--no-viewer", help="Show nothing.")] = False,
    connect: Annotated[
        str | None, typer.Option(metavar="URL", help="Show it in a viewer that runs: rerun+http://HOST:9876/proxy.")
    ] = None,
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address that the viewer listens on; loopback unless told otherwise.")
    ] = "127.0.0.1",
    seconds: Annotated[float | None, typer.Option(help="End after so long [s].")] = None,
    json: Json = False,
) -> int:
    """Simulate a cape as the clock runs, steered by the keys of the terminal (? tells them), and show it.

    Without CLIP the character stands, walks, runs, kicks and jumps as it is told.
    """
    from cape.cli.live.command import run
    from cape.cli.scenes.option import telling

    asked = {"--web": web, "--by-hand": by_hand, "--no-viewer": no_viewer, "--connect": connect is not None}
    if len(chosen := [option for option, given in asked.items() if given]) > 1:
        raise typer.BadParameter(f"give one of {' and '.join(chosen)}")
    viewer = connect or ("web" if web else "page" if by_hand else "none" if no_viewer else "window")
    with telling(context, scene):
        return run(
            reading, cape, scene=scene, output=output, hitboxes=hitboxes, viewer=viewer, bind=bind, seconds=seconds,
            json=json,
        )  # fmt: skip


@app.command()
def export(
    take: Annotated[Path, typer.Argument(help="A take that cape replay -o TAKE.npz has kept.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="What to write: .usd, .usda, .usdc, .glb, .obj, .pc2, .mdd or .ply; or a recording, .rrd.",
        ),
    ],
    joints: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Bake a .glb to joints in chains with skin weights, for game engines; tells how far off it is.",
        ),
    ] = None,
    json: Json = False,
) -> int:
    """Write a kept take for other programs, or for the viewer, in the format that the output's suffix names."""
    from cape.cli.exports.command import run

    return run(take, output, joints=joints, json=json)


@app.command()
@gathered(reading=motion, cape=cut)
def render(
    reading: "Reading",
    cape: "Cut",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="A picture (.png, .jpg) or a film (.gif, .mp4); by default CLIP.png, here."
        ),
    ] = None,
    view: Annotated[
        str | None, typer.Option(help="Name of a view of the recording; by default the one that it opens with.")
    ] = None,
    at: Annotated[
        list[float] | None,
        typer.Option(help="Time of a picture [s], by default halfway; of several, pictures stand side by side."),
    ] = None,
    side: Annotated[
        list[str] | None,
        typer.Option(
            "--from",
            metavar="SIDE",
            help="Where to look from: front, back, left, right, or degrees around the character, 90 from its left; may "
            "be repeated. By default as the recording opens.",
        ),
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of each picture [pixels].")] = "900x900",
    film_fps: Annotated[float, typer.Option(help="Frames of a film per second.")] = 25.0,
    hitboxes: Hitboxes = None,
) -> int:
    """Draw pictures or a film of a recording (.rrd), or of a clip that is replayed first, without a display.

    Of a recording, --start and --end choose the part that is filmed.
    """
    from cape.cli.commands.render import Shots, run

    shots = Shots.asked(view=view, times=at or [], sides=side or [], size=size, film_fps=film_fps)
    return run(reading.or_walk(), cape, shots, output=output, hitboxes=hitboxes)


@app.command()
@gathered(reading=motion)
def hitboxes(
    reading: "Reading",
    output: Output = None,
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

    return run(reading, output=output, hitboxes=which, write=write, bare=bare, spawn=spawn)


@app.command()
def clips() -> int:
    """List the clips that come with the package."""
    from cape.cli.commands.info import list_clips

    return list_clips()


@app.command()
def scenes(json: Json = False) -> int:
    """List the scenes that cape replay --scene knows by name."""
    from cape.cli.commands.scenes import list_scenes

    return list_scenes(json=json)


@app.command()
def fabrics(
    write: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Save their textures there: albedo, normals and metal-roughness.")
    ] = None,
    json: Json = False,
) -> int:
    """List the fabrics that a cape may be of: how each drapes, weight, stiffness (warp / weft), and who measured it."""
    from cape.cli.commands.fabrics import run

    return run(json=json, write=write)


@app.command()
def garments(json: Json = False) -> int:
    """List what a character may wear."""
    from cape.cli.commands.garments import run

    return run(json=json)


@app.command()
@gathered(reading=motion, leave_out=("fps", "start", "end"))
def info(reading: "Reading", which: Hitboxes = None, json: Json = False) -> int:
    """Tell what a motion or a robot (by its name or URDF file, in place of CLIP) holds: joints, roles, unit, what was
    decided while reading, what to look at."""
    from cape.cli.commands.info import run

    return run(reading, hitboxes=which, json=json)


@app.command()
def doctor(json: Json = False) -> int:
    """Tell what this machine has of what cape uses, and how to get what it lacks."""
    from cape.cli.commands.doctor import run

    return run(json=json)


@app.command()
def addon(
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to install in Blender.")] = Path(
        "cape_blender.py"
    ),
) -> int:
    """Write the add-on for Blender, which hangs a cape on the selected armature by calling this command."""
    from cape.addon.install import run

    return run(output)


@app.command()
def manual(
    chapter: Annotated[
        str | None, typer.Argument(help="Its name; none lists the chapters.", show_default=False)
    ] = None,
) -> int:
    """Print a chapter of the manual."""
    from cape.manual.command import run

    return run(chapter)


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


@app.command()
def gallery(
    output: Annotated[Path, typer.Option("-o", "--output", help="A folder for all files; made if needed.")] = Path(
        "gallery"
    ),
    garment: Annotated[list[str] | None, typer.Option("--garment", help="Only this garment; may be repeated.")] = None,
    fabric: Annotated[list[str] | None, typer.Option("--fabric", help="Only this fabric; may be repeated.")] = None,
    clip: Annotated[
        list[str] | None,
        typer.Option("--clip", help="Move like this clip, in place of walk, run, spin; may be repeated."),
    ] = None,
    robot: Robot = None,
) -> int:
    """Draw every garment and every fabric in motion, from behind and from in front, on a page."""
    from cape.cli.commands.gallery import run

    return run(output, garments=garment or [], fabrics=fabric or [], clips=clip or [], robot=robot)


def split(layers: str | None) -> list[str] | None:
    """Names that stand in one text, separated by commas."""
    return None if layers is None else [name.strip() for name in layers.split(",") if name.strip()]
