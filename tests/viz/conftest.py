"""Flights to draw, a browser, and a TLS certificate."""

import shutil
import subprocess

import psutil
import pytest

from guidance.sim.scenario import Scenario
from tests.harness.flights import NEAR, flown, soon_up_and_down

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LIMIT_MS = 90_000


@pytest.fixture(scope="module")
def chromium():
    """A Chromium for all tests of a module, or None; its start takes seconds of processor time."""
    if BROWSER is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=BROWSER, args=QUIET) as launched,
    ):
        for process in psutil.Process().children(recursive=True):
            if "python" not in process.name():
                # Drawing must not slow down the flight, nor be starved by other tests
                process.nice(5)
        yield launched


@pytest.fixture
def browser(chromium):
    """A Chromium context that records console messages and requests; None without a browser."""
    if chromium is None:
        yield None
        return
    with chromium.new_context(viewport={"width": 1024, "height": 768}) as context:
        context.set_default_timeout(LIMIT_MS)
        said = context.said = []
        asked = context.asked = []
        context.on("console", lambda message: said.append(message.text))
        context.on("weberror", lambda error: said.append(str(error.error)))
        context.on("request", lambda request: asked.append(request.url))
        yield context


@pytest.fixture(scope="session")
def pe(short_flight, tmp_path_factory):
    """A short PE flight: its result, its record, the folder of its report."""
    from guidance.viz.report import write_report  # whoever draws nothing need not load matplotlib

    folder = tmp_path_factory.mktemp("pe")
    result, path = short_flight
    shutil.copy(path, folder / "r.mcap")
    write_report(folder / "r.mcap", folder)
    return result, folder / "r.mcap", folder


@pytest.fixture(scope="session")
def tad(tmp_path_factory):
    """A short TAD game, flown and reported."""
    from guidance.viz import report

    folder = tmp_path_factory.mktemp("tad")
    target = {"position_m": (0.0, 10.0)}
    evader = {**NEAR.evader.model_dump(), "position_m": (12.0, 16.0)}
    scenario = Scenario.model_validate(
        {**NEAR.model_dump(), "game": "tad", "target": target, "evader": evader}
    )
    with soon_up_and_down():
        result = flown(scenario, folder / "r.mcap")
    with pytest.MonkeyPatch.context() as patched:
        # Those of PE are all drawn
        patched.setattr(report, "PICTURES", {"tracks": report.PICTURES["tracks"]})
        report.write_report(folder / "r.mcap", folder)
    return result, folder / "r.mcap", folder


@pytest.fixture(scope="session")
def record(short_flight):
    """The record of a short PE flight."""
    return short_flight[1]


@pytest.fixture(scope="session")
def certificate(tmp_path_factory):
    """A folder with a certificate of this host, its key, and a password."""
    folder = tmp_path_factory.mktemp("tls")
    kind = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2"]
    files = ["-keyout", folder / "key.pem", "-out", folder / "cert.pem"]
    names = ["-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(
        ["openssl", "req", "-x509", *kind, *files, *names], check=True, capture_output=True
    )
    (folder / "password").write_text("correct horse battery\nmore\n")
    (folder / "password").chmod(0o600)
    return folder
