"""Scenarios: their files, how point masses play them, what a sensor makes of it, the mock's world, and outcomes."""
