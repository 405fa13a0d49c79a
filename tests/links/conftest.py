import pytest


@pytest.fixture(scope="session")
def router():
    from tests.links.rigs import router

    with router() as opened:
        yield opened
