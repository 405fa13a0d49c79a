"""Scenario files, and the runner that flies them: in virtual time in one process, or in real time against a child."""
