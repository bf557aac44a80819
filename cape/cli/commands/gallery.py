"""`cape gallery`: every garment and every fabric in motion, on a page."""

import shlex
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from cape.cli.character import Character, read_character
from cape.cli.commands.replay import Cut
from cape.cli.figures.rows import print_rows
from cape.cli.measuring import require_folder, sections
from cape.cli.reading import Reading
from cape.cli.running import ended_in_order
from cape.cloth.fabrics import FABRICS
from cape.garments.registry import GARMENTS
from cape.pictures import stills
from cape.pictures.gallery import page, plan
from cape.pictures.gallery.page import Shown
from cape.pictures.gallery.plan import Costume
from cape.pictures.viewer import require_viewer, viewer
from cape.results.take import Take
from cape.run.simulate import simulate
from cape.run.whereabouts import Diverged
from motions.errors import FileError, UserError, ValueRangeError
from motions.files import scratch_folder, write_text

LAYERS = ("cape", "robot", "body", "skeleton", "hitboxes", "floor")
SIZE = (400, 400)  # [pixels] of a picture, of which a sheet has six
MOMENTS = (1 / 6, 1 / 2, 5 / 6)  # of the motion
SIDES = (210.0, 30.0)  # [degrees]: from behind and a little from the right, and from straight across


def run(
    output: Path, *, garments: Sequence[str], fabrics: Sequence[str], clips: Sequence[str], robot: str | None
) -> int:
    """Draw all pictures, and the page anew after each costume; gives the exit status."""
    costumes, motions = plan.costumes(garments, fabrics, list(FABRICS)), plan.clips(clips)
    try:
        output.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(f"can't make the folder {output}: {error.strerror}") from error
    require_folder(output)
    require_viewer()
    characters = {clip: read_character(Reading(clip, skeleton=robot)) for clip in motions}
    pictures: dict[Costume, list[Shown]] = {}
    with sections() as told, scratch_folder() as folder:
        for costume in costumes:
            drawn = told(costume.title, len(motions))
            pictures[costume] = []
            for clip, who in characters.items():
                pictures[costume].append(_shown(costume, clip, who, output, folder / "take.rrd"))
                drawn()
            _write(output, pictures, robot)
    print_rows(
        [("pictures", str(sum(len(shown) for shown in pictures.values()))), ("page", str(output / "index.html"))]
    )
    return 0


def _shown(costume: Costume, clip: str, who: Character, output: Path, recording: Path) -> Shown:
    """Simulate and draw; a garment that can't be worn is told on the page, and the gallery goes on."""
    try:
        take = _simulated(costume, who)
    except UserError as error:
        return Shown(f"{clip}: {error}")
    take.save(recording, layers=LAYERS, surfaces=who.surfaces, skin=who.skin)
    with ended_in_order(), viewer(SIZE) as shown:
        shown.open(recording)
        times = [shown.begin + share * (shown.end - shown.begin) for share in MOMENTS]
        picture = stills.sheet(shown, times, SIDES, view="cape")
    stills.save(picture, output / costume.file(clip))
    return Shown(_caption(clip, take), costume.file(clip), picture.size)


def _simulated(costume: Costume, who: Character) -> Take:
    cut = Cut(garment=costume.garment, fabric=costume.fabric)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of steps that shrink; what the run itself warns of is in its take
        try:
            take = simulate(cut.scene(who), who.track, solver=cut.method(), cuts=cut.way_at_cuts(), name=who.name)
        except Diverged as error:
            raise ValueRangeError(f"can't be put on: {error}") from error
    if take.result.startswith("stopped"):
        raise KeyboardInterrupt
    return take


def _caption(clip: str, take: Take) -> str:
    facts = f"stretch {take.stretch_max.max():.1%}, penetration {1000.0 * take.penetration.max():.1f} mm at most"
    return ". ".join([f"{clip}: {facts}", *([] if take.result == "finished" else [take.result])])


def _write(output: Path, pictures: dict[Costume, list[Shown]], robot: str | None) -> None:
    titles = {garment.name: garment.title for garment in GARMENTS.values()}
    command = shlex.join(["cape", *sys.argv[1:]])
    text = page.html(pictures, titles=titles, who=robot or "a body of human proportions", command=command)
    write_text(output / "index.html", text)
