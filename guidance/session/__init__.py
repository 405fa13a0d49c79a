"""A flight from its specification: one loop for every world, its orders and its outputs."""
