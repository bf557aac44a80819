"""Several threads that share a cloth, and how many cores there are for that.

The calling thread is one of the team, the others are kept between calls, and whoever finds them busy works alone, with
the same bits as result.
"""

import math
import os
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import COMPILER_OFF
from cape.kernels.team import GONE, LINE


class CalledOff(RuntimeError):
    """What a rank does is not wanted any more, as another one was interrupted or failed."""


Work = Callable[[int], None]
"""What a rank does, given its number."""

CONTROL_GROUPS = Path("/sys/fs/cgroup")
OWN_GROUPS = Path("/proc/self/cgroup")
VERTICES_OF_A_THREAD = 1500  # at least
GRANTED = "OMP_NUM_THREADS"  # where clusters and batches tell how many threads a process may have
THREADED_VERTICES = 3000  # from which on a second thread gives half as much speed again


def run(work: Work, alone: Callable[[], None], arrivals: NDArray[np.int64]) -> int:
    """Call `work` on several threads at once, each with its rank; or `alone`, if they are busy.

    There is one team at a time in a process: while it works, other callers, and what its own ranks call, run on one
    thread. The calling thread is rank 0.

    Args:
        work: what all ranks do; it must let other threads go on, and meet equally often in all ranks.
        alone: what does the same on one thread.
        arrivals: where the ranks meet, a `LINE` of words for each of them. More ranks than `available_cores` are right,
            but slow.

    Returns:
        The number of threads that it ran on.

    Raises:
        BaseException: what a rank raised, or an interrupt, once all ranks are done; what they wrote is then invalid.
        RuntimeError: the ranks met unequally often, so that what they wrote is invalid.
    """
    crew, size = _crew, len(arrivals) // LINE
    if size <= 1 or COMPILER_OFF or crew.working.locked():
        alone()
        return 1
    # Two that found it free go one after the other. `with` cannot be interrupted between the lock and what frees it.
    with crew.working:
        crew.work(work, arrivals)
    return size


def require_wanted() -> None:
    """Break off what a rank of a team does on this thread, where it has been called off.

    Raises:
        CalledOff: it has; who called the team raises what went wrong.
    """
    share = getattr(_here, "share", None)
    if share is not None and share.called_off:
        raise CalledOff


def threads_for(vertices: int) -> int:
    """How many threads pay off for a cloth, of the cores that there are, and of those that `OMP_NUM_THREADS` grants."""
    if vertices < THREADED_VERTICES:
        return 1
    granted = os.environ.get(GRANTED, "").partition(",")[0]  # of several levels, the outermost
    most = min(available_cores(), vertices // VERTICES_OF_A_THREAD)
    return min(most, int(granted)) if granted.isdecimal() and int(granted) else most


def available_cores() -> int:
    """Number of cores that this process may keep busy: by its affinity, and by the quota of its control groups."""
    allowed = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    return max(1, math.floor(min(allowed, cpu_quota(CONTROL_GROUPS, OWN_GROUPS))))


def cpu_quota(mount: Path, own_groups: Path) -> float:
    """Cores' worth of time that Linux grants to the control groups around this process, infinite without a limit.

    Args:
        mount: where control groups are mounted, version 2 or version 1.
        own_groups: the file that names those of this process, as /proc/self/cgroup does.
    """
    limits = [_ratio(mount / "cpu/cpu.cfs_quota_us", mount / "cpu/cpu.cfs_period_us")]
    for line in own_groups.read_text().splitlines() if own_groups.exists() else []:
        if line.startswith("0::/"):
            group = Path(line.removeprefix("0::/"))
            limits += [_ratio(mount / inner / "cpu.max") for inner in (group, *group.parents)]
    return min(limits)


def _ratio(*files: Path) -> float:
    """Quota over period [us/us] from the words in files; a quota of "max" or -1, or no such file, is no limit."""
    if not all(file.exists() for file in files):
        return math.inf
    quota, period = " ".join(file.read_text() for file in files).split()
    return math.inf if quota in ("max", "-1") else int(quota) / int(period)


class _Crew:
    """The threads that help the calling ones; they end with the process, whatever they wait for."""

    def __init__(self) -> None:
        self.working = threading.Lock()
        self._inboxes: list[SimpleQueue[_Share]] = []

    def work(self, work: Work, arrivals: NDArray[np.int64]) -> None:
        """Call `work` as all ranks and return when all are done, however it ends."""
        size = len(arrivals) // LINE
        arrivals[:] = 0
        self._grow(size - 1)
        shares = [_Share(work, rank, arrivals[rank * LINE :]) for rank in range(1, size)]
        try:
            for inbox, share in zip(self._inboxes, shares, strict=False):
                inbox.put(share)
            work(0)
            meetings = [int(arrivals[0])]
            arrivals[0] = GONE
            for share in shares:
                share.wait()
        except BaseException:
            arrivals[0] = GONE
            _call_off(shares)
            raise
        for share in shares:
            if share.error is not None:
                raise share.error
            meetings.append(share.meetings)
        if len(set(meetings)) > 1:
            raise RuntimeError(f"the ranks of a team met unequally often: {', '.join(map(str, meetings))} times")

    def _grow(self, size: int) -> None:
        while len(self._inboxes) < size:
            inbox: SimpleQueue[_Share] = SimpleQueue()
            threading.Thread(target=_serve, args=(inbox,), name="cape-team", daemon=True).start()
            self._inboxes.append(inbox)


class _Share:
    """What one rank does; it belongs to whoever is first to say so, the thread that runs it or the one to call it off.

    `word` is where the rank counts its meetings.
    """

    def __init__(self, work: Work, rank: int, word: NDArray[np.int64]) -> None:
        self.error: BaseException | None = None
        self.called_off = False
        self.meetings = 0
        self._work, self._rank, self._word = work, rank, word
        self._owner: dict[str, str] = {}
        self._unfinished = threading.Lock()
        self._unfinished.acquire()

    def run(self) -> None:
        if self._owner.setdefault("name", "runner") != "runner":
            return
        _here.share = self
        try:
            self._work(self._rank)
        except BaseException as error:
            self.error = error
        _here.share = None
        self.meetings = int(self._word[0])
        self._word[0] = GONE
        self._unfinished.release()

    def wait(self) -> None:
        with self._unfinished:
            pass

    def call_off(self) -> bool:
        """See to it that it doesn't begin any more, or ends soon; False if it did begin. May be repeated."""
        self.called_off = True
        if self._owner.setdefault("name", "caller") == "runner":
            return False
        self._word[0] = GONE
        return True


def _serve(inbox: SimpleQueue[_Share]) -> None:
    while True:
        inbox.get().run()


def _call_off(shares: Sequence[_Share]) -> None:
    """Return when no rank is at work any more; further interrupts change nothing, since one is on its way already."""
    while True:
        try:
            begun = [share for share in shares if not share.call_off()]
            for share in begun:
                share.wait()
            return
        except KeyboardInterrupt:
            continue


def _start_anew() -> None:
    global _crew
    _crew = _Crew()


_crew = _Crew()
_here = threading.local()  # the share that a thread works on
if sys.platform != "win32":
    os.register_at_fork(after_in_child=_start_anew)  # a child has none of its parent's threads
