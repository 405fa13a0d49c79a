"""Sweeps: a scenario played a million times over, kept as it goes, told in tables and pictures, and compared."""
