"""A scheduler, its workers and an S3-compatible server on loopback, to be killed and started again."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

_PATIENCE_S = 60.0


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


def wait_for(port: int) -> None:
    """Wait until somebody listens."""
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)
        else:
            return


class LoopbackCluster:
    """A Dask scheduler and workers as separate processes, as on a cluster; a context manager."""

    def __init__(
        self,
        folder: Path,
        n_workers: int = 2,
        *,
        environment: dict[str, str] | None = None,
        options: Sequence[str] = (),
    ) -> None:
        self._folder, self._n_workers, self._options = folder, n_workers, options
        self._environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **(environment or {})}
        self._port = free_port()
        self._scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    @property
    def address(self) -> str:
        """What --scheduler takes."""
        return f"tcp://127.0.0.1:{self._port}"

    def __enter__(self) -> LoopbackCluster:
        self._folder.mkdir(parents=True, exist_ok=True)
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start scheduler and workers, which find each other."""
        self._scheduler = self._process(
            "distributed.cli.dask_scheduler",
            *("--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard", "--no-show"),
        )
        wait_for(self._port)
        for _ in range(self._n_workers):
            self.add_worker()

    def add_worker(self) -> None:
        """Start one more worker: a process without a nanny, so that killing it kills it."""
        self.workers.append(
            self._process(
                "distributed.cli.dask_worker",
                *(self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"),
                *("--local-directory", str(self._folder), *self._options),
            )
        )

    def kill_worker(self) -> None:
        """Kill the oldest worker as the kernel does it where memory is short, and start another."""
        victim = self.workers.pop(0)
        victim.send_signal(signal.SIGKILL)
        victim.wait()
        self.add_worker()

    def restart(self) -> None:
        """Kill the scheduler; the workers go with it, and a supervisor starts all of them again."""
        self.kill()
        time.sleep(1.0)
        self.start()

    def kill(self) -> None:
        """Kill whatever runs."""
        running = [*self.workers, *([self._scheduler] if self._scheduler else [])]
        for process in running:
            process.kill()
        for process in running:
            process.wait()
        self.workers, self._scheduler = [], None

    def _process(self, module: str, *arguments: str) -> subprocess.Popen[bytes]:
        with (self._folder / "cluster.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                env=self._environment,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )


@contextlib.contextmanager
def s3_server(folder: Path, bucket: str) -> Iterator[dict[str, str]]:
    """Serve the files of a folder as a bucket; gives the environment by which fsspec finds it."""
    port = free_port()
    environment = {
        "AWS_ACCESS_KEY_ID": "loopback",
        "AWS_SECRET_ACCESS_KEY": "loopback",
        "AWS_DEFAULT_REGION": "us-east-1",
        "FSSPEC_S3_ENDPOINT_URL": f"http://127.0.0.1:{port}",
    }
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        env={**os.environ, **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        wait_for(port)
        _upload(folder, bucket, environment)
        yield environment
    finally:
        server.kill()
        server.wait()


def _upload(folder: Path, bucket: str, environment: dict[str, str]) -> None:
    """Put every file of the folder into a new bucket."""
    import boto3

    client = boto3.client(
        "s3",
        endpoint_url=environment["FSSPEC_S3_ENDPOINT_URL"],
        region_name="us-east-1",
        aws_access_key_id="loopback",
        aws_secret_access_key="loopback",
    )
    client.create_bucket(Bucket=bucket)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            client.upload_file(str(path), bucket, path.relative_to(folder).as_posix())
