"""Opens a flight: with a mock, the vehicle of a file, or vehicles at URLs. Each way returns the same `Opened`."""
