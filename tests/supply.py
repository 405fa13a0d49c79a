"""Software bill of materials of an installation, and an audit for known vulnerabilities.

    python -m tests.supply                           # CycloneDX 1.6, JSON, of the packages that are installed here
    python -m tests.supply --extras all --out bom.json
    python -m tests.supply --constraints             # the same as pip constraints: docs/how-to/constraints.txt
    python -m tests.supply --audit                   # asks the database of pip-audit

Ends with 1 if an audited package has a known vulnerability, and with 3 if the database cannot be reached.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Iterable, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = "pursuit-guidance"
BUILT_WITH = ("hatchling",)
UNREACHABLE = 3

Packages = dict[str, tuple[Distribution, set[str]]]
"""Name -> the installed distribution and the names of its requirements."""


def installed(extras: Iterable[str], tools: Iterable[str] = ()) -> Packages:
    """Return the project with these extras, other tools, and everything that they require, as far as installed."""
    found: Packages = {}
    waiting = [(PROJECT, frozenset(extras)), *((tool, frozenset[str]()) for tool in tools)]
    seen = set(waiting)
    while waiting:
        name, wanted = waiting.pop()
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue
        needs = found.setdefault(name, (package, set()))[1]
        for required in map(Requirement, package.requires or ()):
            marker = required.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *wanted)):
                needs.add(canonicalize_name(required.name))
                one = (canonicalize_name(required.name), frozenset(required.extras))
                if one not in seen:
                    seen.add(one)
                    waiting.append(one)
    return dict(sorted(found.items()))


def bill(packages: Packages) -> str:
    """Return the bill of materials as CycloneDX 1.6 in JSON. Equal packages give an equal bill."""
    components = {name: _component(name, package) for name, (package, _) in packages.items()}
    content = " ".join(component.purl.to_string() for component in components.values())
    document = Bom(serial_number=uuid.uuid5(uuid.NAMESPACE_URL, content))
    document.metadata.timestamp = None
    document.metadata.component = components[PROJECT]
    document.components.update(components[name] for name in components if name != PROJECT)
    for name, (_, needs) in packages.items():
        requirements = [components[need] for need in needs if need in components]
        document.register_dependency(components[name], requirements)
    return JsonV1Dot6(document).output_as_string(indent=2)


def _component(name: str, package: Distribution) -> Component:
    purl = PackageURL("pypi", None, name, package.version)
    kind = ComponentType.APPLICATION if name == PROJECT else ComponentType.LIBRARY
    return Component(
        name=name,
        version=package.version,
        type=kind,
        purl=purl,
        bom_ref=purl.to_string(),
        licenses=[LicenseFactory().make_from_string(licence) for licence in _licences(package)],
    )


def _licences(package: Distribution) -> list[str]:
    """Return the SPDX expression, or else the licences' names from the classifiers or the older field."""
    expressions = package.metadata.get_all("License-Expression")
    if expressions:
        return expressions[:1]
    classifiers = package.metadata.get_all("Classifier") or []
    names = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License ::")]
    if names:
        return names
    fields = package.metadata.get_all("License") or []
    return [
        field.strip().splitlines()[0] for field in fields if field.strip()
    ]  # it may be a whole text


def constraints(packages: Packages) -> str:
    """Return one line `name==version` for each package but the project."""
    return "".join(
        f"{name}=={one.version}\n" for name, (one, _) in packages.items() if name != PROJECT
    )


def audit(packages: Packages, command: Sequence[str] = (sys.executable, "-m", "pip_audit")) -> int:
    """Ask the database of pip-audit about every package; print the result and return the exit code."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write(constraints(packages))
        file.flush()
        arguments = [
            *command,
            "--requirement",
            file.name,
            "--no-deps",
            "--disable-pip",
            "--format",
            "json",
        ]
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    try:
        rows = json.loads(done.stdout)["dependencies"]
    except ValueError:
        last = (done.stderr.strip().splitlines() or ["no output"])[-1]
        how = "; pip install pip-audit" if "No module named" in last else ""
        print(f"not audited: pip-audit gave no result ({last}){how}", file=sys.stderr)
        return UNREACHABLE
    audited = [row for row in rows if "skip_reason" not in row]
    for row in rows:
        for one in row.get("vulns", ()):
            print(
                f"{row['name']} {row['version']}: {one['id']}, fixed in {', '.join(one['fix_versions']) or 'none'}"
            )
    print(f"{len(audited)} of {len(rows)} packages audited")
    if not audited:
        print(
            "not audited: the database knows none of them; is it a mirror? Repeat with network access",
            file=sys.stderr,
        )
        return UNREACHABLE
    return int(any(row.get("vulns") for row in rows))


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.supply", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--extras", default="all", help="separated by commas; default: all")
    parser.add_argument("--out", type=Path, help="a file; default: standard output")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--constraints", action="store_true", help="pip constraints instead of the bill"
    )
    what.add_argument("--audit", action="store_true", help="ask for known vulnerabilities")
    given = parser.parse_args(arguments)
    packages = installed(given.extras.split(","), BUILT_WITH if given.constraints else ())
    if given.audit:
        return audit(packages)
    text = constraints(packages) if given.constraints else bill(packages) + "\n"
    if given.out is None:
        print(text, end="")
    else:
        given.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
