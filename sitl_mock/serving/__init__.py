"""A fleet in real time: its files and arguments, its endpoints, its console and its logs."""
