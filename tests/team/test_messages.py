"""The published schemas of the team's messages."""

import json
from pathlib import Path

import pytest

from guidance.team.messages import KINDS, json_schema


@pytest.mark.parametrize("kind", KINDS)
def test_the_published_schema_is_the_messages_own(kind):
    published = Path(__file__).parents[2] / "config" / "zenoh" / f"team_{kind}.schema.json"
    assert json.loads(published.read_text()) == json_schema(kind)
