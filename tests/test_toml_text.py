"""Where a key of a TOML file stands, and values as they are written there; what a wrong file is told."""

import tomllib

import pytest

from guidance.config import load
from guidance.errors import ConfigError
from guidance.sim.files import load_any
from guidance.sweeps.running import planned
from guidance.toml_text import as_toml, line_of

TEXT = '''title = "x"  # a key
description = """
game = "not a key"
[neither]
"""
[pursuer]
position_m = [0, 0]
limits.speed_m_s = 3
"evader.speed_m_s" = [1, 2]
[[fault]]
kind = "one"
[[fault]]
kind = "two"
[ sensor ]  # of the evader
rate_hz = -1
'''


@pytest.mark.parametrize(
    ("location", "line"),
    [
        (("title",), 1),
        (("game",), None),
        (("pursuer", "position_m", 2), 7),
        (("pursuer", "limits", "speed_m_s"), 8),
        (("pursuer", "evader.speed_m_s", "x"), 9),
        (("pursuer", "missing"), 6),
        (("fault", 0, "kind"), 11),
        (("fault", 1, "kind"), 13),
        (("sensor", "rate_hz"), 15),
    ],
)
def test_a_key_is_found_on_its_line_or_on_that_of_what_holds_it(location, line):
    assert line_of(TEXT, location) == line


@pytest.mark.parametrize("value", [{"a": [1, 2.5, "b"], "c": {"d": True}}, [1, [2]], {}, "text", False])
def test_a_value_is_written_as_toml(value):
    assert tomllib.loads(f"x = {as_toml(value)}")["x"] == value


def test_a_long_value_is_cut():
    assert as_toml(list(range(100))).endswith("…")
    assert len(as_toml(list(range(100)))) == 60


def told(read, tmp_path, text):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read(path)
    return str(caught.value)


def test_a_wrong_file_is_told_line_key_and_what_is_allowed(tmp_path):
    text = 'title = "x"\ngame = "pe"\n[pursuer]\nposition_m = [0, 0]\nspeed_m_s = "fast"\n'
    text += "[evader]\nposition_m = [0, 1, 4]\npolcy = 3\n"
    words = told(lambda path: load_any(str(path)), tmp_path, text)
    assert "line 4: pursuer.position_m = [0, 0]: must have 3 values or more" in words
    assert "line 5: pursuer.speed_m_s = 'fast': must be a valid number\n" in words
    assert "line 7: evader.position_m = [0, 1, 4]: must have 2 values at most" in words
    assert "line 8: evader.polcy: unknown key; did you mean 'policy'?" in words
    assert "line 6: evader.speed_m_s: missing" in words


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('way = "maths"', "line 3: way: unknown key; known here: as, description"),
        ('random."evader.speed_m_s" = { gauss = [1, 2] }', "evader.speed_m_s = { gauss = [1, 2] }: must be one of {"),
        ('random."evader.position" = { disc = 3 }', "random.evader.position = { disc = 3 }: a disc or an annulus is a"),
    ],
)
def test_a_wrong_sweep_is_told_as_it_was_written(line, words, tmp_path):
    assert words in told(lambda path: planned(str(path)), tmp_path, f'scenario = "pe"\nseeds = 2\n{line}\n')


def test_a_file_that_is_no_toml_is_told_its_line(tmp_path):
    assert "line 1" in told(lambda path: load(None, path), tmp_path, 'title = "x\n')
