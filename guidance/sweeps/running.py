"""`guidance sweep FILE`: compute the chunks that are missing in a folder, and write each as soon as it is done.

This process, processes on this machine and a Dask cluster are `concurrent.futures` executors, used in the same way.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from guidance.errors import ConfigError, GuidanceError, LinkError
from guidance.extras import require
from guidance.screen import console, redraws
from guidance.sweeps.folder import Folder, alone, opened
from guidance.sweeps.plan import Plan, Way
from guidance.sweeps.rows import computed, planned, refuse_without_games, uncollected

CONNECT_S = 10.0
_SHOW_S: Final = 0.5
_AHEAD: Final = 3
"""Chunks submitted for each worker."""
_DEATHS: Final = 5
"""The sweep gives up when this many workers have died of one chunk."""

_UNITS: Final[dict[Way, str]] = {"maths": "games", "fast": "flights"}

_LINE_S: Final = 10.0
"""Least time between two lines of progress where nothing can be redrawn."""


class Work(NamedTuple):
    """Work in a folder: the missing chunks, and the number of rows already there."""

    folder: Folder
    missing: list[int]
    rows_there: int


class Shown:
    """Progress on the terminal, a bar or a line now and then; call it with the number of rows that were just written.

    Args:
        work: The folder and its missing chunks.
        unit: "games" or "flights".
    """

    def __init__(self, work: Work, unit: str) -> None:
        self.kept = self._before = work.rows_there
        self._rows, self._unit = work.folder.plan.rows, unit
        self._there = console(stderr=True)
        columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("{task.description}"))
        self.bar = Progress(*columns, console=self._there, transient=True, disable=not redraws(self._there))
        self._task = self.bar.add_task("", total=self._rows, completed=self.kept)
        self._begun_s = self._shown_s = time.monotonic()

    def __call__(self, rows: int) -> None:
        """Count rows, and show them if it is time."""
        self.kept += rows
        now_s, done = time.monotonic(), self.kept - self._before
        rate = done / max(1e-9, now_s - self._begun_s)
        left = timedelta(seconds=round((self._rows - self.kept) / rate)) if done else None
        text = f"{rate:.3g} {self._unit}/s, {left} left" if done else ""
        self.bar.update(self._task, completed=self.kept, description=text)
        if self.bar.disable and now_s - self._shown_s >= _LINE_S:
            self._shown_s = now_s
            self._there.print(f"{self.kept} of {self._rows} {self._unit}{', ' if text else ''}{text}")


class Workers(NamedTuple):
    """A function that starts an executor, and the number of chunks to submit ahead."""

    start: Callable[[], Executor]
    ahead: int


class ThisProcess(Executor):
    """Runs a call when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401 - any call
        """Run it; the future is done."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


SERIAL: Final = Workers(ThisProcess, 1)


@contextmanager
def workers_of(count: int, scheduler: str | None) -> Iterator[Workers]:
    """Connect to a cluster, or prepare processes on this machine; end them afterwards.

    Args:
        count: Number of processes; 1 is this process.
        scheduler: Address of a Dask scheduler instead. With tls:// the certificates are those of Dask's configuration
            (`distributed.comm.tls`).

    Raises:
        ConfigError: If Dask is not installed, or certificates are missing.
        LinkError: If the cluster cannot be reached, or refuses our certificate.
    """
    if scheduler is not None:
        with _client(scheduler) as client:
            size = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
            yield Workers(lambda: client.get_executor(pure=False, retries=0), _AHEAD * size)
    elif count == 1:
        yield SERIAL
    else:
        spawn = multiprocessing.get_context("spawn")
        yield Workers(lambda: ProcessPoolExecutor(count, mp_context=spawn, initializer=_begin_worker), _AHEAD * count)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _client(scheduler: str) -> Any:  # noqa: ANN401 - distributed has no types
    require(f"--scheduler {scheduler}", "cluster")
    import dask  # noqa: PLC0415 - takes half a second
    from distributed import Client  # noqa: PLC0415

    dask.config.set({"distributed.scheduler.allowed-failures": _DEATHS})
    try:
        with uncollected():  # a failed client that is collected here waits for the lock that this call holds
            client = Client(scheduler, timeout=CONNECT_S)
    except TypeError as error:  # raised by Dask without certificates
        raise ConfigError(
            f"--scheduler {scheduler}: TLS needs a certificate; name its files in Dask's configuration, "
            f"distributed.comm.tls ca-file, client.cert and client.key ({error})"
        ) from error
    except (OSError, ValueError, AssertionError) as error:
        reason = str(error) or "check the protocol, tcp:// or tls://, and the certificates"
        raise LinkError(f"--scheduler {scheduler}: no answer from a Dask scheduler ({reason})") from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        client.close()
        raise LinkError(f"--scheduler {scheduler}: has no workers; start some: dask worker {scheduler}") from error
    return client


def begun(plan: Plan, out: Path, chunk_rows: int | None, workers: int = 1) -> Work:
    """Begin a sweep's folder, or find its missing chunks.

    Args:
        plan: Of the sweep.
        out: The folder.
        chunk_rows: Rows of a chunk; None chooses.
        workers: Number of processes.

    Raises:
        ConfigError: If the folder belongs to another sweep, or all rows are invalid.
        OutputError: If it cannot be written.
    """
    refuse_without_games(plan)
    folder = opened(out, plan, chunk_rows, workers)
    missing = [chunk for chunk in range(folder.chunks) if not folder.has(chunk)]
    return Work(folder, missing, plan.rows - sum(len(folder.rows(chunk)) for chunk in missing))


def finish(work: Work, workers: Workers, on_kept: Callable[[int], None]) -> None:
    """Compute and write the missing chunks.

    Args:
        work: The folder and its missing chunks.
        workers: Compute the chunks.
        on_kept: Called with the number of rows that were just written, also with 0 while waiting.

    Raises:
        OutputError: If a chunk cannot be written; earlier chunks are kept.
        GuidanceError: If a chunk cannot be computed.
    """
    folder, pending, deaths = work.folder, deque(work.missing), Counter[int]()
    while pending:
        executor, running = workers.start(), dict[Future[bytes], int]()
        try:
            while pending or running:
                while pending and len(running) < workers.ahead:
                    future = executor.submit(computed, folder.plan, folder.rows(pending[0]))
                    running[future] = pending.popleft()
                for future in wait(running, timeout=_SHOW_S, return_when=FIRST_COMPLETED).done:
                    folder.keep(running[future], _content(future, running[future]))
                    on_kept(len(folder.rows(running.pop(future))))
                on_kept(0)
        except BrokenProcessPool:  # the death of one worker breaks the pool: repeat everything that was running
            deaths.update(running.values())
            if max(deaths.values(), default=0) >= _DEATHS:
                raise _deadly(deaths.most_common(1)[0][0]) from None
            pending.extendleft(running.values())
            running.clear()
        finally:
            executor.shutdown(wait=not running)
            for process in multiprocessing.active_children():
                process.terminate()


def _content(future: Future[bytes], chunk: int) -> bytes:
    """Return a chunk, or say what the user can do about its error."""
    try:
        return future.result()
    except ModuleNotFoundError as error:
        missing = f"--scheduler: its workers lack a package ({error}); install pursuit-guidance there"
        raise ConfigError(missing) from error
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # Dask's
            raise _deadly(chunk) from error
        raise


def _deadly(chunk: int) -> GuidanceError:
    return LinkError(f"chunk {chunk} ended {_DEATHS} workers; if they ran out of memory, use a smaller --chunk")


def run_sweep(
    name: str, *, way: Way | None, workers: int | None, scheduler: str | None, out: Path | None, chunk: int | None
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
    there = console(stderr=True)
    plan = planned(name, way)
    path = out if out is not None else Path("sweeps") / f"{Path(name).stem}-{plan.way}"
    unit = _UNITS[plan.way]
    size = workers if workers is not None else os.cpu_count() or 1
    with alone(path):
        there.print(f"[bold]{plan.title or Path(name).stem}[/bold]: {plan.rows} {unit}")
        work = begun(plan, path, chunk, size)
        count = len(work.missing)
        if work.rows_there:
            there.print(f"{work.rows_there} of them are there already")
        if not count:
            return path
        size = min(size, count)
        there.print(f"{count} chunks of {work.folder.chunk_rows}, {_by(size, scheduler)}")
        begun_s = time.monotonic()
        progress = Shown(work, unit)
        with progress.bar, workers_of(size, scheduler) as working:
            try:
                finish(work, working, progress)
            except KeyboardInterrupt:
                raise Interrupted(progress.kept, plan.rows) from None
        took_s = time.monotonic() - begun_s
        rows = plan.rows - work.rows_there
        there.print(f"{rows} {unit} in {took_s:.1f} s, {rows / took_s:.3g} per second")
    return path


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, with a message about the rows that are kept."""

    def __init__(self, kept: int, rows: int) -> None:
        there = f"{kept} of {rows} rows are kept" if kept else "no rows were written yet"
        super().__init__(f"interrupted: {there}; run the same command to continue")


def _by(size: int, scheduler: str | None) -> str:
    if scheduler is not None:
        return f"on the cluster at {scheduler}"
    return "in this process" if size == 1 else f"in {size} processes"


def checked_way(text: str | None) -> Way | None:
    """Check the option --as.

    Raises:
        ConfigError: If it is neither maths nor fast.
    """
    if text is None or text in _UNITS:
        return text
    raise ConfigError(f"--as {text}: allowed are {', '.join(_UNITS)}; for real time use guidance scenario run")
