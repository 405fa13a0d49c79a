"""Who notices a mutant: judged in a fork of one process that has collected the tests, or in a package imported anew."""

import ast
import importlib
import inspect
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Mapping
from importlib.machinery import SourceFileLoader
from types import FunctionType

import pytest
from mutant_survey import OPTIONS
from mutation import Mutant, bare, in_child, modules

LIMIT = "the limit of processor time"
TIMES, SPARE_S = 5.0, 3.0


def plant(mutant: Mutant) -> bool:
    """Put what was changed in the place of the original's, in a running package; say whether that can be done."""
    module = importlib.import_module(f"guidance.game.{mutant.stem}")
    space = dict(vars(module))
    exec(compile(mutant.text, str(module.__file__), "exec"), space)
    if not mutant.function:
        names = assigned_names(mutant.text)
        return bool(names) and all(replace_constant(name, space[name]) for name in names)
    live, changed = (function_named(names, mutant.function) for names in (vars(module), space))
    if live is None or changed is None or parts_of(live) == parts_of(changed):
        return False
    live.__code__, live.__defaults__, live.__kwdefaults__ = (
        changed.__code__,
        changed.__defaults__,
        changed.__kwdefaults__,
    )
    return True


def replace_constant(name: str, value: object) -> bool:
    """Give a constant another value in every module that has it by its name."""
    holders = [one for known, one in sys.modules.items() if known.startswith("guidance.") and hasattr(one, name)]
    for holder in holders:
        setattr(holder, name, value)
    return bool(holders)


def assigned_names(text: str) -> list[str]:
    """Return the names that a statement gives values to; none of a class, whose values are in use elsewhere."""
    (statement,) = ast.parse(text).body
    targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
    return [one.id for one in targets if isinstance(one, ast.Name)]


def parts_of(function: FunctionType) -> tuple[object, ...]:
    """Return what a function does, and with which defaults."""
    return bare(function.__code__), repr(function.__defaults__), repr(function.__kwdefaults__)


def function_named(names: Mapping[str, object], name: str) -> FunctionType | None:
    """Return the function of a name, out of whatever it is wrapped in."""
    first, *rest = name.split(".")
    found = names[first]
    for part in rest:
        found = inspect.getattr_static(found, part)
    found = getattr(found, "fget", None) or getattr(found, "__func__", found)
    found = inspect.unwrap(found)
    return found if inspect.isfunction(found) else None


def limit_test(cost_s: float) -> None:
    """Let a test end the process that takes many times what it should."""
    limit = int(time.process_time() + SPARE_S + TIMES * cost_s) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))


class Order:
    """A pytest plugin: the given tests in the given order, each within its own limit of processor time."""

    def __init__(self, costs_s: dict[str, float], tell: Callable[[str], None]) -> None:
        self.costs_s, self.order, self.tell = costs_s, {name: place for place, name in enumerate(costs_s)}, tell

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items) -> None:
        """Choose the tests and put them in order."""
        items[:] = sorted((one for one in items if one.nodeid in self.order), key=lambda one: self.order[one.nodeid])

    def pytest_runtest_logstart(self, nodeid, location) -> None:
        """Set the limit of a test."""
        limit_test(self.costs_s[nodeid])

    def pytest_runtest_logreport(self, report) -> None:
        """Name the test that failed."""
        if report.failed:
            self.tell(report.nodeid)


class Forks:
    """A pytest plugin: once the tests are collected, every mutant is judged in a fork of this process."""

    def __init__(self, judge_all: Callable[[Callable[[Mutant, dict[str, float]], str | None]], None]) -> None:
        self.judge_all = judge_all

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session) -> bool:
        """Judge them all."""
        self.items = {one.nodeid: one for one in session.items}
        self.judge_all(self.judge)
        return True

    def judge(self, mutant: Mutant, limits: dict[str, float]) -> str | None:
        """Return who noticed a mutant, or nothing; None where it cannot be planted in a running package."""

        def work(tell: Callable[[str], None]) -> int:
            if not plant(mutant):
                return 3
            self.failed = ""
            tests = [self.items[name] for name in limits]
            for item, after in zip(tests, [*tests[1:], None], strict=True):
                limit_test(limits[item.nodeid])
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
                if self.failed:
                    tell(self.failed)
                    return 1
            return 0

        status, told = in_child(work)
        return None if os.WIFEXITED(status) and os.WEXITSTATUS(status) == 3 else verdict(status, told)

    def pytest_runtest_logreport(self, report) -> None:
        """Keep which test failed."""
        if report.failed:
            self.failed = report.nodeid


def verdict(status: int, told: str) -> str:
    """Return who noticed a mutant, by how its child ended and what that told."""
    if os.WIFSIGNALED(status):
        ended = signal.Signals(os.WTERMSIG(status))
        return {signal.SIGXCPU: LIMIT, signal.SIGALRM: LIMIT}.get(ended, ended.name)
    return told.split("\n", maxsplit=1)[0] or ("the import" if status else "")


def judge_afresh(mutant: Mutant, limits: dict[str, float]) -> str:
    """Return who notices a mutant of a package imported anew, or nothing."""
    if not limits:
        return ""
    tree = ast.parse(modules()[mutant.stem].read_text())
    tree.body[mutant.place] = ast.parse(mutant.text).body[0]

    def work(tell: Callable[[str], None]) -> int:
        original = SourceFileLoader.get_code

        def get_code(self, name):
            if name == f"guidance.game.{mutant.stem}":
                return compile(tree, self.path, "exec")
            return original(self, name)

        SourceFileLoader.get_code = get_code
        return int(
            pytest.main([*OPTIONS, *sorted({name.split("::")[0] for name in limits})], plugins=[Order(limits, tell)])
        )

    return verdict(*in_child(work))
