"""Who computes the chunks: this process, processes on this machine, or the workers of a Dask cluster."""

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final, NamedTuple, Protocol

from guidance.errors import ConfigError, LinkError
from guidance.extras import require
from guidance.sweeps.chunk import computed, nothing_collected
from guidance.sweeps.plan import Plan

CONNECT_S = 10.0
_AHEAD: Final = 3
"""Chunks handed out for each worker: enough to keep it busy, few enough to hold."""

_DEATHS: Final = 5
"""So many workers may die of one chunk before the sweep gives up on it."""

_LOOK_S: Final = 0.5
"""So often it is looked at what the workers have played."""

_SPAWN: Final = multiprocessing.get_context("spawn")

Played = Callable[[int], None]


def _unheard(_: int) -> None:
    """For who need not know."""


Chunk = tuple[int, range]
"""A chunk's number and its rows."""


class Done(NamedTuple):
    """A chunk that has been computed: its number, and its file's bytes."""

    chunk: int
    content: bytes


class Executor(Protocol):
    """Computes chunks, in any order."""

    def work(self, plan: Plan, chunks: Iterable[Chunk]) -> Iterator[Done]:
        """Yield every chunk, given by number and rows, as soon as it is done.

        Raises:
            GuidanceError: If a chunk cannot be computed.
        """


class SerialExecutor:
    """This process, one chunk after the other.

    Args:
        played: Is told of games that have ended, within a chunk too.
    """

    def __init__(self, played: Played = _unheard) -> None:
        self._played = played

    def work(self, plan: Plan, chunks: Iterable[Chunk]) -> Iterator[Done]:
        """See `Executor`."""
        for chunk, rows in chunks:
            yield Done(chunk, computed(plan, rows, lambda: self._played(1)))


class ProcessExecutor:
    """Processes on this machine. A chunk whose worker dies is computed again by another; nobody listens on a port.

    Args:
        workers: How many.
        played: Is told of games that have ended, within a chunk too.
    """

    def __init__(self, workers: int, played: Played = _unheard) -> None:
        self._workers = workers
        self._played = played
        self._told = 0
        self._ended: Any = _SPAWN.Value("q", 0)
        self._pool = self._started()

    def work(self, plan: Plan, chunks: Iterable[Chunk]) -> Iterator[Done]:
        """See `Executor`."""
        waiting, again = iter(chunks), deque[Chunk]()
        running: dict[Future[bytes], Chunk] = {}
        deaths: Counter[int] = Counter()
        while True:
            while len(running) < _AHEAD * self._workers:
                chunk = again.popleft() if again else next(waiting, None)
                if chunk is None:
                    break
                running[self._submitted(plan, chunk[1])] = chunk
            if not running:
                return
            finished, _ = wait(running, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            self._tell()
            lost = []
            for future in finished:
                chunk = running.pop(future)
                try:
                    yield Done(chunk[0], future.result())
                except BrokenProcessPool:
                    lost.append(chunk)
            if lost:  # one worker's death breaks the pool: what all were at is begun again
                again.extend([*lost, *running.values()])
                running.clear()
                deaths.update(chunk for chunk, _ in lost)
                _refuse_deadly(deaths)
                self._pool.shutdown(wait=True)
                self._pool = self._started()

    def close(self) -> None:
        """End the workers, whatever they are at."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()

    def _submitted(self, plan: Plan, rows: range) -> Future[bytes]:
        """Hand a chunk out; where a worker has died since we looked, it comes back as those that are out do."""
        try:
            return self._pool.submit(_computed, plan, rows)
        except BrokenProcessPool as error:
            failed: Future[bytes] = Future()
            failed.set_exception(error)
            return failed

    def _started(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._workers, mp_context=_SPAWN, initializer=_begin_worker, initargs=(self._ended,))

    def _tell(self) -> None:
        news, self._told = self._ended.value - self._told, self._ended.value
        if news:
            self._played(news)


_ended: Any = None
"""In a worker: counts the games that have ended in any of them."""


def _computed(plan: Plan, rows: range) -> bytes:
    return computed(plan, rows, _count)


def _count() -> None:
    with _ended.get_lock():
        _ended.value += 1


def _begin_worker(ended: Any) -> None:  # noqa: ANN401 - a number that processes share
    """In a worker: Ctrl-C is handled by its parent, and it ends with its parent, however that ends."""
    global _ended  # noqa: PLW0603 - set once, before the worker's first chunk
    _ended = ended
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _refuse_deadly(deaths: Counter[int]) -> None:
    for chunk, count in deaths.items():
        if count >= _DEATHS:
            raise LinkError(f"chunk {chunk} ended {_DEATHS} workers; if they ran out of memory, use a smaller --chunk")


class ClusterExecutor:
    """The workers of a Dask cluster. A chunk whose worker is lost is computed again by another."""

    def __init__(self, client: Any) -> None:  # noqa: ANN401 - distributed has no types of its own
        self._client = client

    def work(self, plan: Plan, chunks: Iterable[Chunk]) -> Iterator[Done]:
        """See `Executor`."""
        from distributed import as_completed  # noqa: PLC0415 - as below

        waiting = iter(chunks)
        ahead = _AHEAD * max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
        numbers: dict[str, int] = {}

        def hand_out(count: int) -> list[Any]:
            futures = []
            for chunk, rows in islice(waiting, count):
                future = self._client.submit(
                    computed, plan, rows, pure=False, retries=0, key=f"chunk-{chunk}-{plan.digest[:12]}"
                )
                numbers[future.key] = chunk
                futures.append(future)
            return futures

        running = as_completed(hand_out(ahead))
        for future in running:
            chunk = numbers.pop(future.key)
            content = _result(future, chunk)
            future.release()
            running.update(hand_out(1))
            yield Done(chunk, content)


def workers_by_default() -> int:
    """Return as many as there are processors."""
    return os.cpu_count() or 1


@contextmanager
def executor(workers: int, scheduler: str | None, played: Played = _unheard) -> Iterator[Executor]:
    """Start an executor, and end it.

    Args:
        workers: Processes on this machine; 1 is this one.
        scheduler: Address of a Dask cluster in place of them; with tls:// the certificates are those of Dask's
            configuration (`distributed.comm.tls`).
        played: Is told of games that have ended within a chunk, by this machine's workers.

    Raises:
        ConfigError: If Dask is wanted and not installed, or TLS without certificates.
        LinkError: If the cluster cannot be reached, or does not trust us, or we do not trust it.
    """
    if scheduler is not None:
        with _client(scheduler) as client:
            yield ClusterExecutor(client)
        return
    if workers == 1:
        yield SerialExecutor(played)
        return
    processes = ProcessExecutor(workers, played)
    try:
        yield processes
    finally:
        processes.close()


def _client(scheduler: str) -> Any:  # noqa: ANN401
    require(f"--scheduler {scheduler}", "cluster")
    import dask  # noqa: PLC0415 - half a second, and nobody else needs it
    from distributed import Client  # noqa: PLC0415

    dask.config.set({"distributed.scheduler.allowed-failures": _DEATHS})
    try:
        with nothing_collected():  # a client that failed closes itself then, and waits for who starts a next
            client = Client(scheduler, timeout=CONNECT_S)
    except TypeError as error:  # so it says that it was given no certificates
        raise ConfigError(
            f"--scheduler {scheduler}: TLS wants a certificate; name its files in Dask's configuration, "
            f"distributed.comm.tls ca-file, client.cert and client.key ({error})"
        ) from error
    except (OSError, ValueError, AssertionError) as error:
        why = str(error) or "not by this protocol, tcp:// or tls://, and with these certificates"
        raise LinkError(f"--scheduler {scheduler}: no Dask scheduler answers there ({why})") from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        client.close()
        raise LinkError(
            f"--scheduler {scheduler}: it has no workers; start some with dask worker {scheduler}"
        ) from error
    return client


def _result(future: Any, chunk: int) -> bytes:  # noqa: ANN401
    from distributed.scheduler import KilledWorker  # noqa: PLC0415

    try:
        content: bytes = future.result()
    except KilledWorker as error:
        raise LinkError(
            f"chunk {chunk} ended {_DEATHS} workers; if they ran out of memory, use a smaller --chunk"
        ) from error
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"--scheduler: its workers lack a package ({error}); install pursuit-guidance there"
        ) from error
    return content
