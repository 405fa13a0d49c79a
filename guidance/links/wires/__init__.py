"""Carriers of MAVLink bytes; `guidance.links.port.Wire` is their contract.

`udp`, `streams` (TCP, serial) and `zenoh` reach a vehicle. `shared` has their common base, and the wires around
and between others: in memory, shared by several readers, captured for a record. Each module is imported separately,
because Zenoh and pyserial load with theirs.
"""
