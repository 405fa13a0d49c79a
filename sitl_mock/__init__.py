"""A mock autopilot that real MAVLink clients can fly: PX4, ArduCopter and a rover, nothing to build."""
