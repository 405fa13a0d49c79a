"""What a flight needs, opened: a mock, the vehicle of a file, or vehicles at URLs. Each returns the same `Opened`."""
