import contextlib
import errno
import gc
import json
import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from guidance.cli.sweep import sweep as app
from guidance.errors import ConfigError, GuidanceError, LinkError, OutputError
from guidance.sweeps import chunk, executors
from guidance.sweeps.executors import ProcessExecutor, SerialExecutor, executor
from guidance.sweeps.folder import Folder, alone, opened, read_folder, write_whole
from guidance.sweeps.running import Interrupted, begun, finish, planned

COMMAND = [sys.executable, "-c", "from guidance.cli import main; main()", "sweep"]


def run(plan, out, *, chunk=5, by=None):
    finish(begun(plan, out, chunk), by or SerialExecutor(), lambda _: None)
    return out


def files(folder):
    return {part.name: part.read_bytes() for part in sorted(folder.glob("rows/*.parquet"))}


def table(folder):
    return parquet.read_table(folder / "rows")


def test_the_rows_are_the_same_in_any_chunks(plan_from, tmp_path):
    plan = plan_from()
    five, all_in_one = table(run(plan, tmp_path / "five")), table(run(plan, tmp_path / "one", chunk=100))
    assert five.equals(all_in_one)
    assert five["row"].to_pylist() == list(range(24))
    assert set(five["end"].to_pylist()) == {"captured"}


def test_an_executor_that_stops_half_way_leaves_whole_chunks_and_the_rest_is_the_same(plan_from, tmp_path):
    class KilledError(Exception):
        pass

    class Mortal(SerialExecutor):
        def work(self, plan, chunks):
            for number, done in enumerate(super().work(plan, chunks)):
                if number == 2:
                    raise KilledError
                yield done

    plan = plan_from()
    with pytest.raises(KilledError):
        run(plan, tmp_path / "out", by=Mortal())
    assert len(files(tmp_path / "out")) == 2
    work = begun(plan, tmp_path / "out", None)
    assert (work.missing, work.rows_there) == ([2, 3, 4], 10)
    assert files(run(plan, tmp_path / "out", chunk=None)) == files(run(plan, tmp_path / "whole"))


@pytest.mark.flight
def test_a_sweep_killed_without_warning_goes_on_where_it_was(short, tmp_path):
    many = (short / "sweep.toml").read_text().replace("seeds = 6", "seeds = 15")
    (short / "sweep.toml").write_text(many)
    arguments = [*COMMAND, str(short / "sweep.toml"), "--workers", "1", "--chunk", "4", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline_s = time.monotonic() + 60.0
    while len(files(tmp_path / "out")) < 2 and time.monotonic() < deadline_s:
        time.sleep(0.01)
    process.kill()
    process.communicate()
    there = files(tmp_path / "out")
    assert 2 <= len(there) < 15
    plan = planned(str(short / "sweep.toml"))
    finish(begun(plan, tmp_path / "out", None), SerialExecutor(), lambda _: None)
    complete = files(tmp_path / "out")
    assert complete.items() >= there.items()
    assert complete == files(run(plan, tmp_path / "whole", chunk=4))


@pytest.mark.flight
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_with_its_code_and_what_was_written_stays(short, tmp_path, number, code):
    (short / "sweep.toml").write_text((short / "sweep.toml").read_text().replace("seeds = 6", "seeds = 500"))
    arguments = [*COMMAND, str(short / "sweep.toml"), "--workers", "1", "--chunk", "4", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline_s = time.monotonic() + 60.0
    while not files(tmp_path / "out") and time.monotonic() < deadline_s:
        time.sleep(0.01)
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert "Traceback" not in said
    assert all(parquet.read_metadata(part).num_rows == 4 for part in (tmp_path / "out").glob("rows/*.parquet"))


def test_a_damaged_chunk_is_computed_again(plan_from, tmp_path):
    plan = plan_from()
    before = files(run(plan, tmp_path / "out"))
    part = tmp_path / "out" / "rows" / "part-000001.parquet"
    part.write_bytes(part.read_bytes()[:100])
    assert begun(plan, tmp_path / "out", None).missing == [1]
    assert files(run(plan, tmp_path / "out", chunk=None)) == before


def test_a_full_disk_is_named_and_what_was_written_is_kept(plan_from, tmp_path):
    plan = plan_from()
    work = begun(plan, tmp_path / "out", 5)

    def fill_up(path, content):
        if path.name == "part-000002.parquet":
            raise OSError(errno.ENOSPC, "No space left on device")
        write_whole(path, content)

    full = work._replace(folder=Folder(work.folder.path, plan, 5, fill_up))
    with pytest.raises(OutputError, match=r"part-000002\.parquet: cannot be written \(the disk is full\)") as caught:
        finish(full, SerialExecutor(), lambda _: None)
    assert caught.value.exit_code == 5
    assert begun(plan, tmp_path / "out", None).rows_there == 10


def test_a_file_that_cannot_be_written_whole_is_not_there_at_all(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(tmp_path / "a.parquet", b"rows")
    assert list(tmp_path.iterdir()) == []


def test_another_sweep_in_the_folder_is_refused_and_says_what_differs(plan_from, short, tmp_path):
    run(plan_from(), tmp_path / "out")
    (short / "short.toml").write_text((short / "short.toml").read_text().replace("7.0", "8.0"))
    with pytest.raises(ConfigError, match=r"holds another sweep \(scenario differs\)"):
        begun(plan_from(), tmp_path / "out", None)
    with pytest.raises(ConfigError, match="as, scenario differ"):
        begun(plan_from(way="fast"), tmp_path / "out", None)


def test_another_chunk_or_another_version_is_refused(plan_from, tmp_path):
    plan, out = plan_from(), tmp_path / "out"
    run(plan, out)
    with pytest.raises(ConfigError, match="--chunk 6: this sweep was begun with 5"):
        begun(plan, out, 6)
    manifest = json.loads((out / "sweep.json").read_text())
    manifest["versions"]["numpy"] = "1.0"
    (out / "sweep.json").write_text(json.dumps(manifest))
    with pytest.raises(ConfigError, match=r"was begun with numpy 1\.0, now"):
        begun(plan, out, None)


def test_other_words_about_a_sweep_make_it_no_other_sweep(plan_from, short, tmp_path):
    run(plan_from(), tmp_path / "out")
    path = short / "sweep.toml"
    path.write_text('description = "Now with an explanation."\n' + path.read_text())
    assert begun(planned(str(path)), tmp_path / "out", None).missing == []


def test_a_folder_of_something_else_is_refused(plan_from, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letters.txt").write_text("dear")
    with pytest.raises(ConfigError, match="holds files and no sweep"):
        opened(tmp_path / "out", plan_from(), None, lambda: 5)
    with pytest.raises(ConfigError, match=r"is no sweep's folder; it has no sweep\.json"):
        read_folder(tmp_path / "out")


def test_a_folder_that_cannot_be_made_is_an_output_error(plan_from, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        opened(tmp_path / "file" / "out", plan_from(), None, lambda: 5)


def test_only_one_process_writes_a_sweep(tmp_path):
    with alone(tmp_path), pytest.raises(ConfigError, match="another process is writing"), alone(tmp_path):
        pass


def test_a_sweep_none_of_whose_rows_allows_a_game_is_refused_with_the_reason(plan_from, tmp_path):
    plan = plan_from('scenario = "short.toml"\n[grid]\n"evader.speed_m_s" = [6.0, 7.0]\n')
    with pytest.raises(ConfigError, match="no row allows a game, of 2 looked at") as caught:
        begun(plan, tmp_path / "out", None)
    assert "must be above 1" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_one_worker_is_this_process():
    with executor(1, None) as working:
        assert isinstance(working, SerialExecutor)


def test_a_scheduler_that_is_not_there_is_a_link_error(monkeypatch):
    monkeypatch.setattr(executors, "CONNECT_S", 0.3)
    with pytest.raises(LinkError, match="no Dask scheduler answers"), executor(2, "tcp://127.0.0.1:9"):
        pass


@contextlib.contextmanager
def trusted_with(security):
    """Dask's configuration with these certificates, as a user's file or environment has it."""
    import dask

    ours = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    ours["client.key"] = security.tls_client_key
    with dask.config.set({f"distributed.comm.tls.{key}": value for key, value in ours.items()}):
        yield


def test_a_cluster_with_tls_computes_the_same_rows_for_who_has_its_certificate_alone(plan_from, tmp_path, monkeypatch):
    from distributed import LocalCluster, Security  # half a second, which collecting the tests need not take

    plan, ours, forged = plan_from(), Security.temporary(), Security.temporary()
    cluster = LocalCluster(1, 1, processes=False, security=ours, protocol="tls", dashboard_address=None)
    with cluster:
        at = cluster.scheduler_address
        with pytest.raises(ConfigError, match="TLS wants a certificate"), executor(2, at):
            pass
        with trusted_with(forged), pytest.raises(LinkError, match="no Dask scheduler answers"), executor(2, at):
            pass
        with trusted_with(ours), executor(2, at) as working:
            run(plan, tmp_path / "by the cluster", by=working)
        monkeypatch.setattr(executors, "CONNECT_S", 0.3)
        with pytest.raises(LinkError, match="no Dask scheduler answers"), executor(2, at.replace("tls", "tcp")):
            pass
    assert files(tmp_path / "by the cluster") == files(run(plan, tmp_path / "alone"))


def test_nothing_is_collected_while_a_client_starts(monkeypatch):
    """A client that failed, found to be garbage just then, would wait for the lock that the start of the next holds."""
    import distributed

    began = []

    def failing(*_, **__):
        began.append(gc.isenabled())
        raise OSError

    monkeypatch.setattr(distributed, "Client", failing)
    with pytest.raises(LinkError, match="no Dask scheduler answers"), executor(2, "tcp://127.0.0.1:1"):
        pass
    assert began == [False]
    assert gc.isenabled()


def workers_of(process):
    """Its processes that compute; Python has another one that looks after what they share."""
    return [one for one in process.children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]


@pytest.mark.slow
def test_two_workers_give_the_bytes_of_one_also_if_one_is_killed_amid_a_chunk(plan_from, tmp_path):
    plan, me = plan_from(), psutil.Process()
    expected = files(run(plan, tmp_path / "alone", chunk=3))
    work = begun(plan, tmp_path / "both", 3)
    killed = []

    def kill_one(_):
        if not killed:
            killed.append(workers_of(me)[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    with executor(2, None) as working:
        assert isinstance(working, ProcessExecutor)
        finish(work, working, kill_one)
        living = workers_of(me)
        sockets = [one for process in [me, *living] for one in process.net_connections("inet")]
    assert killed
    assert [one for one in sockets if one.status == psutil.CONN_LISTEN] == []
    assert files(tmp_path / "both") == expected
    assert len(living) == 2
    assert psutil.wait_procs(living, timeout=10)[1] == []


def die(_plan, _rows):
    os._exit(9)


@pytest.mark.slow
def test_a_chunk_that_ends_every_worker_is_given_up(plan_from, tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "_computed", die)
    with executor(2, None) as working, pytest.raises(GuidanceError, match="ended 5 workers"):
        finish(begun(plan_from(), tmp_path / "out", 12), working, lambda _: None)


LONG = """
scenario = "short.toml"
seeds = 240
[grid]
"evader.speed_m_s" = [1.0, 3.0]
"""


@pytest.mark.parametrize(
    ("slowness_s", "workers", "expected"), [(10.0, 1, 1), (0.5, 1, 20), (1e-9, 1, 120), (1e-9, 8, 15)]
)
def test_a_chunk_takes_some_seconds_and_every_worker_has_several(plan_from, slowness_s, workers, expected, monkeypatch):
    """A stopwatch that says what we like, of a sweep of 480 rows."""
    plan, now = plan_from(LONG), [0.0]
    play = chunk._outcomes

    def slowly(plan, cases):
        now[0] += slowness_s * len(cases.row)
        return play(plan, cases)

    monkeypatch.setattr(chunk, "_outcomes", slowly)
    assert plan.rows == 480
    assert chunk.rows_for(plan, workers, lambda: now[0]) == expected


@pytest.mark.parametrize(("steps_s", "game_s", "expected"), [(2.0, 0.05, 160), (20.0, 0.5, 40), (2.0, 0.0, 12000)])
def test_games_that_share_their_steps_share_a_chunk(plan_from, steps_s, game_s, expected, monkeypatch):
    """A chunk's own cost, however long it is on a busy machine, must not cut the chunks to nothing."""
    plan, now = plan_from(LONG.replace("240", "24000")), [0.0]

    def shared(plan, cases):
        now[0] += steps_s + game_s * len(cases.row)

    monkeypatch.setattr(chunk, "_outcomes", shared)
    assert chunk.rows_for(plan, 1, lambda: now[0]) == expected


def test_flights_are_written_one_by_one(plan_from):
    assert chunk.rows_for(plan_from(way="fast"), 2) == 1


def test_who_interrupts_is_told_what_is_kept():
    assert str(Interrupted(0, 24)) == "interrupted: no row had been written yet; the same command goes on from there"
    assert str(Interrupted(5, 24)) == "interrupted: 5 of 24 rows are kept; the same command goes on from there"


def test_the_command_takes_a_file_first_and_says_where_the_rows_are(short, tmp_path):
    out = tmp_path / "out"
    done = CliRunner().invoke(app, [str(short / "sweep.toml"), "--workers", "1", "--out", str(out)])
    assert done.exit_code == 0
    assert done.stdout.strip() == str(out)
    assert "24 games" in done.stderr
    again = CliRunner().invoke(app, ["--workers", "1", "--out", str(out), str(short / "sweep.toml")])
    assert "24 of them there already" in again.stderr


def test_flights_are_swept_too_and_a_row_is_what_flying_it_gives(short, tmp_path):
    (short / "sweep.toml").write_text('scenario = "short.toml"\nas = "fast"\n[grid]\n"evader.speed_m_s" = [1.0, 7.0]\n')
    rows = table(run(planned(str(short / "sweep.toml")), tmp_path / "out")).to_pylist()
    assert [row["end"] for row in rows] == ["captured", "invalid"]
    assert rows[0]["run"] == "fast"
    assert rows[0]["duration_s"] > rows[0]["game_time_s"] > 0.0
