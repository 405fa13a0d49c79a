"""Bytes to and from somewhere, one module for each kind of wire; `guidance.links.port.Wire` says what all of them keep.

`udp`, `tcp`, `serial` and `zenoh` reach a vehicle; `memory` joins two ends in one process; `shared` is one wire for
several readers, or with a record that listens in; `stream` keeps frames whole where a write may take only a part.
Each is imported apart, since Zenoh and pyserial come with theirs.
"""
