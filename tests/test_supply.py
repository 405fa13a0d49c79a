"""The bill of materials names what is installed, and the container's constraints what was tested."""

import json
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests import supply

ROOT = Path(__file__).parents[1]


def declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    lines = [
        *project["dependencies"],
        *(
            line
            for name in extras
            if name not in {"test", "dev", "torch", "jax"}
            for line in extras[name]
        ),
    ]
    requirements = [Requirement(line) for line in lines]
    return [requirement for requirement in requirements if requirement.name != supply.PROJECT]


def test_the_bill_names_every_package_with_its_version_and_what_it_requires(capsys):
    """Catches a dependency that the bill of materials leaves out."""
    assert supply.main([]) == 0
    bill = json.loads(capsys.readouterr().out)
    components = {part["name"]: part for part in bill["components"]}
    names = {canonicalize_name(requirement.name) for requirement in declared()}
    assert names <= set(components)
    assert all(part["version"] == version(name) for name, part in components.items())
    assert [name for name, part in components.items() if not part.get("licenses")] == []
    refs = {part["bom-ref"] for part in [bill["metadata"]["component"], *bill["components"]]}
    needs = {entry["ref"]: set(entry.get("dependsOn", ())) for entry in bill["dependencies"]}
    assert set(needs) == refs
    assert set().union(*needs.values()) <= refs
    assert components["pydantic-core"]["bom-ref"] in needs[components["pydantic"]["bom-ref"]]


def test_equal_installations_have_equal_bills():
    assert supply.bill(supply.installed([])) == supply.bill(supply.installed([]))


def test_the_bill_of_a_base_installation_has_no_extras():
    base = supply.installed([])
    assert {"numpy", "mavsdk"} <= set(base)
    assert not {"pyarrow", "rerun-sdk", "aiohttp"} & set(base)


def test_the_containers_constraints_pin_every_declared_package_to_an_allowed_version():
    text = (ROOT / "docs" / "how-to" / "constraints.txt").read_text(encoding="utf-8")
    pinned = dict(line.split("==") for line in text.splitlines() if not line.startswith("#"))
    assert all(
        requirement.specifier.contains(pinned[canonicalize_name(requirement.name)])
        for requirement in declared()
    )


@pytest.mark.parametrize(
    ("found", "code", "words"),
    [
        (
            '{"dependencies": [{"name": "a", "version": "1", "vulns": []}]}',
            0,
            "1 of 1 packages audited",
        ),
        (
            '{"dependencies": [{"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]}]}',
            1,
            "a 1: CVE-1, fixed in 2",
        ),
        (
            '{"dependencies": [{"name": "a", "skip_reason": "not found"}]}',
            3,
            "the database knows none of them",
        ),
        ("", 3, "pip-audit gave no result (no output)"),
    ],
)
def test_an_audit_says_whether_the_database_answered(tmp_path, capsys, found, code, words):
    (tmp_path / "found").write_text(found)
    answering = (sys.executable, "-c", f"print(open({str(tmp_path / 'found')!r}).read())")
    assert supply.audit(supply.installed([]), answering) == code
    assert words in "".join(capsys.readouterr())
