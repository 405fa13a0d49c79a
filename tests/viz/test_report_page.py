"""The report in a browser, and the data of its pictures."""

import base64
import functools
import html
import math
import re
import shutil
import subprocess
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.errors import ConfigError, OutputError
from guidance.log import cycles_of, metadata_of
from guidance.log.writer import Recorder
from guidance.messages import Home
from guidance.session.fly.result import outcome_of_flight
from guidance.viz import report as written
from guidance.viz.history import history_of, opening_words, summary
from guidance.viz.report import PICTURES, draw_tracks, write_report
from tests.harness.flights import NEAR

VOID = {"meta", "link", "img", "br"}
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
QUIET = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
    "--disable-component-update",
    "--disable-default-apps",
    "--enable-logging=stderr",
    "--hide-scrollbars",
]


class Strict(HTMLParser):
    """Every element that is opened is closed, in order; what a page would fetch is kept."""

    def __init__(self):
        super().__init__()
        self.open = []
        self.seen = []
        self.fetched = []
        self.ids = []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.seen.append(tag)
        self.fetched += [
            value for name, value in attrs if name in {"src", "href", "srcset", "data", "action"}
        ]
        self.ids += [attributes["id"]] if "id" in attributes else []
        assert tag != "img" or attributes["alt"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(page):
    parser = Strict()
    parser.feed(page)
    parser.close()
    return parser


def page_in(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


@functools.cache
def told(path):
    """The history of a record. Read only."""
    return history_of(path)


def looked_at(page, folder):
    """Render a page in a headless browser; return a screenshot and the console output."""
    picture = folder / "page.png"
    command = [BROWSER, *QUIET, f"--user-data-dir={folder / 'profile'}", "--window-size=1200,4000"]
    done = subprocess.run(
        [*command, f"--screenshot={picture}", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return imread(picture), [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def test_the_page_is_well_formed_and_needs_nothing_from_outside(pe):
    """Catches a page that asks another computer for something."""
    page = page_in(pe[2])
    parser = parsed(page)
    assert parser.open == []
    assert parser.fetched
    assert all(value.startswith("data:") for value in parser.fetched)
    assert "script" not in parser.seen
    assert "url(" not in page
    assert sorted(parser.ids) == sorted(PICTURES)
    assert parser.seen.count("img") == len(PICTURES)


def test_every_picture_is_in_the_page_as_sound_svg_without_a_reference_to_outside(pe):
    images = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page_in(pe[2]))
    for image in images:
        root = ElementTree.fromstring(base64.b64decode(image))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        references = [
            value
            for one in root.iter()
            for name, value in one.attrib.items()
            if name.endswith("href")
        ]
        assert all(reference.startswith("#") for reference in references)
    assert len(images) == len(PICTURES)


def test_every_picture_is_also_a_png_with_something_in_it(pe, tad):
    """Catches an empty picture."""
    for folder, names in ((pe[2], PICTURES), (tad[2], ["tracks"])):
        for name in names:
            image = imread(folder / f"{name}.png")
            assert image.shape[1] > 1000
            assert (image[..., :3].min(axis=-1) < 0.5).mean() > 0.002


def test_a_browser_shows_the_page_without_a_word_on_its_console(pe, tmp_path):
    page = page_in(pe[2])
    assert parsed(page).open == []  # without a browser, only this is checked
    if BROWSER is None:
        print("no chromium here: the page was checked for its structure only")
        return
    image, console = looked_at(pe[2] / "report.html", tmp_path)
    assert console == []
    ink = (image[..., :3].min(axis=-1) < 0.6).any(axis=1)
    assert ink[:3000].mean() > 0.5
    # The console is where an outside request would show: the page forbids it to itself.
    reaching = tmp_path / "reaching.html"
    reaching.write_text(
        page.replace("</body>", '<img alt="x" src="http://127.0.0.1:9/x.png"></body>'), "utf-8"
    )
    assert any("Content Security Policy" in line for line in looked_at(reaching, tmp_path)[1])


def test_the_summary_says_what_the_flight_itself_said(pe, tad):
    """Catches a report that tells another value than the flight."""
    for result, path, _ in (pe, tad):
        rows = dict(summary(told(path)))
        outcome = outcome_of_flight(result, "fast")
        assert rows["value predicted at engagement"].startswith(f"{outcome.predicted:.2f} ")
        # A report knows where the evader was by its reports only.
        apart = 0.0 if outcome.game == "pe" else 0.05
        assert float(rows["flown"].split()[0]) == pytest.approx(outcome.achieved, abs=0.005 + apart)
        assert float(rows["game lasted"].split()[0]) == pytest.approx(
            outcome.game_time_s, abs=0.005
        )
        if outcome.game == "pe":
            assert rows["flown / predicted"] == f"{outcome.ratio:.3f}"
        assert rows["setpoints sent"] == str(result.setpoints_sent)
        assert rows["guarantee alarms"] == str(len(result.alarms))
        assert rows["outcome"] == "captured; ended landed"
        assert float(rows["game lasted"].split()[0]) == pytest.approx(
            outcome.capture_time_s, abs=0.031
        )


def test_the_first_paragraph_says_who_where_what_was_promised_and_what_limited_it(
    pe, tad, tmp_path
):
    for result, path, folder in (pe, tad):
        history = told(path)
        said = opening_words(history)
        engaged = history.engaged.certificate
        for words in (
            result.scenario.title, "in virtual time",
            f"from {history.flight.vehicle.latest.get(Home).latitude_deg:.5f}°",
            f"within {engaged.time_needed_s:.1f} s", f"after {history.game_lasted_s:.1f} s", "ended landed",
            "imit",
        ):  # fmt: skip
            assert words in said
        assert f"<p>{html.escape(said)}</p>" in page_in(folder)
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(pe[1].read_bytes()[:150_000])
    assert "No game was played" in opening_words(history_of(torn))


def test_the_picture_of_a_flight_that_never_engaged_is_drawn(pe, tmp_path):
    """Catches a picture that needs a game. That of a game is drawn in test_shaped_target.py."""
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(pe[1].read_bytes()[:150_000])
    path = tmp_path / "torn.png"
    written.draw_flight(torn, path, r"a title $\frac{$")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 20_000


def test_a_flight_becomes_a_short_moving_picture(pe, tmp_path, monkeypatch):
    """Catches a moving picture that stands still or is too large."""
    full = written.FRAMES
    monkeypatch.setattr(written, "FRAMES", 4)  # to draw less
    written.write_animation(told(pe[1]), tmp_path / "flight.webp")
    with Image.open(tmp_path / "flight.webp") as picture:
        frames = getattr(picture, "n_frames")  # noqa: B009 - of the moving kinds only
        assert frames == 4
        first = np.asarray(picture.convert("L"), float)
        picture.seek(frames - 1)
        assert np.abs(np.asarray(picture.convert("L"), float) - first).max() > 50.0
    assert (tmp_path / "flight.webp").stat().st_size < 600_000 * 4 / full


def test_the_tracks_are_those_that_were_flown(pe):
    result, path, _ = pe
    history = told(path)
    by_time = {round(cycle.now_s, 6): number for number, cycle in enumerate(history.cycles)}
    for sample in result.samples[::50]:
        # A sample is taken before the cycle has read
        cycle = history.cycles[by_time[round(sample.now_s, 6)] - 1]
        assert cycle.pursuer_m == pytest.approx(sample.pursuer_m, abs=1e-9)
        if math.isfinite(cycle.evader_m[0]):
            # Estimated from reports against where it was: telemetry's noise and age lie between them.
            assert math.dist(cycle.evader_m, sample.evader_m) < 1.0


@functools.cache
def drawn(path):
    """Every figure of the history of a record. Read only."""
    draws = (draw_tracks, written.draw_game, written.draw_velocities, written.draw_ages)
    return [draw(told(path)) for draw in draws]


def test_every_axis_has_a_name_and_every_quantity_its_unit(pe, tad):
    """Catches an axis without a unit."""
    for _, path, _ in (pe, tad):
        for figure in drawn(path):
            axes = figure.axes
            assert axes[-1].get_xlabel() in {"time, s", "x east, m"}
            for one in axes:
                assert re.search(r", (m|s|ms|m/s)$", one.get_ylabel())


def test_no_legend_covers_what_is_drawn(pe):
    """Catches a legend over the curves."""
    for figure in drawn(pe[1]):
        figure.canvas.draw()
        legends = [*figure.legends, *filter(None, (one.get_legend() for one in figure.axes))]
        assert legends
        for legend in legends:
            box = legend.get_window_extent()
            assert not any(box.overlaps(one.get_window_extent()) for one in figure.axes)


def test_without_colours_the_players_are_still_told_apart(pe):
    """Catches lines that differ in colour only."""
    plan = drawn(pe[1])[0].axes[1]
    lines = {str(line.get_label()): line for line in plan.lines}
    looks = [
        (line.get_linestyle(), line.get_marker(), line.get_linewidth())
        for name, line in lines.items()
        if not name.startswith("_")
    ]
    assert {"pursuer", "evader", "isochron at engagement", "isochron at capture"} <= lines.keys()
    assert len(set(looks)) == len(looks)


def test_the_guarantee_drawn_is_the_recorded_value_plus_time(pe):
    history = told(pe[1])
    line = drawn(pe[1])[1].axes[2].lines[0]
    engaged = history.cycles[history.engaged.number]
    at = np.searchsorted(line.get_xdata(), engaged.now_s)
    assert line.get_ydata()[at] == pytest.approx(engaged.value)
    at = np.searchsorted(line.get_xdata(), engaged.now_s + 2.0)
    assert line.get_ydata()[at] == pytest.approx(
        history.cycles[history.engaged.number + 100].value + 2.0, abs=0.05
    )


def test_the_worst_of_each_second_is_kept():
    seconds, worst = written.worst_of_each_second(
        np.array([0.0, 0.5, 0.9, 1.0, 1.5, 3.0]), np.array([1.0, 7.0, 2.0, np.nan, 3.0, 4.0])
    )
    assert seconds.tolist() == [0.0, 1.0, 3.0]
    assert worst.tolist() == [7.0, 3.0, 4.0]
    assert len(written.worst_of_each_second(np.zeros(0), np.zeros(0))[0]) == 0


def test_a_flight_that_never_engaged_or_was_torn_is_reported_too(pe, tmp_path):
    """Catches a report that needs a game."""
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(pe[1].read_bytes()[:150_000])
    written = write_report(torn, tmp_path / "report")
    assert [path.name for path in written] == ["report.html", *(f"{name}.png" for name in PICTURES)]
    rows = dict(summary(history_of(torn)))
    assert rows["outcome"].startswith("no game was played")
    assert rows["record"].startswith("torn (")


def test_a_title_cannot_break_out_of_the_page(pe, tmp_path, monkeypatch):
    """Catches a script that a record brings into its report."""
    monkeypatch.setattr(written, "PICTURES", dict(list(written.PICTURES.items())[:1]))
    path = tmp_path / "r.mcap"
    metadata = {**metadata_of(pe[1])}
    metadata["scenario"] = metadata["scenario"].replace(NEAR.title, "<script>alert(1)</script>")
    assert "<script>" in metadata["scenario"]
    recorder = Recorder(path, metadata)
    for cycle in cycles_of(torn_copy(pe[1], tmp_path)):
        recorder.cycle(cycle)
    recorder.close()
    write_report(path, tmp_path)
    assert "script" not in parsed(page_in(tmp_path)).seen


def torn_copy(path, folder):
    copy = folder / "copy.mcap"
    copy.write_bytes(path.read_bytes()[:100_000])
    return copy


def test_a_record_without_a_cycle_and_a_folder_that_cannot_be_written_are_refused(pe, tmp_path):
    path = tmp_path / "empty.mcap"
    recorder = Recorder(path, metadata_of(pe[1]))
    recorder.event(0.0, "vehicle heard")
    recorder.close()
    with pytest.raises(ConfigError, match="contains no guidance cycle"):
        write_report(path, tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(torn_copy(pe[1], tmp_path), tmp_path / "file" / "deep")


def test_a_report_never_replaces_that_of_another_record(pe, tad, tmp_path, monkeypatch):
    monkeypatch.setattr(written, "PICTURES", {})
    torn = torn_copy(pe[1], tmp_path)
    for _ in range(2):
        write_report(torn, tmp_path)
    before = page_in(tmp_path)
    with pytest.raises(OutputError, match="is the report of another record"):
        write_report(tad[1], tmp_path)
    assert page_in(tmp_path) == before


def test_several_records_of_a_daemon_get_a_folder_each(pe, tmp_path, monkeypatch):
    monkeypatch.setattr(written, "PICTURES", {})
    names = ["uav1-a.mcap", "uav1-b.mcap"]
    for name in names:
        torn_copy(pe[1], tmp_path).rename(tmp_path / name)
    words = [str(tmp_path / name) for name in names]
    for out in ([], ["--out", str(tmp_path / "out")]):
        run = CliRunner().invoke(app, ["report", *words, *out])
        assert run.exit_code == 0, run.output
        folder = tmp_path / "out" if out else tmp_path
        assert all(name.removesuffix(".mcap") in run.output for name in names)
        assert all(
            (folder / name.removesuffix(".mcap") / "report.html").is_file() for name in names
        )
