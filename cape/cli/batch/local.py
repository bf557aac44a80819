"""Work that is done here, so many at a time."""

import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TypeVar

Item = TypeVar("Item")
Done = TypeVar("Done")


def run(
    work: Callable[[Item, Callable[[], bool]], Done], items: Sequence[Item], jobs: int
) -> Generator[tuple[Item, Done], None, None]:
    """Call `work` for each item, and give items and what came of them as they are done, the first begun first.

    Where the iterator is closed, those at work are told to stop, and waited for.

    Args:
        work: gets an item, and what tells it whether to stop.
        items: of the work.
        jobs: how many are worked on at a time.
    """
    stop = threading.Event()
    with ThreadPoolExecutor(jobs, thread_name_prefix="cape-batch") as pool:
        futures = {pool.submit(work, item, stop.is_set): item for item in items}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
