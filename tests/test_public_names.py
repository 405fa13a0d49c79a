"""What a package offers is listed in its `__init__`, each name with a sentence; everything else is private."""

import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

import guidance

DOCS = Path(__file__).parents[1] / "docs"
PACKAGES = [one.name for one in pkgutil.walk_packages(guidance.__path__, "guidance.") if one.ispkg]
OFFERING = [name for name in PACKAGES if hasattr(importlib.import_module(name), "__all__")]


@pytest.mark.parametrize("name", OFFERING)
def test_every_public_name_has_a_sentence_where_help_shows_it(name):
    package = importlib.import_module(name)
    words = inspect.getdoc(package)
    said = set(re.findall(r"\w+", words))
    assert [one for one in package.__all__ if one not in said] == []
    for one in package.__all__:
        what = getattr(package, one)
        assert not (inspect.isclass(what) or inspect.isfunction(what)) or what.__doc__, one


@pytest.mark.parametrize("name", OFFERING)
def test_what_is_offered_is_there_and_has_types(name):
    package = importlib.import_module(name)
    for one in package.__all__:
        what = getattr(package, one)
        if inspect.isfunction(what):
            parameters = inspect.signature(what).parameters.values()
            assert all(parameter.annotation is not parameter.empty for parameter in parameters), one


def test_the_page_of_what_is_stable_names_packages_that_are_there():
    named = set(re.findall(r"`(guidance(?:\.\w+)+)`", (DOCS / "stable.md").read_text()))
    assert named
    for name in named:
        importlib.import_module(name)
