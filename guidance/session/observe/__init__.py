"""Outputs of a flight: the record, the log, metrics, signs of life, and every further one."""
