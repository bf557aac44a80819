"""Batches by the workers of a scheduler on this machine, in plain and encrypted, one of which is killed."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.commands.batch.test_runs import COARSE
from tests.support.command import CAPE, cape

HOPELESS = 180.0  # s
CLIPS = ("walk", "run", "idle", "jump")

pytestmark = pytest.mark.extra


@pytest.fixture(autouse=True)
def _distributed() -> None:
    pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'cape[cluster]'")


@contextmanager
def running(*command: str, folder: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A dask command for the time of the block."""
    with (folder / f"{command[0]}-{time.monotonic_ns()}.log").open("wb") as said:
        process = subprocess.Popen([sys.executable, "-m", "dask", *command], cwd=folder, stdout=said, stderr=said)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def certificates(folder: Path) -> list[str]:
    """One self-signed certificate for everybody; gives dask's options for it."""
    command = ("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", "/CN=cape",
               "-keyout", "key.pem", "-out", "cert.pem")  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return ["--tls-ca-file", "cert.pem", "--tls-cert", "cert.pem", "--tls-key", "key.pem"]


@pytest.mark.parametrize("kind", ["tcp", "tls"])
def test_workers_do_the_runs_and_a_lost_one_is_made_up_for(kind: str, tmp_path: Path):
    address, secured = f"{kind}://127.0.0.1:{free_port()}", certificates(tmp_path) if kind == "tls" else []
    common = ("--host", "127.0.0.1", "--no-dashboard", *secured)
    with ExitStack() as stack:
        begin = lambda *command: stack.enter_context(running(*command, *common, folder=tmp_path))  # noqa: E731
        begin("scheduler", "--port", address.rpartition(":")[2], "--protocol", kind)
        workers = [begin("worker", address, "--nthreads", "1", "--no-nanny") for _ in range(2)]
        own = ["--tls-ca", "cert.pem", "--tls-cert", "cert.pem", "--tls-key", "key.pem"] if secured else []
        batch = subprocess.Popen(
            [CAPE, "batch", *CLIPS, "-o", "out", *COARSE, "--cluster", address, *own],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert batch.stderr is not None
        for line in batch.stderr:
            if line.startswith("1 of 4"):
                os.kill(workers[0].pid, signal.SIGKILL)
        assert batch.wait(HOPELESS) == 0
        found = json.loads((tmp_path / "out" / "results.json").read_text())
        assert (found["done"], [run["clip"] for run in found["runs"]]) == (4, list(CLIPS))
        again = cape("batch", *CLIPS, "-o", "out", *COARSE, "--cluster", address, *own, folder=tmp_path)
        assert again.stderr == "4 of 4 stand complete already\n"


def test_a_scheduler_that_is_not_there_is_told(tmp_path: Path):
    done = cape("batch", "walk", "-o", "out", "--cluster", f"tcp://127.0.0.1:{free_port()}", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("cape: no scheduler answers at tcp://127.0.0.1:")
    assert done.stderr.count("\n") == 1
