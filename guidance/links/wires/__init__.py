"""Wires: UDP, TCP, serial ports and memory; bytes in both directions, and the counts of what passed."""
