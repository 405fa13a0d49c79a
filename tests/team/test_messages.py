"""The published schemas of the team's messages."""

import json
from pathlib import Path

import pytest

from guidance.team.messages import MESSAGE_KINDS


@pytest.mark.parametrize("kind", MESSAGE_KINDS)
def test_the_published_schema_is_the_messages_own(kind):
    published = Path(__file__).parents[2] / "config" / "zenoh" / f"team_{kind}.schema.json"
    own = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **MESSAGE_KINDS[kind].model_json_schema(),
    }
    assert json.loads(published.read_text()) == own
