"""Run tests of dronekit's own suite against a vehicle: python dronekit_suite.py ADDRESS MODULE.TEST...

The suite (dronekit.test.sitl, part of the package) is written for nose and Python 2, and starts a simulator by itself.
"""

import collections
import collections.abc
import contextlib
import functools
import importlib
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from types import ModuleType
from typing import Any

Test = Callable[[str], None]
TEST_S = 60.0
"""Time limit of a test: some wait for what a vehicle never does."""
REFRESH_S = 1.0
"""Time until the port of a closed connection is free."""


def equal(expected: object, actual: object, message: str = "") -> None:
    """Stand in for nose's assert_equals."""
    assert expected == actual, message or f"{expected!r} != {actual!r}"


def different(expected: object, actual: object, message: str = "") -> None:
    """Stand in for nose's assert_not_equals."""
    assert expected != actual, message or f"{expected!r} == {actual!r}"


def true(value: object) -> None:
    """Stand in for nose's assert_true."""
    assert value


def false(value: object) -> None:
    """Stand in for nose's assert_false."""
    assert not value


def made_module(name: str, **content: object) -> ModuleType:
    """Put a module in place that the suite imports."""
    module = ModuleType(name)
    vars(module).update(content)
    sys.modules[name] = module
    return module


def prepare(address: str) -> None:
    """Put in place what the suite imports, and give each test the vehicle's address."""
    vars(collections)["MutableMapping"] = collections.abc.MutableMapping
    tools = made_module(
        "nose.tools",
        assert_equal=equal,
        assert_equals=equal,
        assert_not_equals=different,
        assert_true=true,
        assert_false=false,
        with_setup=lambda *_: lambda test: test,
    )
    made_module("nose", tools=tools)
    made_module("dronekit_sitl", SITL=object)
    suite = importlib.import_module("dronekit.test")
    vars(suite)["with_sitl"] = lambda test: functools.partial(test, address)


def outcome(test: Callable[[], None]) -> str:
    """Run a test; return ``passed``, or the exception or the time limit with the test's line."""
    vehicles: list[Any] = []
    dronekit = importlib.import_module("dronekit")
    begin = dronekit.Vehicle.__init__

    def begin_and_remember(vehicle: object, *arguments: object, **named: object) -> None:
        vehicles.append(vehicle)
        begin(vehicle, *arguments, **named)

    dronekit.Vehicle.__init__ = begin_and_remember
    ends: list[str] = []
    runner = threading.Thread(target=lambda: ends.append(ending(test)), daemon=True)
    runner.start()
    runner.join(TEST_S)
    stack = traceback.extract_stack(sys._current_frames().get(runner.ident))
    dronekit.Vehicle.__init__ = begin
    for vehicle in vehicles:
        with contextlib.suppress(Exception):  # a test that passed has closed it
            vehicle.close()
    time.sleep(REFRESH_S)
    return ends[0] if ends else f"did not end ({line_of(stack)})"


def ending(test: Callable[[], None]) -> str:
    """Run a test; return ``passed`` or its exception with the test's line."""
    try:
        test()
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return f"{type(error).__name__} ({line_of(traceback.extract_tb(error.__traceback__))})"
    return "passed"


def line_of(stack: traceback.StackSummary) -> str:
    """Return the innermost line of the suite's own files: ``line 12``."""
    own = [frame for frame in stack if "dronekit/test/sitl" in frame.filename]
    return f"line {own[-1].lineno}" if own else "outside"


def main() -> None:
    """Run the tests in order and print each outcome."""
    prepare(sys.argv[1])
    for name in sys.argv[2:]:
        module, _, function = name.partition(".")
        suite = importlib.import_module(f"dronekit.test.sitl.{module}")
        print(f"{name}: {outcome(getattr(suite, function))}", flush=True)
    os._exit(0)  # a test that did not end still has its thread


if __name__ == "__main__":
    main()
