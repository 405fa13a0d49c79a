"""One vehicle: its flavour's data, state, sensors, estimate and pilot, its autopilot, and its links."""
