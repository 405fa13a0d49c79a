import pytest
from pydantic import Field

from guidance.config import Section, config_folder, find, load, parse
from guidance.errors import ConfigError


class Inner(Section):
    speed_m_s: float = Field(gt=0.0)


class Outer(Section):
    title: str
    inner: Inner
    spare: Inner | None = None


GOOD = {"title": "a", "inner": {"speed_m_s": 3.0}}


def test_a_good_document_becomes_the_model():
    assert parse(Outer, GOOD, source="x").inner.speed_m_s == 3.0


def test_a_misspelt_key_is_named_with_the_nearest_known_one():
    with pytest.raises(ConfigError, match=r"inner\.sped_m_s: unknown key; did you mean 'speed_m_s'\?"):
        parse(Outer, {"title": "a", "inner": {"speed_m_s": 1.0, "sped_m_s": 1.0}}, source="x")


def test_a_key_of_an_optional_section_is_known_too():
    with pytest.raises(ConfigError, match=r"spare\.speed: unknown key; did you mean 'speed_m_s'\?"):
        parse(Outer, {**GOOD, "spare": {"speed_m_s": 1.0, "speed": 1.0}}, source="x")


def test_a_key_like_no_other_lists_what_is_known():
    with pytest.raises(ConfigError, match="zzz: unknown key; known here: inner, spare, title"):
        parse(Outer, {**GOOD, "zzz": 1}, source="x")


def test_a_missing_key_is_named():
    with pytest.raises(ConfigError, match=r"inner\.speed_m_s: missing"):
        parse(Outer, {"title": "a", "inner": {}}, source="x")


@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), float("inf"), "fast"])
def test_a_value_out_of_range_is_shown_with_its_key(value):
    with pytest.raises(ConfigError, match=r"^file\.toml:\n  inner\.speed_m_s = "):
        parse(Outer, {"title": "a", "inner": {"speed_m_s": value}}, source="file.toml")


def test_every_fault_of_a_file_is_listed():
    with pytest.raises(ConfigError) as caught:
        parse(Outer, {"inner": {"speed_m_s": -1.0}}, source="x")
    assert "title: missing" in str(caught.value)
    assert "inner.speed_m_s = -1.0" in str(caught.value)


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
