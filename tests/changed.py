"""`python -m tests changed`: the checks and tests that a change reaches, nearest first.

A file counts as changed if it differs from `main`; on `main`, if it is not committed or is in the last commit. The
tests that import a changed module run, directly or by way of other modules, nearest first, until they fill the time
given; the rest is left to `python -m tests`. A changed file that is not Python reaches what names it. Mutants are made
of the changed functions of the files that `tests/mutants.py` names.
"""

import argparse
import ast
import json
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from tests import mutants
from tests.__main__ import FIRST, LONGER, PYTEST, ROOT, SHORT, STEPS, Step, cache_of, run

WITHIN_S = 25.0
"""Processor time of the tests, beside the checks."""

LINE_S = 0.002
"""Processor time of a test file that has never run here, for each of its lines."""

MODULES = ("guidance", "sitl_mock", "tests")

COMMENTS = re.compile(r"#[^\n]*")
IMPORTS = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]+)|import[ \t]+([^\n]+))",
    re.MULTILINE,
)
"""Import statements; reading whole files with `ast` takes twenty times as long."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the change reaches; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests changed", description=__doc__)
    parser.add_argument("--since", metavar="COMMIT", help="compare with this commit")
    parser.add_argument(
        "--within", type=float, default=WITHIN_S, metavar="S", help="processor time of the tests"
    )
    given = parser.parse_args(arguments)
    since = given.since or _since()
    changed = _changed(since)
    if not changed:
        print(f"nothing differs from {since}")
        return 0
    print(f"{len(changed)} files differ from {since}: {', '.join(changed)}")
    distances = reached(changed, sources())
    files = sorted(
        (file for file in distances if Path(file).match("test_*.py") and (ROOT / file).exists()),
        key=lambda file: (distances[file], file),
    )
    chosen = list(_within(files, given.within))
    print(
        f"{len(files)} files of tests are reached; the nearest {len(chosen)} run"
        + (", the others with `python -m tests`" if len(files) > len(chosen) else "")
    )
    steps = dict(STEPS | LONGER)
    lanes = [["types"]]
    if chosen:
        steps["tests"] = Step(STEPS["tests"].what, (*PYTEST, "-m", SHORT, *chosen))
        lanes.append(["tests"])
    for file in sorted(set(changed) & set(mutants.TESTS)):
        names = changed_functions(_at(since, file), (ROOT / file).read_text(encoding="utf-8"))
        if names:
            only = [word for name in names for word in ("--only", name)]
            command = (sys.executable, "-m", "tests.mutants", file, *only, "--jobs", "1")
            steps[f"mutants of {Path(file).name}"] = Step(f"mutants of {', '.join(names)}", command)
            lanes[0].append(f"mutants of {Path(file).name}")
    return run(steps, FIRST, lanes)


def _git(*arguments: str) -> str:
    done = subprocess.run(("git", *arguments), cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def _since() -> str:
    """Return the commit to compare with: where this branch left `main`; on it, the last commit or the one before."""
    head = _git("rev-parse", "HEAD")
    for main_branch in ("main", "origin/main"):
        try:
            base = _git("merge-base", "HEAD", main_branch)
        except subprocess.CalledProcessError:
            continue
        if base != head:
            return base
    return head if _git("status", "--porcelain") else f"{head}~1"


def _changed(since: str) -> list[str]:
    """Return the files that differ from a commit, also those that git does not know yet."""
    tracked = _git("diff", "--name-only", since).splitlines()
    return sorted({*tracked, *_git("ls-files", "--others", "--exclude-standard").splitlines()})


def _at(commit: str, file: str) -> str:
    """Return a file at a commit; empty if it was not there."""
    done = subprocess.run(
        ("git", "show", f"{commit}:{file}"), cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout


def sources() -> dict[str, str]:
    """Return the text of every Python file of the packages and tests, by its path."""
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for package in MODULES
        for path in sorted((ROOT / package).rglob("*.py"))
    }


def reached(changed: Iterable[str], files: Mapping[str, str]) -> dict[str, int]:
    """Return the files that a change reaches, and by how many imports.

    Args:
        changed: Paths of the changed files.
        files: Text of every Python file by its path.
    """
    importers = defaultdict(set)
    for file, text in files.items():
        for imported in _imported(text, files):
            importers[imported].add(file)
        if file.endswith("/conftest.py"):
            folder = file.removesuffix("conftest.py")
            importers[file] |= {other for other in files if other.startswith(folder)}
    for file in set(changed) - set(files):  # a page, a scenario, a recording
        importers[file] = set(_naming(Path(file), files))
    distances = dict.fromkeys(changed, 0)
    ahead = list(distances)
    for file in ahead:  # grows while it is read: breadth first
        new = importers[file] - set(distances)
        distances |= dict.fromkeys(new, distances[file] + 1)
        ahead += sorted(new)
    return distances


def _naming(path: Path, files: Mapping[str, str]) -> Iterator[str]:
    """Yield the files that name another one, with its ending or without it as a text."""
    for file, text in files.items():
        if path.name in text or f'"{path.stem}"' in text:
            yield file


def _imported(text: str, files: Mapping[str, str]) -> Iterator[str]:
    """Yield the files of the project that a module imports, also within its functions."""
    for module, names, modules in IMPORTS.findall(COMMENTS.sub("", text)):
        named = [
            name.split()[0] for name in (names or modules).strip("()").split(",") if name.strip()
        ]
        if module:
            named = [module, *(f"{module}.{name}" for name in named)]
        for name in named:
            path = name.replace(".", "/")
            yield from (file for file in (f"{path}.py", f"{path}/__init__.py") if file in files)


def _within(files: Sequence[str], limit_s: float) -> Iterator[str]:
    """Yield files of tests as long as they fit in the time; the first always does."""
    spent_s = defaultdict(float)
    for step in STEPS | LONGER:
        results = cache_of(step) / "v" / "tests"
        if results.is_file():
            for test, (_, seconds) in json.loads(results.read_text(encoding="utf-8")).items():
                spent_s[test.partition("::")[0]] += seconds
    left_s = limit_s
    for file in files:
        lines = (ROOT / file).read_text(encoding="utf-8").count("\n")
        needed_s = spent_s.get(file, LINE_S * lines)
        if needed_s <= left_s or left_s == limit_s:
            left_s -= needed_s
            yield file


def changed_functions(before: str, after: str) -> list[str]:
    """Return the functions of a file that are new or differ, as `python -m tests mutants --only` names them."""
    functions = {
        name: {
            node.name: ast.dump(node)
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        }
        for name, text in (("before", before), ("after", after))
    }
    return [
        name for name, body in functions["after"].items() if functions["before"].get(name) != body
    ]


if __name__ == "__main__":
    sys.exit(main())
