import contextlib
import errno
import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from guidance.cli.sweep import sweep as app
from guidance.errors import ConfigError, GuidanceError, LinkError, OutputError
from guidance.sweeps import folder, running
from guidance.sweeps.folder import alone, begin_or_continue, read_folder, write_whole
from guidance.sweeps.rows import ChunkMade, code_here, computed, planned
from guidance.sweeps.running import Shown, finish, run_sweep
from tests.sweeps.conftest import SWEEP

COMMAND = [sys.executable, "-c", "from guidance.cli import main; main()", "sweep"]


def run(plan, out, *, chunk=5, **by):
    finish(begin_or_continue(out, plan, chunk), lambda _: None, **by)
    return out


def files(at):
    return {part.name: part.read_bytes() for part in sorted(at.glob("rows/*.parquet"))}


def table(at):
    return parquet.read_table(at / "rows")


def test_the_rows_do_not_depend_on_the_chunks(plan_from, tmp_path):
    plan = plan_from()
    five = table(run(plan, tmp_path / "five"))
    all_in_one = table(run(plan, tmp_path / "one", chunk=100))
    for name in five.column_names:
        np.testing.assert_array_equal(
            five[name].to_pylist(), all_in_one[name].to_pylist(), err_msg=name
        )
    assert five["row"].to_pylist() == list(range(24))
    assert set(five["end"].to_pylist()) == {"captured"}


def test_a_sweep_that_stops_half_way_is_completed_with_equal_bytes(
    plan_from, tmp_path, monkeypatch
):
    class StopError(Exception):
        pass

    def mortal(plan, rows):
        if rows.start == 10:
            raise StopError
        return computed(plan, rows)

    plan = plan_from()
    monkeypatch.setattr(running, "computed", mortal)
    with pytest.raises(StopError):
        run(plan, tmp_path / "out")
    monkeypatch.undo()
    assert len(files(tmp_path / "out")) == 2
    work = begin_or_continue(tmp_path / "out", plan, None)
    assert (work.missing, work.rows_there) == ([2, 3, 4], 10)
    assert files(run(plan, tmp_path / "out", chunk=None)) == files(run(plan, tmp_path / "whole"))


@pytest.mark.flight
def test_a_killed_sweep_continues_with_the_missing_chunks(short, tmp_path):
    many = (short / "sweep.toml").read_text().replace("seeds = 6", "seeds = 15")
    (short / "sweep.toml").write_text(many)
    arguments = [
        *COMMAND,
        str(short / "sweep.toml"),
        "--workers",
        "1",
        "--chunk",
        "4",
        "--out",
        str(tmp_path / "out"),
    ]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline_s = time.monotonic() + 60.0
    while len(files(tmp_path / "out")) < 2 and time.monotonic() < deadline_s:
        time.sleep(0.01)
    process.kill()
    process.communicate()
    there = files(tmp_path / "out")
    assert 2 <= len(there) < 15
    plan = planned(str(short / "sweep.toml"))
    finish(begin_or_continue(tmp_path / "out", plan, None), lambda _: None)
    complete = files(tmp_path / "out")
    assert complete.items() >= there.items()
    assert complete == files(run(plan, tmp_path / "whole", chunk=4))


@pytest.mark.flight
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_with_its_exit_code_and_keeps_the_rows(short, tmp_path, number, code):
    (short / "sweep.toml").write_text(
        (short / "sweep.toml").read_text().replace("seeds = 6", "seeds = 500")
    )
    arguments = [
        *COMMAND,
        str(short / "sweep.toml"),
        "--workers",
        "1",
        "--chunk",
        "4",
        "--out",
        str(tmp_path / "out"),
    ]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline_s = time.monotonic() + 60.0
    while not files(tmp_path / "out") and time.monotonic() < deadline_s:
        time.sleep(0.01)
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert "Traceback" not in said
    assert all(
        parquet.read_metadata(part).num_rows == 4
        for part in (tmp_path / "out").glob("rows/*.parquet")
    )


def test_a_damaged_chunk_is_computed_again(plan_from, tmp_path):
    plan = plan_from()
    before = files(run(plan, tmp_path / "out"))
    part = tmp_path / "out" / "rows" / "part-000001.parquet"
    part.write_bytes(part.read_bytes()[:100])
    assert begin_or_continue(tmp_path / "out", plan, None).missing == [1]
    assert files(run(plan, tmp_path / "out", chunk=None)) == before


def test_a_full_disk_is_reported_and_earlier_rows_are_kept(plan_from, tmp_path, monkeypatch):
    plan = plan_from()
    work = begin_or_continue(tmp_path / "out", plan, 5)

    def fill_up(path, content):
        if path.name == "part-000002.parquet":
            raise OSError(errno.ENOSPC, "No space left on device")
        write_whole(path, content)

    monkeypatch.setattr(folder, "write_whole", fill_up)
    with pytest.raises(
        OutputError, match=r"part-000002\.parquet: cannot be written \(No space left on device\)"
    ) as caught:
        finish(work, lambda _: None)
    assert caught.value.exit_code == 5
    assert begin_or_continue(tmp_path / "out", plan, None).rows_there == 10


def test_a_file_that_cannot_be_completed_is_removed(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(tmp_path / "a.parquet", b"rows")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_another_sweep_is_refused_with_the_difference(plan_from, short, tmp_path):
    run(plan_from(), tmp_path / "out")
    (short / "short.toml").write_text((short / "short.toml").read_text().replace("7.0", "8.0"))
    with pytest.raises(ConfigError, match=r"holds another sweep \(scenario differs\)"):
        begin_or_continue(tmp_path / "out", plan_from(), None)
    with pytest.raises(ConfigError, match="scenario, as differ"):
        begin_or_continue(tmp_path / "out", plan_from(way="fast"), None)


def test_another_chunk_or_another_version_is_refused(plan_from, tmp_path):
    plan = plan_from()
    out = tmp_path / "out"
    run(plan, out)
    with pytest.raises(ConfigError, match="--chunk 6: this sweep was begun with 5"):
        begin_or_continue(out, plan, 6)
    manifest = json.loads((out / "sweep.json").read_text())
    manifest["versions"]["numpy"] = "1.0"
    (out / "sweep.json").write_text(json.dumps(manifest))
    with pytest.raises(ConfigError, match=r"was begun with numpy 1\.0, now"):
        begin_or_continue(out, plan, None)


def test_a_changed_description_continues_the_same_sweep(plan_from, short, tmp_path):
    run(plan_from(), tmp_path / "out")
    path = short / "sweep.toml"
    path.write_text('description = "Now with an explanation."\n' + path.read_text())
    assert begin_or_continue(tmp_path / "out", planned(str(path)), None).missing == []


def test_a_folder_with_other_files_is_refused(plan_from, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letters.txt").write_text("dear")
    with pytest.raises(ConfigError, match="has files but no sweep"):
        begin_or_continue(tmp_path / "out", plan_from(), None)
    with pytest.raises(ConfigError, match=r"not the folder of a sweep: it has no sweep\.json"):
        read_folder(tmp_path / "out")


def test_a_folder_that_cannot_be_made_is_an_output_error(plan_from, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        begin_or_continue(tmp_path / "file" / "out", plan_from(), None)


def test_only_one_process_writes_a_sweep(tmp_path):
    with (
        alone(tmp_path),
        pytest.raises(ConfigError, match="another process is writing"),
        alone(tmp_path),
    ):
        pass


def test_a_sweep_with_invalid_rows_only_is_refused_with_the_reason(plan_from, tmp_path):
    plan = plan_from('scenario = "short.toml"\n[grid]\n"evader.speed_m_s" = [6.0, 7.0]\n')
    with pytest.raises(ConfigError, match="all 2 rows of a sample are invalid") as caught:
        begin_or_continue(tmp_path / "out", plan, None)
    assert "must be above 1" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_one_worker_runs_in_this_process(plan_from, tmp_path, monkeypatch):
    monkeypatch.setattr(running, "computed", lambda *_: str(os.getpid()).encode())
    assert set(files(run(plan_from(), tmp_path / "out", workers=1)).values()) == {
        str(os.getpid()).encode()
    }


def test_a_missing_scheduler_is_a_link_error(plan_from, tmp_path, monkeypatch):
    """Catches a sweep that waits for a scheduler for ever."""
    monkeypatch.setattr(running, "CONNECT_S", 0.3)
    with pytest.raises(LinkError, match="no answer from a Dask scheduler"):
        run(plan_from(), tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@contextlib.contextmanager
def trusted_with(security):
    """Dask's configuration with these certificates, as a user's file or environment has it."""
    import dask

    ours = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    ours["client.key"] = security.tls_client_key
    with dask.config.set({f"distributed.comm.tls.{key}": value for key, value in ours.items()}):
        yield


def test_a_tls_cluster_needs_its_certificate_and_computes_equal_rows(
    plan_from, tmp_path, monkeypatch
):
    """Catches a cluster that is used without its certificate, or that computes other rows."""
    from distributed import (  # half a second, which collecting the tests need not take
        LocalCluster,
        Security,
    )

    plan = plan_from()
    ours = Security.temporary()
    forged = Security.temporary()
    cluster = LocalCluster(
        1, 1, processes=False, security=ours, protocol="tls", dashboard_address=None
    )
    with cluster:
        at = cluster.scheduler_address
        with pytest.raises(ConfigError, match="TLS needs a certificate"):
            run(plan, tmp_path / "by the cluster", scheduler=at)
        with (
            trusted_with(forged),
            pytest.raises(LinkError, match="no answer from a Dask scheduler"),
        ):
            run(plan, tmp_path / "by the cluster", scheduler=at)
        with trusted_with(ours):
            run(plan, tmp_path / "by the cluster", scheduler=at)
        monkeypatch.setattr(running, "CONNECT_S", 0.3)
        with pytest.raises(LinkError, match="no answer from a Dask scheduler"):
            run(plan, tmp_path / "in the clear", scheduler=at.replace("tls", "tcp"))
    assert files(tmp_path / "by the cluster") == files(run(plan, tmp_path / "alone"))


class OneFuture(Executor):
    """An executor whose only future is prepared; it stands for a cluster."""

    def __init__(self, future):
        self.future = future

    def submit(self, *_, **__):
        return self.future


def cluster_of(future, monkeypatch):
    """Let a sweep take this future for the answer of a Dask cluster with one worker."""
    client = SimpleNamespace(
        scheduler_info=lambda **_: {"workers": {"a": {}}},
        get_executor=lambda **_: OneFuture(future),
    )
    monkeypatch.setattr(running, "cluster_client", lambda scheduler: contextlib.nullcontext(client))


@pytest.mark.parametrize("name", ["source", "numpy"])
def test_rows_of_a_worker_with_other_code_are_refused(plan_from, tmp_path, monkeypatch, name):
    future = Future()
    future.set_result(ChunkMade(b"rows", {**code_here(), name: "other"}))
    cluster_of(future, monkeypatch)
    with pytest.raises(ConfigError, match=f"other code.*{name} other, here {code_here()[name]}"):
        run(plan_from(), tmp_path / "out", scheduler="tcp://127.0.0.1:1")
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_a_scheduler_that_dies_is_a_link_error_and_keeps_the_rows(plan_from, tmp_path, monkeypatch):
    future = Future()
    future.cancel()
    future.set_running_or_notify_cancel()
    cluster_of(future, monkeypatch)
    with pytest.raises(LinkError, match=r"stopped answering.*run the same command to continue"):
        run(plan_from(), tmp_path / "out", scheduler="tcp://127.0.0.1:1")


def test_garbage_collection_is_off_while_a_client_starts(plan_from, tmp_path, monkeypatch):
    """Collecting a failed client during the start of the next would wait for a lock that the start holds."""
    import distributed

    began = []

    def failing(*_, **__):
        began.append(gc.isenabled())
        raise OSError

    monkeypatch.setattr(distributed, "Client", failing)
    with pytest.raises(LinkError, match="no answer from a Dask scheduler"):
        run(plan_from(), tmp_path / "out", scheduler="tcp://127.0.0.1:1")
    assert began == [False]
    assert gc.isenabled()


def processes_of(process):
    """Its living processes that compute; Python starts another one that tracks resources."""
    found = []
    for one in process.children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it ended meanwhile
            if "spawn_main" in " ".join(one.cmdline()):
                found.append(one)
    return found


@pytest.mark.flight
def test_two_workers_give_equal_bytes_even_if_one_is_killed(plan_from, tmp_path):
    plan = plan_from()
    me = psutil.Process()
    expected = files(run(plan, tmp_path / "alone", chunk=3))
    work = begin_or_continue(tmp_path / "both", plan, 3)
    killed = []
    living = []
    sockets = []

    def kill_one(_rows):
        if not killed:
            killed.append(processes_of(me)[0].pid)
            os.kill(killed[0], signal.SIGKILL)
        living[:] = [one for one in processes_of(me) if one.pid not in killed]
        for process in (me, *living):
            with contextlib.suppress(psutil.Error):  # it ended meanwhile
                sockets.extend(process.net_connections("inet"))

    finish(work, kill_one, workers=2)
    assert killed
    assert [socket for socket in sockets if socket.status == psutil.CONN_LISTEN] == []
    assert files(tmp_path / "both") == expected
    assert psutil.wait_procs(living, timeout=10)[1] == []


def test_a_chunk_that_kills_every_worker_is_given_up(plan_from, tmp_path, monkeypatch):
    """A killed process is that of the test above: here only its trace is left, a future that says so."""
    pools = []

    def broken(workers, **_):
        future = Future()
        future.set_exception(BrokenProcessPool())
        pools.append(workers)
        assert len(pools) < 9
        return OneFuture(future)

    monkeypatch.setattr(running, "ProcessPoolExecutor", broken)
    with pytest.raises(GuidanceError, match="ended 5 workers"):
        run(plan_from(), tmp_path / "out", chunk=24, workers=2)
    assert pools == [2] * 5


@pytest.mark.parametrize(
    ("seeds", "way", "workers", "expected"),
    [
        (6, "maths", 1, 24),
        (6, "maths", 2, 3),
        (60000, "maths", 2, 4096),
        (6, "fast", 1, 1),
    ],
)
def test_several_workers_have_four_chunks_each(plan_from, tmp_path, seeds, way, workers, expected):
    """Catches chunks so large that a worker has nothing to do."""
    plan = plan_from(SWEEP.replace("seeds = 6", f"seeds = {seeds}"), way)
    assert begin_or_continue(tmp_path / "out", plan, None, workers).chunk_rows == expected


@pytest.mark.parametrize(
    ("number", "ending"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_signal_that_a_library_swallows_ends_the_sweep_after_the_chunk(
    short, tmp_path, monkeypatch, number, ending
):
    """numpy clears every exception while it asks an object whether it is an array."""

    def swallowing(plan, rows):
        if rows.start == 5:
            with contextlib.suppress(BaseException):
                signal.raise_signal(number)
        return computed(plan, rows)

    monkeypatch.setattr(running, "computed", swallowing)
    before = signal.getsignal(number)
    how = {"way": None, "workers": 1, "scheduler": None, "chunk": 5}
    with pytest.raises(ending):
        run_sweep(str(short / "sweep.toml"), out=tmp_path / "out", **how)
    assert len(files(tmp_path / "out")) == 2
    assert signal.getsignal(number) == before


@pytest.mark.parametrize(
    ("rows", "words"), [(0, "no rows were written yet"), (5, "5 of 24 rows are kept")]
)
def test_an_interruption_says_what_is_kept(short, tmp_path, monkeypatch, rows, words):
    def interrupted(_folder, on_kept, **_):
        on_kept(rows)
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "finish", interrupted)
    with pytest.raises(
        KeyboardInterrupt, match=f"interrupted: {words}; run the same command to continue"
    ):
        run_sweep(
            str(short / "sweep.toml"),
            way=None,
            workers=1,
            scheduler=None,
            out=tmp_path / "out",
            chunk=None,
        )


def test_progress_says_the_time_left_after_the_first_chunk(
    plan_from, tmp_path, monkeypatch, capsys
):
    now_s = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    monkeypatch.setenv("TERM", "dumb")
    progress = Shown(begin_or_continue(tmp_path / "out", plan_from(), 12), "games")
    for second, rows in ((5, 0), (15, 0), (25, 12), (35, 12)):
        now_s[0] = float(second)
        progress(rows)
    assert capsys.readouterr().err.splitlines() == [
        "0 of 24 games",
        "12 of 24 games, 0.48 games/s, 0:00:25 left",
        "24 of 24 games, 0.686 games/s, 0:00:00 left",
    ]


def test_the_printed_time_is_that_of_the_whole_command(short, tmp_path, monkeypatch, capsys):
    now_s = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])

    def begun_slowly(*args):
        now_s[0] += 38.0
        return begin_or_continue(*args)

    def finished(_folder, on_kept, **_):
        now_s[0] += 10.0
        on_kept(24)

    monkeypatch.setattr(running, "begin_or_continue", begun_slowly)
    monkeypatch.setattr(running, "finish", finished)
    how = {"way": None, "workers": 1, "scheduler": None, "chunk": None}
    run_sweep(str(short / "sweep.toml"), out=tmp_path / "out", **how)
    assert "24 games in 48.0 s, 0.5 per second" in capsys.readouterr().err


def test_the_command_prints_the_folder_and_continues_a_complete_sweep(short, tmp_path):
    out = tmp_path / "out"
    done = CliRunner().invoke(app, [str(short / "sweep.toml"), "--workers", "1", "--out", str(out)])
    assert done.exit_code == 0
    assert done.stdout.strip() == str(out)
    assert "24 games" in done.stderr
    again = CliRunner().invoke(
        app, ["--workers", "1", "--out", str(out), str(short / "sweep.toml")]
    )
    assert "24 of them are there already" in again.stderr


@pytest.mark.usefixtures("soon_up_and_down")
def test_a_fast_sweep_flies_its_rows_and_keeps_invalid_ones(short, tmp_path):
    """Catches a flown sweep that drops rows which allow no game."""
    shutil.copy(Path(__file__).parents[1] / "data" / "near_chase.toml", short)
    (short / "sweep.toml").write_text(
        'scenario = "near_chase.toml"\nas = "fast"\n[grid]\n"evader.speed_m_s" = [1.0, 7.0]\n'
    )
    rows = table(run(planned(str(short / "sweep.toml")), tmp_path / "out")).to_pylist()
    assert [row["end"] for row in rows] == ["captured", "invalid"]
    assert rows[0]["run"] == "fast"
    assert rows[0]["duration_s"] > rows[0]["game_time_s"] > 0.0
