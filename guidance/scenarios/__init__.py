"""Scenarios and mocked flights as pictures."""
