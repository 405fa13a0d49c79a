"""`guidance paper`: every published digit, and the figures."""

import pytest
from PIL import Image
from typer.testing import CliRunner

import guidance.paper
from guidance.cli.program import app
from guidance.paper import Case, tables


@pytest.fixture(scope="module")
def computed():
    return tables()


@pytest.mark.flight
def test_all_eight_published_cells_match_in_every_digit(computed):
    found = [case for table in computed for case in table.cases]
    assert len(found) == 8
    for case in found:
        assert case.stepped == case.published
        assert case.matches


@pytest.mark.flight
def test_the_exact_column_is_the_value_where_both_play_their_optimum(computed):
    pe, tad = ([case for case in table.cases if case.is_optimal] for table in computed)
    assert [case.exact for case in (*pe, *tad)] == ["10.4247", "4.1464"]


@pytest.mark.flight
def test_the_command_prints_three_columns_and_draws_three_figures_in_two_formats(
    tmp_path, computed, monkeypatch
):
    monkeypatch.setattr(guidance.paper, "tables", lambda: computed)
    result = CliRunner().invoke(app, ["paper", "--out", str(tmp_path / "drawn")])
    assert result.exit_code == 0, result.output
    assert "8 of 8 published cells match in every digit" in result.output
    for number in ("11.05", "11.0392", "19.4309", "4.1464", "0.0046"):
        assert number in result.output
    names = {path.name for path in (tmp_path / "drawn").iterdir()}
    assert names == {
        f"{name}.{kind}" for name in ("pe", "tad-part-1", "tad-part-2") for kind in ("png", "pdf")
    }
    for path in (tmp_path / "drawn").glob("*.png"):
        with Image.open(path) as image:
            assert min(image.size) > 800
            assert len(image.convert("L").getcolors()) > 50
    for path in (tmp_path / "drawn").glob("*.pdf"):
        assert path.read_bytes().startswith(b"%PDF")


@pytest.mark.flight
def test_a_digit_that_differs_ends_the_command_with_an_error(computed, monkeypatch):
    pe, tad = computed
    wrong = pe._replace(cases=(pe.cases[0]._replace(published="11.06"), *pe.cases[1:]))
    monkeypatch.setattr(guidance.paper, "tables", lambda: (wrong, tad))
    result = CliRunner().invoke(app, ["paper", "--no-figures"])
    assert result.exit_code == 1
    assert "7 of 8" in result.output


def test_a_case_matches_by_its_digits_alone():
    case = Case(
        "optimal", "pure_evade", published="10.43", stepped="10.43", exact="10.4247", path=()
    )
    assert case.matches
    assert case.policies == ("u*", "pure-evade")
    assert not case.is_optimal
    assert not Case(
        "optimal", "optimal", published="10.43", stepped="10.42", exact="10.42", path=()
    ).matches
