"""A flight from its specification: one loop, in whichever world, with its orders and whom it tells."""
