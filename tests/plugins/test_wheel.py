"""A package from outside, installed from a wheel: its objects are found by their entry points, and fly."""

import base64
import hashlib
import importlib
import json
import subprocess
import sys
import zipfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guidance.autopilots import AUTOPILOTS, Verdict
from guidance.config import load, parse_document
from guidance.errors import ConfigError
from guidance.flight import State
from guidance.game.speed_sets import SPEED_SETS
from guidance.links.evaders.kinds import EVADER_KINDS, SourceOrder
from guidance.links.kinds import LINKS
from guidance.links.world import World
from guidance.registry import Registry
from guidance.session.checkup import examine
from guidance.session.observe.outputs import OUTPUTS, OutputOrder, open_outputs
from guidance.session.open.links import open_all
from guidance.session.open.mock import MockOptions
from guidance.session.recorded_flight import fly_recorded
from guidance.session.vehicle_file import SECTIONS, Config, vehicle_schema
from guidance.sim.scenario import Scenario
from guidance.strategies.own import load_policy
from tests.harness.vehicle import document
from tests.session.conftest import HERE, Ordered

PACKAGE = Path(__file__).parent / "package"
NEAR = load(Scenario, Path(__file__).parents[1] / "data" / "near_chase.toml")
REGISTRIES: tuple[Registry[Any], ...] = (
    AUTOPILOTS,
    LINKS,
    EVADER_KINDS,
    SPEED_SETS,
    OUTPUTS,
    SECTIONS,
)
ENTRY_POINTS = {
    "pursuit_example": """
[pursuit_guidance.evader_sources]
buoy = pursuit_example:BUOY
[pursuit_guidance.links]
simulator = pursuit_example:SIMULATOR
[pursuit_guidance.autopilots]
toy = pursuit_example:TOY
[pursuit_guidance.speed_sets]
halved = pursuit_example:Halved
[pursuit_guidance.outputs]
tally = pursuit_example:open_tally
[pursuit_guidance.sections]
tally = pursuit_example:TallyKeys
""",
    "pursuit_broken": """
[pursuit_guidance.evader_sources]
broken = pursuit_broken:KIND
[pursuit_guidance.links]
broken = pursuit_broken:LINK
[pursuit_guidance.autopilots]
broken = pursuit_broken:AUTOPILOT
[pursuit_guidance.speed_sets]
broken = pursuit_broken:SPEEDS
[pursuit_guidance.outputs]
broken = pursuit_broken:open_it
[pursuit_guidance.sections]
broken = pursuit_broken:Keys
""",
}
PLACE = f"{HERE.lat_deg},{HERE.lon_deg},{HERE.alt_amsl_m}"
URL = f"buoy://{PLACE}"
SIMULATOR = {"link": "simulator", "url": f"simulator://{PLACE}"}
BUOY = {"kind": "buoy", "url": URL, "system_id": None, "callsign": "B7"}


def wheel_of(name, folder):
    """Write a wheel of one module, and return its path."""
    path = folder / f"{name}-1.2.0-py3-none-any.whl"
    about = f"{name}-1.2.0.dist-info"
    files = {
        f"{name}.py": (PACKAGE / f"{name}.py").read_text(encoding="utf-8"),
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/entry_points.txt": ENTRY_POINTS[name],
    }
    rows = [f"{about}/RECORD,,"]
    with zipfile.ZipFile(path, "w") as wheel:
        for file, text in files.items():
            digest = hashlib.sha256(text.encode()).digest()
            hashed = base64.urlsafe_b64encode(digest).rstrip(b"=").decode()
            rows.append(f"{file},sha256={hashed},{len(text.encode())}")
            wheel.writestr(file, text)
        wheel.writestr(f"{about}/RECORD", "\n".join(rows) + "\n")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder in which both wheels are installed."""
    folder = tmp_path_factory.mktemp("installed")
    wheels = [wheel_of(name, tmp_path_factory.mktemp(name)) for name in ENTRY_POINTS]
    options = ("--quiet", "--no-index", "--no-deps", "--disable-pip-version-check", "--target")
    subprocess.run([sys.executable, "-m", "pip", "install", *options, folder, *wheels], check=True)
    return folder


@pytest.fixture
def installed(folder, monkeypatch):
    """Put both packages on the path; what they added is taken away at the end."""
    before = [dict(registry) for registry in REGISTRIES]
    monkeypatch.syspath_prepend(folder)
    importlib.invalidate_caches()
    yield
    for registry, members in zip(REGISTRIES, before, strict=True):
        registry.clear()
        registry.update(members)


def read(**sections):
    return parse_document(Config, document(**sections), source="test")


def opened(config):
    return lambda clock: EVADER_KINDS.named("buoy").open(
        SourceOrder("buoy", config.evader.url, clock.now_s, None, section=config.evader)
    )


def test_its_kind_has_keys_of_its_own_and_any_scheme(installed):
    """Catches a key of a plug-in that is not checked."""
    config = read(evader=BUOY)
    assert (config.evader.callsign, config.evader.north_m) == ("B7", 30.0)
    faults = {
        "callsign": ("", r"evader\.callsign = '': .*at least 1 character"),
        "north_m": (-1.0, r"evader\.north_m = -1\.0: must be greater than or equal to 0"),
        "calsign": ("B7", r"evader\.calsign: unknown key; did you mean 'callsign'"),
        "icao_address": (3, r"evader\.icao_address: not allowed; kind = .buoy. does not use it"),
    }
    for key, (value, words) in faults.items():
        with pytest.raises(ConfigError, match=words):
            read(evader=BUOY | {key: value})
    with pytest.raises(ConfigError, match=r"evader\.callsign: missing"):
        read(evader={key: value for key, value in BUOY.items() if key != "callsign"})


def test_its_link_has_keys_of_its_own_and_any_scheme(installed):
    config = read(vehicle=SIMULATOR, evader=BUOY)
    assert (config.vehicle.fence_m, config.vehicle.mavlink_url) == (120.0, None)
    with pytest.raises(ConfigError, match=r"vehicle\.fence_m = 0\.0: must be greater than 0"):
        read(vehicle=SIMULATOR | {"fence_m": 0.0}, evader=BUOY)
    with pytest.raises(ConfigError, match=r"vehicle\.url = 'udpin:.*should match pattern"):
        read(vehicle={"link": "simulator"}, evader=BUOY)
    with pytest.raises(ConfigError, match=r"vehicle\.url = 'simulator:.*allowed are udpin"):
        read(vehicle={"url": SIMULATOR["url"]})
    with pytest.raises(ConfigError, match=r'evader\.url: missing; .*with link = "simulator" needs'):
        read(vehicle=SIMULATOR, evader={"url": None})


def test_another_kind_does_not_take_its_keys(installed):
    assert EVADER_KINDS.named("buoy").section is not None
    with pytest.raises(ConfigError, match=r"evader\.callsign: unknown key; it belongs to another"):
        read(evader={"callsign": "B7"})
    assert LINKS.named("simulator").section is not None
    with pytest.raises(ConfigError, match=r"vehicle\.fence_m: unknown key; it belongs to another"):
        read(vehicle={"fence_m": 90.0})


def test_its_names_and_keys_are_in_the_schema_and_in_messages(installed):
    schema = json.dumps(vehicle_schema())
    for word in ("buoy", "callsign", "simulator", "fence_m", "toy", "halved", "tally", "every_s"):
        assert f'"{word}"' in schema, word
    with pytest.raises(ConfigError, match=r"evader\.kind = 'bouy': must be one of .*buoy"):
        read(evader={"kind": "bouy"})
    with pytest.raises(ConfigError, match=r"vehicle\.link = 'sim': must be one of .*simulator"):
        read(vehicle={"link": "sim"})
    with pytest.raises(ConfigError, match="tallly: unknown key; did you mean 'tally'"):
        read(tallly={"every_s": 1.0})


def test_its_output_is_opened_by_files_with_its_section_and_by_no_other(installed):
    tally = OUTPUTS.named("tally")
    for sections, count in (({"tally": {"every_s": 2.0}}, 1), ({}, 0)):
        order = OutputOrder("uav1", {}, None, None, None, read(**sections))
        with ExitStack() as stack:
            sinks = open_outputs(order, stack)
            assert [type(sink).__name__ for sink in sinks] == ["Tally"] * count
    assert tally(order) is None
    with pytest.raises(ConfigError, match=r"tally\.every_s = 0\.0: must be greater than 0"):
        read(tally={"every_s": 0.0})


def test_a_record_of_it_reads_again(installed):
    config = read(vehicle=SIMULATOR, evader=BUOY, tally={"every_s": 2.0})
    again = parse_document(Config, json.loads(config.model_dump_json()), source="record")
    assert again == config


@pytest.mark.flight
def test_its_autopilot_speed_set_and_law_fly_a_scenario(installed, tmp_path):
    more = {"autopilot": "toy", "speed_set": "halved", "speed_m_s": 6.0, "descent_m_s": 3.0}
    document = NEAR.model_dump() | {"pursuer": NEAR.pursuer.model_dump() | more}
    document["pursuer"]["policy"] = {"name": "pursuit_example:chase", "lead_s": 0.5}
    flown = fly_recorded(Scenario(**document), tmp_path, MockOptions(fast=True))
    (result,) = flown.vehicles.values()
    assert result.captured


def test_the_parameters_of_its_law_are_checked_against_its_function(installed):
    law = "pursuit_example:chase"
    observation = np.array([[3.0, 4.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]])
    (ahead,) = load_policy(f"{law}(lead_s=-2.0)")(observation)
    assert ahead.tolist() == [1.0, 0.0, 0.0]
    with pytest.raises(ConfigError, match=r"unexpected keyword argument 'lead_m'.* are: lead_s"):
        load_policy(f"{law}(lead_m=1)")
    with pytest.raises(ConfigError, match="parameters must be name=value"):
        load_policy(f"{law}(lead_s=open)")
    faults = {"lead_s": [1.0]}, {"name": None}
    for fault in faults:
        with pytest.raises(ConfigError, match=r"game\.policy = .*: (lead_s = |a table needs)"):
            read(game={"policy": {"name": law, **fault}})


@pytest.mark.flight
def test_its_evader_is_pursued_by_its_law_and_its_output_counts(installed):
    config = read(evader=BUOY, tally={"every_s": 2.0})
    game = {"policy": {"name": "pursuit_example:chase", "lead_s": 0.5}}
    flight = Ordered(source=opened(config), evader=BUOY, tally={"every_s": 2.0}, game=game)
    assert flight.config.game.policy == "pursuit_example:chase(lead_s=0.5)"
    flight.engaged()
    flight.until(State.ON_STATION)
    assert flight.evader.counters()["reports"] > 100
    flight.close()


@pytest.mark.flight
def test_a_vehicle_on_its_link_is_flown_from_a_file(installed):
    config = read(vehicle=SIMULATOR, evader=BUOY)
    world = World()

    def link(clock):
        open_all(config, clock, world, tapped=True)
        return world.links["uav1"]

    flight = Ordered(link=link, source=opened(config), vehicle=SIMULATOR, evader=BUOY)
    flight.engaged()
    flight.until(State.ON_STATION)
    assert type(flight.link).__name__ == "Simulator"
    assert flight.link.counters()["setpoints_sent"] > 100
    buoy: Any = world.evaders["uav1"]["evader"]
    assert buoy.callsign == "B7"
    world.close()
    flight.close()


def test_a_package_that_cannot_be_imported_stops_only_what_names_it(installed):
    assert read().name == "uav1"
    words = (
        r"pursuit_broken 1\.2\.0 cannot be imported \(ModuleNotFoundError: .*a_module_that_nobody"
    )
    for sections in (
        {"evader": {"kind": "broken"}},
        {"vehicle": {"autopilot": "broken"}},
        {"vehicle": {"link": "broken"}},
        {"game": {"speed_set": "broken"}},
        {"broken": {}},
    ):
        with pytest.raises(ConfigError, match=words) as raised:
            read(**sections)
        assert raised.value.exit_code == 2
    assert "broken" not in OUTPUTS.importable()


def test_the_doctor_names_every_package_and_what_is_wrong_with_it(installed):
    rows = {row.name: row for row in examine(read(vehicle=SIMULATOR, evader=BUOY))}
    assert rows["link simulator"].verdict is Verdict.PASS
    assert rows["evader source buoy"].verdict is Verdict.PASS
    broken = rows["output broken"]
    assert broken.verdict is Verdict.WARN
    assert "pursuit_broken 1.2.0 cannot be imported" in broken.value
    assert broken.advice == "repair it or uninstall it"
