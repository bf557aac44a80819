"""What it costs to read a character of 62 joints and to move its mesh, in CPU seconds.

    python -m tests.characters.cost

The best of five runs counts. Hitboxes are fitted once, and kept by the command line for later runs.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import motions
import skeleton
from skeleton import Skeleton
from tests.characters.builder import Body, body, character

RUNS = 5


def with_toes(who: Body) -> Body:
    """The body with five more joints to each foot, which nothing follows."""
    for side in ("Left", "Right"):
        above = who.names.index(f"mixamorig:{side}ToeBase")
        for number in range(5):
            who.names.append(f"mixamorig:{side}Toe{number + 1}")
            who.parents.append(above)
    extra = [who.places[parent] + (0.0, 0.0, 0.05) for parent in who.parents[len(who.places) :]]
    who.places = np.concatenate([who.places, extra])
    return who


def best(work: Callable[[], object], runs: int = RUNS) -> float:
    """The least CPU time of several runs [s]."""
    taken = []
    for _ in range(runs):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


def main() -> None:
    """Print a line for each."""
    with tempfile.TemporaryDirectory() as folder:
        path = character(Path(folder) / "hero.glb", with_toes(body(fingers=True)), frames=0)
        clip = motions.load(path)
        skin = clip.skin
        if skin is None:
            raise RuntimeError("the character has no mesh")
        print(f"{len(clip.joints)} joints, {clip.frames} frames, {skin.vertices} vertices")
        print(f"read {best(lambda: motions.load(path)):.3f} s")
        print(f"body {best(lambda: Skeleton.from_clip(clip)):.3f} s")
        places, turns = clip.world_poses()
        at = [clip.index(bone) for bone in skin.bones]
        moved = best(lambda: [list(skin.posed(piece, places[:, at], turns[:, at])) for piece in skin.pieces], 2)
        print(f"mesh moved {1000.0 * moved / clip.frames:.2f} ms a frame")
        who = Skeleton.from_clip(clip)
        print(f"hitboxes fitted {best(lambda: skeleton.hitboxes_of(who), 1):.1f} s")


if __name__ == "__main__":
    main()
