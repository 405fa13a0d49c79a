"""Who computes the chunks: this process, or Dask's workers on this machine or on a cluster."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, NamedTuple, Protocol

from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.sweeps.chunk import computed
from guidance.sweeps.plan import Plan

CONNECT_S = 10.0
_AHEAD = 3
"""Chunks handed out for each worker: enough to keep it busy, few enough to hold."""

_DEATHS = 5
"""So many workers may die of one chunk before the sweep gives up on it."""


class Done(NamedTuple):
    """A chunk that has been computed: its number, and its file's bytes."""

    chunk: int
    content: bytes


class Crew(Protocol):
    """Computes chunks, in any order."""

    def work(self, plan: Plan, chunks: Iterable[tuple[int, range]]) -> Iterator[Done]:
        """Yield every chunk, given by number and rows, as soon as it is done."""


class Alone:
    """This process, one chunk after the other."""

    def work(self, plan: Plan, chunks: Iterable[tuple[int, range]]) -> Iterator[Done]:
        """See `Crew`."""
        for chunk, rows in chunks:
            yield Done(chunk, computed(plan, rows))


class Cluster:
    """The workers of a Dask cluster. A chunk whose worker is lost is computed again by another."""

    def __init__(self, client: Any) -> None:  # noqa: ANN401 - distributed has no types of its own
        self._client = client

    def work(self, plan: Plan, chunks: Iterable[tuple[int, range]]) -> Iterator[Done]:
        """See `Crew`.

        Raises:
            GuidanceError: If a chunk cannot be computed.
        """
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
def gathered(workers: int, scheduler: str | None) -> Iterator[Crew]:
    """Gather a crew, and send it home at the end.

    Args:
        workers: Processes on this machine; 1 is this one, without Dask.
        scheduler: Address of a cluster in place of them.

    Raises:
        LinkError: If the cluster cannot be reached.
    """
    if scheduler is None and workers == 1:
        yield Alone()
        return
    import dask  # noqa: PLC0415 - half a second, and one worker needs none of it
    from distributed import Client, LocalCluster  # noqa: PLC0415

    with dask.config.set({"distributed.scheduler.allowed-failures": _DEATHS}):
        if scheduler is not None:
            with _client(scheduler) as client:
                yield Cluster(client)
            return
        # Loopback only: scheduler, workers and what they serve.
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs=50,
        )
        with cluster, Client(cluster) as client:
            yield Cluster(client)


def _client(scheduler: str) -> Any:  # noqa: ANN401
    from distributed import Client  # noqa: PLC0415

    try:
        client = Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise LinkError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
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
        raise GuidanceError(
            f"chunk {chunk} ended {_DEATHS} workers; if they ran out of memory, use a smaller --chunk"
        ) from error
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"--scheduler: its workers lack a package ({error}); install pursuit-guidance there"
        ) from error
    return content
