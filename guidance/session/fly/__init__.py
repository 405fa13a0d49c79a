"""A flight in progress: the loop, a vehicle's daemon, the mission around it, and the result."""
