"""The published schemas of all files: valid, true of what comes along, and every key has its meaning."""

import json
import re
import tomllib

import jsonschema
import pytest
from typer.testing import CliRunner

from guidance.cli.program import app
from guidance.cli.vehicle_setup import SCHEMAS, schema_of
from guidance.config import config_folder
from guidance.errors import ConfigError
from guidance.strategies import EVADER_STRATEGIES, PURSUER_STRATEGIES


@pytest.mark.parametrize(
    ("kind", "folder"), [("vehicle", "vehicles"), ("scenario", "scenarios"), ("sweep", "sweeps")]
)
def test_a_schema_accepts_every_file_that_comes_along_and_no_other_key(kind, folder):
    done = CliRunner().invoke(app, ["schema", kind], catch_exceptions=False)
    schema = json.loads(done.stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    files = sorted((config_folder() / folder).glob("*.toml"))
    assert len(files) >= 2
    for path in files:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        assert [error.message for error in validator.iter_errors(document)] == [], path.name
        assert not validator.is_valid(document | {"colour": "red"})


@pytest.mark.parametrize("kind", SCHEMAS)
def test_every_key_has_a_meaning(kind):
    schema = schema_of(kind)
    sections = {schema["title"]: schema, **schema["$defs"]}
    silent = [
        f"{name}.{key}"
        for name, section in sections.items()
        for key, said in section.get("properties", {}).items()
        if "description" not in said and "$ref" not in said
    ]
    assert silent == []


def test_policies_are_enumerated_wherever_they_are_named():
    scenario, vehicle, sweep = (
        schema_of(kind)["$defs"] for kind in ("scenario", "vehicle", "sweep")
    )
    named, own, table = scenario["Pursuer"]["properties"]["policy"]["anyOf"]
    assert named["enum"] == list(PURSUER_STRATEGIES)
    assert re.search(own["pattern"], "policies/mine.py:choose")
    assert scenario["Evader"]["properties"]["policy"]["anyOf"][0]["enum"] == list(EVADER_STRATEGIES)
    assert re.search(own["pattern"], "policies/mine.py:choose(lead_rad=0.1)")
    assert table["properties"]["name"]["pattern"] == own["pattern"]
    flown, *_ = vehicle["GameSection"]["properties"]["policy"]["anyOf"]
    assert "waypoints" not in flown["enum"]
    assert sweep["Policies"]["properties"]["evader"]["anyOf"][0]["enum"] == list(EVADER_STRATEGIES)


def test_a_kind_that_is_none_is_told_which_there_are():
    with pytest.raises(ConfigError, match="allowed are vehicle, scenario, sweep"):
        CliRunner().invoke(app, ["schema", "mission"], catch_exceptions=False)
