"""`guidance sweep FILE`: compute the chunks that are missing in a folder, and write each as soon as it is done.

This process, processes on this machine and a Dask cluster are `concurrent.futures` executors, used in the same way.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any, Final, NoReturn

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.extras import require_extras
from guidance.screen import console, headed, redraws
from guidance.sweeps.folder import Folder, alone, begin_or_continue
from guidance.sweeps.rows import ChunkMade, code_here, computed, made, planned, uncollected

CONNECT_S = 10.0
_AHEAD: Final = 3
"""Chunks submitted for each worker."""
DEATHS: Final = 5
"""The sweep gives up when this many workers have died of one chunk."""

_LINE_S: Final = 10.0
"""Least time between two lines of progress where nothing can be redrawn."""


class Shown(Progress):
    """Progress on the terminal, a bar or a line now and then; call it with the number of rows that were just written.

    Args:
        folder: With missing chunks.
        unit: "games" or "flights".
    """

    def __init__(self, folder: Folder, unit: str) -> None:
        self.kept = self._before = folder.rows_there
        self._rows = folder.plan.rows
        self._unit = unit
        columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("{task.description}"))
        target = console(stderr=True)
        super().__init__(*columns, console=target, transient=True, disable=not redraws(target))
        self._task = self.add_task("", total=self._rows, completed=self.kept)
        self._begun_s = self._shown_s = time.monotonic()
        self._ending: BaseException | None = None

    def end(self, number: int, _frame: object = None) -> NoReturn:
        """Handle Ctrl-C and SIGTERM: raise here, and again after the chunk, because numpy may swallow this one.

        While numpy asks an object whether it is an array, it clears every exception, also one of a signal handler.
        """
        interrupted = number == signal.SIGINT
        self._ending = KeyboardInterrupt() if interrupted else SystemExit(128 + number)
        raise self._ending

    def __call__(self, rows: int) -> None:
        """Count rows, and show them if it is time."""
        self.kept += rows
        if self._ending is not None:
            raise self._ending
        now_s = time.monotonic()
        rows_done = self.kept - self._before
        rate = rows_done / max(1e-9, now_s - self._begun_s)
        text = ""
        if rows_done:
            left_s = round((self._rows - self.kept) / rate)
            time_left = timedelta(seconds=left_s)
            text = f"{rate:.3g} {self._unit}/s, {time_left} left"
        self.update(self._task, completed=self.kept, description=text)
        if self.disable and now_s - self._shown_s >= _LINE_S:
            self._shown_s = now_s
            line = f"{self.kept} of {self._rows} {self._unit}"
            if text:
                line += f", {text}"
            self.console.print(line)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def cluster_client(scheduler: str) -> Any:  # noqa: ANN401 - distributed has no types
    """Return a client of a Dask scheduler.

    Raises:
        ConfigError: If the extra is not installed, or nothing answers at the address.
    """
    require_extras(f"--scheduler {scheduler}", "cluster")
    import dask  # noqa: PLC0415 - takes half a second
    from distributed import Client  # noqa: PLC0415

    dask.config.set({"distributed.scheduler.allowed-failures": DEATHS})
    # Dask logs the tracebacks of lost connections; the sweep reports their effect once, at the end.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        # A failed client that is collected here waits for the lock that this call holds
        with uncollected():
            client = Client(scheduler, timeout=CONNECT_S)
    except TypeError as error:  # raised by Dask without certificates
        remedy = "name its files in Dask's configuration, distributed.comm.tls ca-file, client.cert and client.key"
        raise ConfigError(
            f"--scheduler {scheduler}: TLS needs a certificate; {remedy} ({error})"
        ) from error
    except (OSError, ValueError, AssertionError) as error:
        reason = str(error)
        if not reason:
            reason = "check the protocol, tcp:// or tls://, and the certificates"
        raise LinkError(
            f"--scheduler {scheduler}: no answer from a Dask scheduler ({reason})"
        ) from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        client.close()
        raise LinkError(
            f"--scheduler {scheduler}: has no workers; start some: dask worker {scheduler}"
        ) from error
    return client


def finish(
    folder: Folder,
    on_kept: Callable[[int], None],
    *,
    workers: int = 1,
    scheduler: str | None = None,
) -> None:
    """Compute and write the missing chunks.

    Args:
        folder: With missing chunks.
        on_kept: Called with the number of rows that were just written, also with 0 while waiting.
        workers: Number of processes on this machine; 1 is this process.
        scheduler: Address of a Dask scheduler instead. With tls:// the certificates are those of Dask's configuration
            (`distributed.comm.tls`).

    Raises:
        ConfigError: If Dask is not installed, certificates are missing, or a worker has other code than this process.
        LinkError: If the cluster cannot be reached, refuses our certificate, or stops answering.
        OutputError: If a chunk cannot be written; earlier chunks are kept.
        GuidanceError: If a chunk cannot be computed.
    """
    if scheduler is not None:
        with cluster_client(scheduler) as client:
            size = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
            start = partial(client.get_executor, pure=False, retries=0)
            try:
                _play_in_processes(folder, on_kept, size, start)
            except (CancelledError, OSError, TimeoutError) as error:
                remedy = "earlier rows are kept: run the same command to continue"
                raise LinkError(
                    f"--scheduler {scheduler}: the Dask scheduler stopped answering ({type(error).__name__}); {remedy}"
                ) from error
    elif workers > 1:
        spawn = {"mp_context": multiprocessing.get_context("spawn"), "initializer": _begin_worker}
        _play_in_processes(folder, on_kept, workers, partial(ProcessPoolExecutor, workers, **spawn))
    else:
        for chunk in folder.missing:
            rows = folder.rows(chunk)
            folder.keep(chunk, computed(folder.plan, rows))
            on_kept(len(rows))


def _play_in_processes(
    folder: Folder, on_kept: Callable[[int], None], size: int, start: Callable[[], Executor]
) -> None:
    pending = deque(folder.missing)
    deaths = Counter[int]()
    while pending:
        executor = start()
        running = dict[Future[ChunkMade], int]()
        try:
            while pending or running:
                while pending and len(running) < _AHEAD * size:
                    rows = folder.rows(pending[0])
                    future = executor.submit(made, folder.plan, rows)
                    running[future] = pending.popleft()
                finished = wait(running, timeout=0.5, return_when=FIRST_COMPLETED).done
                for future in finished:
                    chunk = running[future]
                    folder.keep(chunk, _content(future, chunk))
                    del running[future]
                    on_kept(len(folder.rows(chunk)))
                on_kept(0)
        except BrokenExecutor:
            # The death of one worker breaks the pool: repeat everything that was running
            deaths.update(running.values())
            if max(deaths.values(), default=0) >= DEATHS:
                raise _deadly(deaths.most_common(1)[0][0]) from None
            pending.extendleft(running.values())
            running.clear()
        finally:
            executor.shutdown(wait=not running)
            for process in multiprocessing.active_children():
                process.terminate()


def _content(future: Future[ChunkMade], chunk: int) -> bytes:
    """Return a chunk, or raise its error with a remedy for the user.

    Every chunk says which code made it: a worker may join, or be replaced, at any time.
    """
    try:
        chunk_made = future.result()
    except (ModuleNotFoundError, AttributeError) as error:
        remedy = "install this version of pursuit-guidance there"
        raise ConfigError(
            f"--scheduler: a worker lacks a package or a part of it ({error}); {remedy}"
        ) from error
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # Dask's
            raise _deadly(chunk) from error
        raise
    own_code = code_here()
    if chunk_made.code != own_code:
        words = []
        for name, own_version in own_code.items():
            version = chunk_made.code.get(name)
            if version != own_version:
                words.append(f"{name} {version}, here {own_version}")
        raise ConfigError(
            f"--scheduler: a worker has other code ({'; '.join(words)}), so its rows could differ and are not kept; "
            "install this version there, then run the same command to continue"
        )
    return chunk_made.content


def _deadly(chunk: int) -> GuidanceError:
    return LinkError(
        f"chunk {chunk} ended {DEATHS} workers; if they ran out of memory, use a smaller --chunk"
    )


def run_sweep(
    name: str,
    *,
    way: str | None,
    workers: int | None,
    scheduler: str | None,
    out: Path | None,
    chunk: int | None,
) -> Path:
    """Run a sweep, or continue it; return its folder.

    Args:
        name: A file, or the name of a sweep that comes with the package.
        way: Overrides the file's.
        workers: Number of processes; default: number of processors.
        scheduler: Address of a Dask scheduler, used instead of processes.
        out: The folder; default: named after the sweep.
        chunk: Rows in one file; None chooses.

    Raises:
        GuidanceError: For everything that the user can correct.
    """
    begun_s = time.monotonic()
    target = console(stderr=True)
    plan = planned(name, way)
    stem = Path(name).stem
    path = Path("sweeps") / f"{stem}-{plan.way}" if out is None else out
    unit = "games" if plan.way == "maths" else "flights"
    count = os.cpu_count()
    processors = 1 if count is None else count
    size = workers if workers is not None else processors
    title = plan.title if plan.title else stem
    with alone(path):
        target.print(headed(title, f": {plan.rows} {unit}"))
        folder = begin_or_continue(path, plan, chunk, size)
        count = len(folder.missing)
        if folder.rows_there:
            target.print(f"{folder.rows_there} of them are there already")
        if not count:
            return path
        size = min(size, count)
        location = f"in {size} processes"
        if size == 1:
            location = "in this process"
        if scheduler is not None:
            location = f"on the cluster at {scheduler}"
        target.print(f"{count} chunks of {folder.chunk_rows}, {location}")
        with contextlib.ExitStack() as restored, Shown(folder, unit) as progress:
            for number in (signal.SIGINT, signal.SIGTERM):
                restored.callback(signal.signal, number, signal.signal(number, progress.end))
            try:
                finish(folder, progress, workers=size, scheduler=scheduler)
            except KeyboardInterrupt:
                rows_kept = (
                    f"{progress.kept} of {plan.rows} rows are kept"
                    if progress.kept
                    else "no rows were written yet"
                )
                raise KeyboardInterrupt(
                    f"interrupted: {rows_kept}; run the same command to continue"
                ) from None
        took_s = time.monotonic() - begun_s
        rows = plan.rows - folder.rows_there
        rate = rows / took_s
        target.print(f"{rows} {unit} in {took_s:.1f} s, {rate:.3g} per second")
    return path
