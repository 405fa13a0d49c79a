import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # importlib mode gives test files no other way to share a module


@pytest.fixture(scope="session")
def router():
    from links_rigs import router

    with router() as opened:
        yield opened
