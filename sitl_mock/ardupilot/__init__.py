"""The ArduPilot flavours: ArduCopter and Rover."""
