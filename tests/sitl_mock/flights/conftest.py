import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3]))  # importlib mode gives test files no other way to share a module
