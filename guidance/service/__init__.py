"""The flight's record as it is written, and what is broadcast of it."""
