"""`python -m pytest -p tests.harness.workers --workers 2`: processes that share the collected files.

The tests are collected once, and then the process forks; each worker of pytest-xdist collects all of them again, which
costs more than most files of tests. A worker takes the next file when it has ended one, so fixtures of a module are set
up once.
"""

import multiprocessing
import os
from collections import defaultdict
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait

import pytest

NUMBER_BYTES = 2


def pytest_addoption(parser):
    parser.addoption("--workers", type=int, default=1, help="processes that share the files")


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session):
    """Run the tests in workers and report what they report."""
    count = session.config.getoption("workers")
    if count < 2 or session.testsfailed or session.config.option.collectonly:
        return None  # as without this plugin
    by_file = defaultdict(list)
    for item in session.items:
        by_file[item.path].append(item)
    files = list(by_file.values())
    # Numbers of the files; whoever reads one has taken it.
    left, all_files = os.pipe()
    os.write(all_files, b"".join(n.to_bytes(NUMBER_BYTES) for n in range(len(files))))
    os.close(all_files)
    session.config._tmp_path_factory.getbasetemp()  # the workers' folders are in one that is kept as usual
    fork = multiprocessing.get_context("fork")
    workers = {}
    for number in range(min(count, len(files))):
        ours, theirs = fork.Pipe(duplex=False)
        worker = fork.Process(target=_work, args=(session, files, left, theirs, number))
        worker.start()
        theirs.close()
        workers[ours] = worker
    try:
        _report(session, workers)
    finally:
        for worker in workers.values():
            worker.terminate()
            worker.join()
    return True


def _report(session: pytest.Session, workers: dict[Connection, multiprocessing.Process]) -> None:
    """Pass on the reports of the workers until all have ended.

    Raises:
        session.Interrupted: If one ended in the middle of a test.
        session.Failed: If more tests have failed than are allowed (`--maxfail`).
    """
    hook = session.config.hook
    running = dict.fromkeys(workers, "nothing yet")
    while running:
        for pipe in wait(list(running)):
            try:
                said = pipe.recv()
            except EOFError:
                workers[pipe].join()
                code = workers[pipe].exitcode
                raise session.Interrupted(
                    f"a worker ended with code {code} in {running[pipe]}"
                ) from None
            if said is None:
                del running[pipe]
            elif isinstance(said, str):
                running[pipe] = said
            else:
                report = hook.pytest_report_from_serializable(config=session.config, data=said)
                hook.pytest_runtest_logreport(report=report)
            if session.shouldfail:
                raise session.Failed(session.shouldfail)


class Reporter:
    """Sends from a worker which test begins, and the reports of its set-up, call and teardown."""

    def __init__(self, config, pipe):
        self.config = config
        self.pipe = pipe

    def pytest_runtest_logstart(self, nodeid):
        self.pipe.send(nodeid)

    def pytest_runtest_logreport(self, report):
        self.pipe.send(
            self.config.hook.pytest_report_to_serializable(config=self.config, report=report)
        )


def _work(session, files, left, pipe, number):
    """Run files of tests until none is left."""
    os.environ["PYTEST_XDIST_WORKER"] = f"gw{number}"  # tests.harness.ports
    plugins = session.config.pluginmanager
    capture = plugins.getplugin("capturemanager")
    capture.stop_global_capturing()  # into a file that all workers would share
    capture.start_global_capturing()
    capture.suspend_global_capture()
    plugins.unregister(name="terminalreporter")
    plugins.register(Reporter(session.config, pipe))
    item = None
    for following in _taken(files, left):
        if item is not None:
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        item = following
    if item is not None:
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
    pipe.send(None)


def _taken(files: list[list[pytest.Item]], left: int) -> Iterator[pytest.Item]:
    """Yield the tests of each file that this worker takes."""
    while number := os.read(left, NUMBER_BYTES):
        yield from files[int.from_bytes(number)]
