"""`cape batch`: many clips, and all combinations of options, each as one run of `cape replay`."""

import json as json_format
import os
import shlex
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cape.cli.batch import cluster as cluster_runs
from cape.cli.batch import local, passing, pictures, plan
from cape.cli.batch.cluster import Cluster
from cape.cli.batch.plan import Task
from cape.cli.batch.results import PAGE, RESULTS, Results
from cape.cli.batch.task import DONE, FAILED, complete, do, failed
from cape.cli.exports.writing import SUFFIXES, require_writable
from cape.cli.figures.rows import print_rows
from cape.cli.measuring import require_folder
from cape.cli.running import ended_in_order
from cape.cli.words import shortened
from cape.solvers.threads import GRANTED, available_cores
from cape.version import VERSION
from motions.errors import FileError, UnknownNameError, UserError
from motions.files import printable, remove_left, require_file
from motions.loading import find_motion

Done = TypeVar("Done")
BETWEEN_PAGES = 30.0  # [s] after which the page is written anew


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What is to be done with each clip, and where.

    Attributes:
        output: a folder for all files.
        arguments: of `cape replay`, for all runs.
        given: names of the options among them.
        sweep: options with several values each.
        format: of what a run writes, a suffix without its dot.
        jobs: runs at a time, None for one a core.
        cluster: whose workers do the runs, None for this machine.
        drawn: whether pictures are wanted.
    """

    output: Path
    arguments: tuple[str, ...]
    given: tuple[str, ...]
    sweep: tuple[str, ...]
    format: str
    jobs: int | None
    cluster: Cluster | None
    drawn: bool


def run(clips: Sequence[str], asked: Asked, *, json: bool) -> int:
    """Do all that doesn't stand complete, and tell; the exit status is 0 where all is done, 1 where a run failed.

    Raises:
        UserError: something is asked for that is not, or a run, or what is told of all, can't be written.
    """
    tasks = _planned(clips, asked)
    results = Results(asked.output, tasks, shlex.join(["cape", *sys.argv[1:]]))
    began = time.monotonic()
    for task in tasks:
        if (stands := complete(task)) is not None:
            results.outcomes[task.name] = stands
    if results.outcomes:
        _say(f"{len(results.outcomes)} of {len(tasks)} stand complete already")
    try:
        with ended_in_order():
            _simulate([task for task in tasks if task.name not in results.outcomes], asked, results, began)
            if asked.drawn:
                _draw([task for task, outcome in results.rows() if outcome.status == DONE], asked, results)
    finally:
        results.wall_s = time.monotonic() - began
        for task in tasks:
            remove_left(task.own_folder)
        if results.outcomes:
            try:
                results.write()
            finally:
                _tell(results, json=json)
    if unwritten := [outcome.error for _, outcome in results.rows() if outcome.unwritten]:
        raise FileError(f"{len(unwritten)} of {len(tasks)} runs are not whole: {unwritten[0]}")
    return 1 if results.count(FAILED) else 0


def _tell(results: Results, *, json: bool) -> None:
    if json:
        print(json_format.dumps(results.figures()), flush=True)
        return
    results.print_table()
    told = f"{results.count(DONE)} of {len(results.tasks)}"
    if failed := results.count(FAILED):
        told += f", {failed} failed"
    files = (("page", results.folder / PAGE), ("figures", results.folder / RESULTS))
    where = [(what, str(path)) for what, path in files if path.is_file()]
    print_rows([("done", told), *(("", note) for note in results.notes), *where])


def _planned(clips: Sequence[str], asked: Asked) -> list[Task]:
    """All tasks; whatever can be told wrong without reading a motion is told before any of them is begun."""
    suffix = f".{asked.format.removeprefix('.')}"
    if suffix not in SUFFIXES:
        raise UnknownNameError("format", asked.format, [known.removeprefix(".") for known in SUFFIXES])
    require_writable(Path(f"a{suffix}"), recorded_only={"--layers": "layers" in asked.given})
    if asked.cluster is not None:
        asked.cluster.check()
    combined = passing.combinations(asked.sweep, besides=asked.given)
    arguments = [(*asked.arguments, *passing.swept_arguments(each)) for each in combined]
    files = {name for each in arguments for name in passing.files_named(each)}
    found = plan.clips_of(clips)
    for clip in found:
        find_motion(clip)
    shared = {name: plan.digest(Path(name)) for name in sorted(files)}
    try:
        asked.output.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(f"can't make the folder {asked.output}: {error.strerror}") from error
    require_folder(asked.output)
    return [
        Task(
            name=name,
            clip=clip,
            arguments=own,
            swept=swept,
            folder=str(asked.output.resolve()),
            suffix=suffix,
            place=os.getcwd(),
            version=VERSION,
            inputs=_with_clip(shared, clip),
        )
        for clip, names in zip(found, plan.names_of(found, combined), strict=True)
        for name, own, swept in zip(names, arguments, combined, strict=True)
    ]


def _with_clip(shared: dict[str, str], clip: str) -> dict[str, str]:
    """Digests of all that a run reads; a clip that can't be read is left to the run, which tells why."""
    try:
        require_file(Path(clip))
        return {**shared, clip: plan.digest(Path(clip))}
    except UserError:
        return shared


def _simulate(tasks: Sequence[Task], asked: Asked, results: Results, began: float) -> None:
    of, written = len(tasks), time.monotonic()
    # A generator that is left open would be closed when it is collected, at a time that nobody knows.
    with closing(_spread(do, tasks, asked, failed)) as outcomes:
        for number, (task, outcome) in enumerate(outcomes, 1):
            results.outcomes[task.name] = outcome
            how = outcome.facts["result"] if outcome.status == DONE else f"{outcome.status}: {outcome.error}"
            _say(f"{number} of {of}: {task.name}, {how}, {outcome.seconds:.1f} s")
            if time.monotonic() - written > BETWEEN_PAGES:
                results.wall_s = time.monotonic() - began
                with suppress(FileError):  # it is told at the end, when there may be room again
                    results.write()
                written = time.monotonic()


def _draw(tasks: Sequence[Task], asked: Asked, results: Results) -> None:
    undrawn = pictures.missing(tasks)
    if asked.cluster is None and undrawn and (why := _cannot_draw()):
        results.notes.append(f"without pictures: {why}")
        return
    errors = Counter[str]()
    with closing(_spread(pictures.draw, undrawn, asked, lambda _, error: error)) as drawn:
        for number, (task, error) in enumerate(drawn, 1):
            _say(f"picture {number} of {len(undrawn)}: {task.name}" + (f", {error}" if error else ""))
            errors.update([error] if error else [])
    results.notes += [f"without {n} picture{'s' * (n > 1)}: {error}" for error, n in errors.items()]


def _cannot_draw() -> str:
    """Why this machine draws no pictures; nothing where it does."""
    from cape.pictures.viewer import require_viewer

    try:
        require_viewer()
    except UserError as error:
        return str(error)
    return ""


def _spread(
    work: Callable[[Task, Callable[[], bool]], Done],
    tasks: Sequence[Task],
    asked: Asked,
    failed: Callable[[Task, str], Done],
) -> Generator[tuple[Task, Done], None, None]:
    if asked.cluster is not None:
        return cluster_runs.run(work, tasks, asked.cluster, failed=failed)
    cores = available_cores()
    jobs = asked.jobs or cores
    # Runs side by side that all had threads on the same cores would wait for each other.
    os.environ.setdefault(GRANTED, str(max(1, cores // jobs)))
    return local.run(work, tasks, jobs)


def _say(text: str) -> None:
    print(shortened(printable(text)), file=sys.stderr, flush=True)
