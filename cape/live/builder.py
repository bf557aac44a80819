"""A thread that makes things ready beside the run, so that the run never waits for them."""

import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

Ready = Callable[[Any], str | None]
"""What the run does with what was made: gives a text to tell, if any."""


class Builder:
    """Makes one thing after the other; of those that wait under one name only the newest is made."""

    def __init__(self) -> None:
        """Nothing is asked for yet."""
        self._asked: dict[str, tuple[Callable[[], Any], Ready]] = {}
        self._ready: SimpleQueue[tuple[Ready, Any, Exception | None]] = SimpleQueue()
        self._wake = threading.Condition()
        self._ended = False
        self._making = ""
        self._thread: threading.Thread | None = None

    def ask(self, name: str, make: Callable[[], Any], ready: Ready) -> None:
        """Have something made; `ready` is called with it by who calls `deliver`."""
        with self._wake:
            self._asked[name] = make, ready
            self._wake.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="cape-builder", daemon=True)
            self._thread.start()

    @property
    def making(self) -> str:
        """What is being made, empty for nothing."""
        return self._making or next(iter(self._asked), "")

    def deliver(self) -> list[tuple[str | None, Exception | None]]:
        """Hand over what is ready, on the thread that calls this: a text to tell or what went wrong for each."""
        told: list[tuple[str | None, Exception | None]] = []
        while True:
            try:
                ready, made, error = self._ready.get_nowait()
            except Empty:
                return told
            if error is not None:
                told.append((None, error))
                continue
            try:
                told.append((ready(made), None))
            except Exception as failed:
                told.append((None, failed))

    def close(self) -> None:
        """Make nothing more; what is being made is given up with the process."""
        with self._wake:
            self._ended = True
            self._asked.clear()
            self._wake.notify()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._making = ""
                while not self._asked and not self._ended:
                    self._wake.wait()
                if self._ended:
                    return
                self._making = next(iter(self._asked))
                make, ready = self._asked.pop(self._making)
            try:
                self._ready.put((ready, make(), None))
            except Exception as error:
                self._ready.put((ready, None, error))
