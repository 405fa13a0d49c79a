"""Stored plans in flight: the legs of a mission, and violations of a fence."""
