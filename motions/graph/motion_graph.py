"""Clips joined into one: where they are alike a character passes from one to another, as a script tells."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions.border import checked
from motions.clip import Clip
from motions.errors import UnknownNameError, UserError, ValueRangeError
from motions.files import text_of
from motions.graph.alignment import window_distances
from motions.graph.blend import SUPPORTS, Blends, blend_windows
from motions.graph.blend_source import Source
from motions.graph.one_mesh import one_mesh
from motions.graph.one_skeleton import check_one_skeleton
from motions.graph.script import Step, parse_script
from motions.graph.splice import Splice

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CANDIDATES = 40
"""Pairs of frames whose blends are tried at each length, dense among those of small distance, sparse among the rest."""

NEAR = 3
"""By how many frames the best of them is then moved either way, in each of its two clips."""

SLIDE = 4.0
"""Weight of the sliding of feet against the distance of two windows: a foot that slides is seen sooner than a pose that
changes."""

LENGTHEN = 1.5
"""Factor from each length of blends that is tried to the next."""

REACHES = (2, 4, 8, 16)
"""How many times as far as `search` says a passage is then looked for, until no joint is too fast in it."""

MOST_NAMED = 8  # parts of a script that the name of the clip tells


@checked
@dataclass(frozen=True)
class Transition:
    """A place where one clip can pass into another.

    Attributes:
        source: name of the clip that is left.
        target: name of the clip that is entered.
        leave: last frame of the source that is seen alone.
        enter: frame of the target that stands for it; the first that is seen alone is `enter + frames`.
        frames: number of frames from `leave` on in which the two are blended.
        distance: root mean square distance of joints and end sites over these frames [m], with the target turned and
            shifted to fit best.
        heading: that turn about +Z [rad].
    """

    source: str
    target: str
    leave: int
    enter: int
    frames: int
    distance: float
    heading: float


@dataclass(frozen=True, eq=False)
class Passage:
    """A transition as it is played: with the blend, which takes `extra` frames besides those of the transition.

    It was found among frames up to `reach` times as far off as asked for.
    """

    at: Transition
    extra: int
    blends: Blends
    reach: int = 1

    @property
    def duration(self) -> int:
        """Number of frames from the last of the source to the first of the target."""
        return self.at.frames + self.extra

    @property
    def slide(self) -> float:
        """How far that joint of a foot slides over the ground which does so most [m]."""
        return float(self.blends.slides[0])

    @property
    def haste(self) -> float:
        """Largest ratio of a joint's speed to its largest in the two clips."""
        return float(self.blends.haste.max())


@dataclass(frozen=True)
class _Option:
    """A passage that may be chosen: which feet hold the body, its extra frames, its cost, whether it takes too long."""

    at: Transition
    support: int
    extra: int
    cost: float
    late: bool


@dataclass(frozen=True)
class _Span:
    """Frames at which a clip may be left or entered, and the one to take where nothing else decides, if any."""

    first: int
    last: int
    wanted: int | None = None

    def costs(self) -> FloatArray:
        """1 for the wanted frame, rising to 2 for the farthest, shape (last - first + 1,)."""
        frames = np.arange(self.first, self.last + 1)
        off = np.zeros(len(frames)) if self.wanted is None else np.abs(frames - self.wanted)
        return 1.0 + off / max(off.max(), 1.0)


_Spans = Callable[[int, int], tuple[_Span, _Span]]
"""Where a clip may be left and the next entered, given the number of frames in which they are blended and the reach."""


@checked
class MotionGraph:
    """Clips of one skeleton, and the transitions between them.

    L. Kovar, M. Gleicher and F. Pighin, "Motion Graphs", ACM Trans. Graph. 21 (2002), section 3. A blend is drawn out
    where a joint would otherwise be faster in it than anywhere in its two clips.

    Attributes:
        fps: frames per second.
        mesh: that the clips have in common, with the morphs that any of them moves.
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        *,
        blend: float = 0.3,
        longest: float = 2.0,
        search: float = 0.5,
        fps: float | None = None,
    ):
        """Take clips that share a skeleton; those of another frame rate are resampled.

        Args:
            clips: one or more, of different names.
            blend: how long a blend takes at least [s].
            longest: how long one may take [s], the clips overlapping for half of it at most; slow clips of different
                poses need long blends.
            search: by how much a part of a script may be longer or shorter than asked, and how far into a clip it may
                begin, where the clips are more alike there [s]; up to 16 times that where joints would be too fast.
            fps: frames per second, by default those of the clip that has most.

        Raises:
            ValueRangeError: no clips, two of one name, different skeletons, a clip of less than three blends, or a
                number that isn't above 0.
        """
        if not len(clips):
            raise ValueRangeError("a motion graph needs at least one clip")
        names = [clip.name for clip in clips]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueRangeError(f"the clips of a motion graph need different names; given twice: {repeated[0]!r}")
        check_one_skeleton(clips)
        self.fps = max(clip.fps for clip in clips) if fps is None else float(fps)
        for label, value in (("blend", blend), ("longest", longest), ("search", search), ("fps", self.fps)):
            if not (np.isfinite(value) and value > 0):
                raise ValueRangeError(f"{label} must be above 0, not {value:g}")
        if blend > longest:
            raise ValueRangeError(f"the longest blend, {longest:g} s, is shorter than the shortest, {blend:g} s")
        self._shortest, self._longest, self._search = (max(round(t * self.fps), 1) for t in (blend, longest, search))
        clips = [c if c.fps == self.fps else c.resample(self.fps) for c in clips]
        self.mesh = one_mesh(clips)
        self._sources = {c.name: Source(c, weights) for c, weights in zip(clips, self.mesh.weights, strict=True)}
        for name, source in self._sources.items():
            if source.third < self._shortest:
                least = 3 * self._shortest / self.fps
                raise ValueRangeError(
                    f"clip {name!r} lasts {source.clip.duration:.2f} s, too short for blends: {least:.2f} s are needed"
                )
        self._loops: dict[str, Passage] = {}

    @property
    def clips(self) -> tuple[Clip, ...]:
        """The clips, all at the graph's frame rate."""
        return tuple(source.clip for source in self._sources.values())

    def transitions(self, source: str, target: str) -> tuple[Transition, ...]:
        """The places where two clips are more alike than around them, the most alike first; blends are the shortest.

        From a clip to itself those are left out that go on or back by less than a blend. Time and memory grow with the
        product of the two clips' numbers of frames.

        Raises:
            UnknownNameError: there is no such clip.
        """
        frames = self._shortest
        distances, headings = window_distances(self.source(source).points, self.source(target).points, frames + 1)
        if source == target:
            rows, columns = np.indices(distances.shape)
            distances[np.abs(rows - columns) < frames] = np.inf
        places = np.argwhere(_local_minima(distances))
        places = places[np.argsort(distances[tuple(places.T)], kind="stable")]
        return tuple(
            Transition(source, target, i, j, frames, float(distances[i, j]), float(headings[i, j]))
            for i, j in places.tolist()
        )

    def play(self, script: str | Sequence[Step]) -> Clip:
        """One seamless clip of all parts of a script.

        A part with a time lasts that long, give or take `search`, from where its blend begins to where the next one's
        does, but no less than the blend that leads to it; it goes round in its clip where that is shorter. A part
        without a time plays its clip once, from one of the first frames to one of the last, no farther from the ends
        than a blend is long. Where all blends would be too fast there, clips are left and entered farther off. The last
        part ends exactly on its time, or with its clip. Parts with times that follow each other in the same clip are
        one.

        Returns:
            A clip named after the parts; its decisions tell where each begins, and how well clips fit together.

        Raises:
            UserError: the script can't be read or is empty.
            UnknownNameError: it names a clip that isn't there; lists the clips.
        """
        steps = parse_script(script) if isinstance(script, str) else tuple(script)
        if not steps:
            raise UserError("the script has no part")
        for number, step in enumerate(steps, 1):
            self.source(step.clip, f"It stands in part {number} of the script, {str(step)!r}")
        steps = _joined(steps)
        splice, decisions = Splice(), [f"{steps[0].clip} begins at 0.00 s with its frame 0"]
        at, played = 0, 0  # the frame of the clip that comes next, and how many frames of the part lie behind
        for step, after in zip(steps, [*steps[1:], None], strict=True):
            source = self.source(step.clip)
            end = source.clip.frames - 1
            if step.seconds is not None:
                left = round(step.seconds * self.fps) - played
                room = self._shortest - self._search if after else 0
                while at + left > end - room:
                    loop = self.loop(step.clip)
                    left -= loop.at.leave - at + loop.duration
                    at = self._pass(splice, at, loop, decisions)
                end = max(at + left, at)
            if after is None:
                splice.play(source, at, end)
                break
            passage = self._best(step.clip, after.clip, self._spans(at, step, end, after))
            at, played = self._pass(splice, at, passage, decisions), passage.duration
        return self._clip(steps, splice, decisions)

    def source(self, name: str, hint: str = "") -> Source:
        """A clip at the graph's frame rate, with what blends need to know of it.

        Raises:
            UnknownNameError: there is no such clip; lists them.
        """
        if name not in self._sources:
            raise UnknownNameError("clip", name, self._sources, hint)
        return self._sources[name]

    def _spans(self, at: int, step: Step, end: int, after: Step) -> _Spans:
        """Where a clip that has been played up to the frame `at` may be left, best at `end`, and the next begin."""
        source, target = self._sources[step.clip], self._sources[after.clip]
        final = source.clip.frames - 1

        def spans(frames: int, reach: int) -> tuple[_Span, _Span]:
            last, search = final - frames, reach * self._search
            if step.seconds is None:
                leaving = _Span(max(at, last - reach * frames), last, last)
            else:
                wanted = min(max(end, at), last)
                leaving = _Span(max(at, wanted - search), min(wanted + search, last), wanted)
            if after.seconds is None:
                return leaving, _Span(0, min(reach * frames, target.third), 0)
            return leaving, _Span(0, min(search, target.third))

        return spans

    def loop(self, name: str) -> Passage:
        """The best way from the last third of a clip back to its first."""
        if name not in self._loops:
            source = self._sources[name]
            end, third = source.clip.frames - 1, source.third
            self._loops[name] = self._best(
                name, name, lambda frames, _: (_Span(end - third, end - frames), _Span(0, third))
            )
        return self._loops[name]

    def _best(self, source: str, target: str, spans: _Spans) -> Passage:
        """The passage between two clips that costs least, from no farther off than keeps joints within their limits.

        If none keeps them, the best of those that are near.
        """
        near = passage = self._best_within(source, target, spans, 1)
        for reach in REACHES:
            if passage.haste <= 1.0:
                return passage
            if spans(self._shortest, reach) == spans(self._shortest, reach // 2):
                break
            passage = self._best_within(source, target, spans, reach)
        return passage if passage.haste <= 1.0 else near

    def _best_within(self, source: str, target: str, spans: _Spans, reach: int) -> Passage:
        """The passage that costs least, among blends of several lengths."""
        longest = min(
            max(self._shortest, self._longest // 2), *(self._sources[name].third for name in (source, target))
        )
        options, frames = [], self._shortest
        while frames <= longest:
            options.append(self._best_of_length(source, target, frames, *spans(frames, reach)))
            frames = round(LENGTHEN * frames)
        return replace(self._drawn_out(min(options, key=lambda option: (option.late, option.cost))), reach=reach)

    def _best_of_length(self, source: str, target: str, frames: int, leaving: _Span, entering: _Span) -> _Option:
        """The cheapest of some blends from all over the spans, or of all that begin a few frames from it.

        The cost is the distance of the two windows and `SLIDE` times what feet slide in the blend, both in metres; it
        grows with how far the frames are from those that are wanted, and with how much the blend is drawn out.
        """
        a, b = self._sources[source], self._sources[target]
        distances, headings = window_distances(
            a.points[leaving.first : leaving.last + frames + 1],
            b.points[entering.first : entering.last + frames + 1],
            frames + 1,
        )
        factors = leaving.costs()[:, None] * entering.costs()

        def cheapest(i: IntArray, j: IntArray, supports: IntArray) -> _Option:
            leave, enter = leaving.first + i, entering.first + j
            blends = blend_windows(a, b, leave, enter, headings[i, j], supports, frames)
            extra = blends.extra_frames()
            apart, unwanted = (np.tile(each[i, j], len(supports)) for each in (distances, factors))
            costs = (apart + SLIDE * blends.slides) * unwanted * (1.0 + extra / frames / 2)
            late = frames + extra > self._longest
            best = np.lexsort((costs, late))[0]
            way, k = divmod(int(best), len(i))
            numbers = int(leave[k]), int(enter[k]), frames, float(distances[i[k], j[k]]), float(headings[i[k], j[k]])
            at = Transition(source, target, *numbers)
            return _Option(at, int(supports[way]), int(extra[best]), float(costs[best]), bool(late[best]))

        i, j = _least(distances * factors, CANDIDATES)
        coarse = cheapest(i, j, np.array(SUPPORTS))
        place = coarse.at.leave - leaving.first, coarse.at.enter - entering.first
        rows, columns = (
            np.arange(max(x - NEAR, 0), min(x + NEAR + 1, size)) for x, size in zip(place, distances.shape, strict=True)
        )
        i, j = np.repeat(rows, len(columns)), np.tile(columns, len(rows))
        return cheapest(i, j, np.array([coarse.support]))

    def _drawn_out(self, option: _Option) -> Passage:
        """The passage with as few extra frames as keep its joints within their limits, but no longer than allowed."""
        at, extra, most = option.at, option.extra, self._longest - option.at.frames
        while True:
            extra = min(extra, most)
            blends = blend_windows(
                self._sources[at.source],
                self._sources[at.target],
                np.array([at.leave]),
                np.array([at.enter]),
                np.array([at.heading]),
                np.array([option.support]),
                at.frames,
                extra=extra,
            )
            passage = Passage(at, extra, blends)
            if passage.haste <= 1.0 or extra == most:
                return passage
            extra += 1

    def _pass(self, splice: Splice, at: int, passage: Passage, decisions: list[str]) -> int:
        """Play a clip from a frame on and pass to the next, of which the frame that comes next is returned."""
        transition = passage.at
        splice.play(self._sources[transition.source], at, transition.leave)
        again = " again" if transition.source == transition.target else ""
        text = (
            f"{transition.target} begins{again} at {(splice.frames - 1) / self.fps:.2f} s: from {transition.source}'s "
            f"frame {transition.leave} to its frame {transition.enter} within {passage.duration / self.fps:.2f} s, "
            f"at a distance of {100 * transition.distance:.1f} cm; feet slide by {100 * passage.slide:.1f} cm"
        )
        if passage.reach > 1:
            off = passage.reach * self._search / self.fps
            text += f"; up to {off:.2f} s off, as joints would be too fast nearer by"
        if passage.haste > 1.0:
            text += f"; joints are up to {passage.haste:.2f} times as fast as in either, for want of a longer blend"
        decisions.append(text)
        splice.pass_over(passage.blends)
        return transition.enter + transition.frames

    def _clip(self, steps: Sequence[Step], splice: Splice, decisions: list[str]) -> Clip:
        first = self._sources[steps[0].clip].clip
        rotations, local_positions = splice.poses()
        moving = any(self._sources[step.clip].clip.local_positions is not None for step in steps)
        names = [text_of(Path(step.clip).stem) for step in steps]
        more = len(names) - MOST_NAMED
        told = [
            f"{name}: {decision}"
            for name in dict.fromkeys(step.clip for step in steps)
            for decision in self._sources[name].clip.decisions
        ]
        here = [clip.name for clip, own in zip(self.clips, self.mesh.own, strict=True) if own]
        dressed = first.name in here
        told += [
            f"{name}: its morph targets stay as the file states them, as its mesh is not that of {(here or [''])[0]}"
            for name in dict.fromkeys(step.clip for step in steps)
            if name in self.mesh.lost
        ]
        return replace(
            first,
            name="-".join([*names[:MOST_NAMED], *([f"and-{more}-more"] if more > 0 else [])]),
            root_positions=local_positions[:, 0],
            rotations_wxyz=rotations,
            local_positions=local_positions if moving else None,
            skin=self.mesh.skin if dressed else first.skin,
            morphs=splice.morphs() if dressed and self.mesh.weights[0].shape[1] else None,
            decisions=(*told, *decisions),
        )


def _joined(steps: Sequence[Step]) -> list[Step]:
    """The steps, those that only go on in the same clip for some more time added up."""
    joined: list[Step] = []
    for step in steps:
        before = joined[-1] if joined else None
        if before and before.clip == step.clip and before.seconds is not None and step.seconds is not None:
            joined[-1] = Step(step.clip, before.seconds + step.seconds)
        else:
            joined.append(step)
    return joined


def _local_minima(values: FloatArray) -> NDArray[np.bool_]:
    """Where a value is finite and no neighbour, of eight, is less, shape (M, N)."""
    rows, columns = values.shape
    around = np.pad(values, 1, constant_values=np.inf)
    neighbours = [around[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.isfinite(values) & (values <= np.min(neighbours, axis=0))


def _least(values: FloatArray, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of at most `count` values in rising order: the least ones, and ever fewer of the larger ones."""
    order = np.argsort(values, axis=None, kind="stable")
    places = np.unique(np.geomspace(1, len(order), count).astype(np.int64)) - 1
    i, j = np.unravel_index(order[places], values.shape)
    return i, j
