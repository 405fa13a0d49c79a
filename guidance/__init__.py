"""Closed-form pursuit guidance for real autopilots (Li, Wang & Xie, arXiv 2202.13522).

`from guidance import game` is the mathematics; `guidance.__version__` is the version that is installed.
"""


def __getattr__(name: str) -> str:
    """Return `__version__`, looked up only on access."""
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - what reads packages takes a tenth of a second

        return version("pursuit-guidance")
    raise AttributeError(f"module 'guidance' has no attribute {name!r}")
