"""Tasks that are done by the workers of a dask.distributed scheduler, which the user names.

Whoever commands the scheduler runs code on the workers, and what they answer is unpickled here: it must be trusted.
"""

import secrets
import sys
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cape.cli.batch.plan import Task
from cape.version import VERSION
from motions.errors import FileError, UserError, ValueRangeError
from motions.files import require_file, write_text

PLAIN, ENCRYPTED = "tcp://", "tls://"
WAIT = "10s"  # for the scheduler to answer
MARK = ".cape-batch"  # a file in the batch's folder, by which workers know it
Done = TypeVar("Done")
Work = Callable[[Task, Callable[[], bool]], Done]


@dataclass(frozen=True)
class Cluster:
    """A scheduler, and what shows who we are.

    Attributes:
        address: "tcp://HOST:PORT", or "tls://HOST:PORT" with all three files.
        ca: certificates of authorities that are trusted, a PEM file.
        cert: our own certificate.
        key: its private key.
    """

    address: str
    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None

    def check(self) -> None:
        """Look at what can be told wrong before anything is connected.

        Raises:
            UserError: the address makes no sense, a file is missing, or the package is.
        """
        files = {"--tls-ca": self.ca, "--tls-cert": self.cert, "--tls-key": self.key}
        if not self.address.startswith((PLAIN, ENCRYPTED)):
            raise ValueRangeError(f"--cluster takes tcp://HOST:PORT or tls://HOST:PORT, not {self.address!r}")
        missing = [option for option, path in files.items() if path is None]
        if self.address.startswith(ENCRYPTED) and missing:
            raise UserError(f"{self.address} needs {', '.join(missing)} as well")
        if self.address.startswith(PLAIN) and len(missing) < len(files):
            raise UserError(f"{self.address} is not encrypted: certificates are for tls://HOST:PORT")
        for path in files.values():
            if path is not None:
                require_file(path)
        try:
            import distributed  # noqa: F401
        except ImportError as error:
            raise UserError("--cluster needs dask.distributed: pip install 'cape[cluster]'") from error


def run(
    work: Work[Done], tasks: Sequence[Task], cluster: Cluster, *, failed: Callable[[Task, str], Done]
) -> Generator[tuple[Task, Done], None, None]:
    """Have workers call `work` for each task, and give tasks and what came of them as they are done.

    A task whose worker is gone is given to another one. Where the iterator is closed, no further task is begun.

    Args:
        work: gets a task, and what tells it whether to stop.
        tasks: of one batch.
        cluster: who does them.
        failed: what came of a task that no worker could do, given why.

    Raises:
        UserError: no scheduler answers there.
    """
    from distributed import as_completed

    if not tasks:
        return
    mark = secrets.token_hex(16)
    place = Path(tasks[0].folder, MARK)
    client = _connected(cluster)
    try:
        write_text(place, mark)
        if not client.scheduler_info()["workers"]:
            print(f"{cluster.address} has no workers yet: waiting for one", file=sys.stderr, flush=True)
        futures = client.map(
            _on_worker, tasks, work=work, mark=mark, key=[f"cape-{mark}-{task.name}" for task in tasks]
        )
        by_key = {future.key: task for future, task in zip(futures, tasks, strict=True)}
        try:
            for future in as_completed(futures, loop=client.loop):
                task, error = by_key[future.key], _error(future)
                yield task, future.result() if error is None else failed(task, error)
        finally:
            client.cancel(futures)
    finally:
        client.close()
        place.unlink(missing_ok=True)


def _on_worker(task: Task, *, work: Work[Done], mark: str) -> Done:
    """Do a task on a worker, once it is sure to see what the caller sees.

    Raises:
        UserError: it doesn't.
    """
    if task.version != VERSION:
        raise UserError(f"a worker has cape {VERSION}, the batch is of {task.version}")
    if not Path(task.place).is_dir():
        raise FileError(f"a worker does not see the folder {task.place}: workers need the same files as the caller")
    try:
        seen = Path(task.folder, MARK).read_text()
    except OSError:
        seen = ""
    if seen != mark:
        raise FileError(f"a worker does not see the folder {task.folder}: it must be on a file system that all share")
    return work(task, lambda: False)


def _connected(cluster: Cluster) -> Any:
    from distributed import Client, Security

    security = None
    if cluster.address.startswith(ENCRYPTED):
        security = Security(
            tls_ca_file=str(cluster.ca),
            tls_client_cert=str(cluster.cert),
            tls_client_key=str(cluster.key),
            require_encryption=True,
        )
    try:
        return Client(cluster.address, security=security, timeout=WAIT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UserError(f"no scheduler answers at {cluster.address}: {str(error).splitlines()[0]}") from error


def _error(future: Any) -> str | None:
    """Why a task was not done; None where it was."""
    from distributed import KilledWorker

    error = future.exception()
    if error is None or isinstance(error, UserError):
        return None if error is None else str(error)
    if isinstance(error, KilledWorker):
        return "its workers were lost, one after the other"
    return f"{type(error).__name__}: {error}"
