"""Scenarios: their files, their play by point masses, the sensor, the mock's world, and outcomes."""
