"""Where a key of a TOML file stands, values as they are written there, and what a wrong file is told."""

import os
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from guidance import registry
from guidance.config import Section, as_toml, config_folder, find, lines_of, load, parse_document
from guidance.control import Limits
from guidance.errors import ConfigError
from guidance.session.vehicle_file import Config
from guidance.sim.scenario import Scenario
from guidance.sim.scenario_file import load_any, load_scenario
from guidance.toml_files import read


class Inner(Section):
    speed_m_s: float = Field(gt=0.0)


class Outer(Section):
    title: str
    inner: Inner
    spare: Inner | None = None


GOOD = {"title": "a", "inner": {"speed_m_s": 3.0}}


def test_a_file_of_names_of_this_package_reads_no_other_packages(monkeypatch):
    scenario = load_scenario("pe")[1].model_dump()
    vehicle = tomllib.loads(find("px4", "vehicles").read_text(encoding="utf-8"))

    def read_all(**_):
        raise AssertionError("reading all installed packages takes 15 ms")

    monkeypatch.setattr(registry, "entry_points", read_all)
    assert Scenario.model_validate(scenario).game == "pe"
    assert parse_document(Config, vehicle, source="px4").evader.kind == "global_position"


def test_a_key_of_an_optional_section_is_known_too():
    with pytest.raises(ConfigError, match=r"spare\.speed: unknown key; did you mean 'speed_m_s'\?"):
        parse_document(Outer, {**GOOD, "spare": {"speed_m_s": 1.0, "speed": 1.0}}, source="x")


def test_a_key_like_no_other_lists_what_is_known():
    with pytest.raises(ConfigError, match="zzz: unknown key; allowed here: inner, spare, title"):
        parse_document(Outer, {**GOOD, "zzz": 1}, source="x")


@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), float("inf"), "fast"])
def test_a_value_out_of_range_is_shown_with_its_key(value):
    with pytest.raises(ConfigError, match=r"^file\.toml:\n  inner\.speed_m_s = "):
        parse_document(Outer, {"title": "a", "inner": {"speed_m_s": value}}, source="file.toml")


@pytest.mark.parametrize("value", ["3", True, ["3"]])
def test_text_and_booleans_are_no_numbers(value):
    with pytest.raises(ConfigError, match=r"inner\.speed_m_s = .*: must be a valid number"):
        parse_document(Outer, {"title": "a", "inner": {"speed_m_s": value}}, source="x")
    assert (
        parse_document(Outer, {"title": "a", "inner": {"speed_m_s": 3}}, source="x").inner.speed_m_s
        == 3.0
    )


@pytest.mark.parametrize(
    ("section", "key", "value"), [("pursuer", "speed_m_s", "6"), ("", "seed", "1")]
)
def test_a_scenario_takes_no_text_for_a_number(section, key, value):
    document = load_scenario("pe")[1].model_dump(
        mode="json", exclude_none=True, exclude_defaults=True
    )
    (document[section] if section else document)[key] = value
    with pytest.raises(ConfigError, match=rf"{key} = '{value}': must be a valid"):
        parse_document(Scenario, document, source="x")


def test_a_vehicle_file_takes_no_text_for_a_number_in_an_array():
    with pytest.raises(
        ConfigError, match=r"fence_polygon_ne_m\.0\.1 = '5': must be a valid number"
    ):
        parse_document(
            Limits, {"fence_polygon_ne_m": [[0.0, "5"], [9.0, 0.0], [9.0, 9.0]]}, source="x"
        )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = " + "[" * 100_000 + "]" * 100_000, "arrays or tables are nested too deeply"),
        (
            "x = " + "{a = " * 80_000 + "1" + "}" * 80_000,
            "arrays or tables are nested too deeply",
        ),
        ("x = " + "9" * 100_000, "has 100000 digits"),
        ("x = [{ a = 0x" + "f" * 17 + " }]", "an integer has more than 64 bits"),
    ],
)
def test_a_file_that_no_parser_can_hold_is_refused(text, said, tmp_path):
    path = tmp_path / "huge.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=rf"huge\.toml: not valid TOML.*{said}"):
        load(Outer, path)


def test_a_file_that_is_no_toml_or_not_there_is_named(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text("a = = 1")
    with pytest.raises(ConfigError, match=r"bad\.toml: not valid TOML"):
        load(Outer, bad)
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        load(Outer, tmp_path / "none.toml")


@pytest.mark.parametrize("name", ["pe", "pe.toml", "config/scenarios/pe.toml", "scenarios/pe.toml"])
def test_a_shipped_file_is_found_by_name_from_any_folder(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find(name, "scenarios") == config_folder() / "scenarios" / "pe.toml"


def test_a_file_here_comes_before_a_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    assert find("mine.toml", "scenarios").samefile(tmp_path / "mine.toml")


def test_an_unknown_name_lists_those_that_there_are():
    with pytest.raises(ConfigError, match=r"no scenario 'zzz': give a path, or one of: .*pe.*tad"):
        find("zzz", "scenarios")


def test_a_misspelt_name_is_answered_with_the_right_one():
    with pytest.raises(
        ConfigError, match=r"no scenario 'hover_chaise': did you mean 'hover_chase'"
    ):
        find("hover_chaise", "scenarios")


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
    assert lines_of(TEXT, [location]) == [line]


def test_a_key_is_found_behind_and_in_long_arrays_and_texts():
    corners = "\n".join("  [1.0, 2.0],  # a corner ] of many" for _ in range(6000))
    text = f"[limits]\ncorners = [\n{corners}\n]\nwords = '''\n[x]\n'''\nlast = 1\n"
    locations = [("limits", "corners", 4000, 0), ("limits", "last")]
    assert lines_of(text, locations) == [2, 6007]


KEYS = st.sampled_from(["a", "b", '"a.b"', "'b'", '"\\u0061"'])
STATEMENTS = st.one_of(
    KEYS.map("[{}]".format),
    KEYS.map("[[ {} ]]  # [x]".format),
    st.tuples(KEYS, KEYS).map("[{0[0]} . {0[1]}]".format),
    st.tuples(KEYS, KEYS).map("[[{0[0]}.{0[1]}]]".format),
    KEYS.map("{} = [\n  { a = 1 },\n]".replace("{}", "%s").__mod__),
    st.tuples(KEYS, KEYS).map('{0[0]}.{0[1]} = """\n[a]\n"""'.format),
)


def _locations(value):
    yield ()
    members = value.items() if isinstance(value, dict) else []
    if isinstance(value, list):
        members = enumerate(value)
    for key, member in members:
        for location in _locations(member):
            yield (key, *location)


@given(statements=st.lists(STATEMENTS, max_size=8))
def test_the_line_of_a_key_is_that_of_the_statement_with_which_it_begins(statements):
    text = ""
    line = 1
    lines = {}
    for statement in statements:
        try:
            document = tomllib.loads(f"{text}{statement}\n")
        except tomllib.TOMLDecodeError:
            continue
        for location in _locations(document):
            lines.setdefault(location, line)
        text += f"{statement}\n"
        line += statement.count("\n") + 1
    lines.pop((), None)
    assert lines_of(text, list(lines)) == list(lines.values())


def test_many_faults_are_counted_and_the_first_are_told_from_one_reading(tmp_path, monkeypatch):
    texts = []
    loads = tomllib.loads
    monkeypatch.setattr(tomllib, "loads", lambda text: texts.append(text) or loads(text))
    text = "".join(f"[unknown_{number}]\n" for number in range(5000))
    words = told(lambda path: load_any(str(path)), tmp_path, text)
    assert "line 1: unknown_0: unknown key" in words
    assert "more faults" in words
    assert len(words.splitlines()) < 30
    assert texts == [text]


@pytest.mark.parametrize("part", ["a", '"a"', "'a'", '"\\""'])
def test_a_key_of_thousands_of_parts_is_refused_before_it_is_parsed(tmp_path, part):
    words = told(lambda path: load_any(str(path)), tmp_path, f"{part} . " * 20_000 + "b = 1\n")
    assert "a key has more than 16 parts" in words


@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_a_file_without_an_end_is_refused_at_once(tmp_path, kind):
    path = tmp_path / "scenario.toml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(2**40)
    with pytest.raises(ConfigError, match=r"not a regular file|larger than 524288 bytes"):
        read(path)


def test_a_byte_order_mark_is_left_out(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_bytes(b'\xef\xbb\xbfgame = "pe"\n')
    assert read(path) == ('game = "pe"\n', {"game": "pe"})


@pytest.mark.parametrize(
    "value", [{"a": [1, 2.5, "b"], "c": {"d": True}}, [1, [2]], {}, "text", False]
)
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
        ('way = "maths"', "line 3: way: unknown key; allowed here: as, description"),
        (
            'random."evader.speed_m_s" = { gauss = [1, 2] }',
            "random.evader.speed_m_s.gauss: unknown key; allowed here: about_m, annulus",
        ),
        (
            'random."evader.position" = { disc = 3 }',
            "random.evader.position: a disc or an annulus is a",
        ),
    ],
)
def test_a_wrong_sweep_is_told_as_it_was_written(line, words, tmp_path):
    from guidance.sweeps.rows import planned

    assert words in told(
        lambda path: planned(str(path)), tmp_path, f'scenario = "pe"\nseeds = 2\n{line}\n'
    )


def test_a_file_that_is_no_toml_is_told_its_line(tmp_path):
    assert "line 1" in told(lambda path: load(None, path), tmp_path, 'title = "x\n')
