"""Every kind of fault, by name."""

from collections.abc import Mapping
from types import MappingProxyType

from sitl_mock.faults.acks import ACK_KINDS
from sitl_mock.faults.contents import CONTENT_KINDS
from sitl_mock.faults.effect import Kind
from sitl_mock.faults.evader import EVADER_KINDS
from sitl_mock.faults.links import LINK_KINDS
from sitl_mock.faults.other_senders import STRANGER_KINDS
from sitl_mock.faults.vehicle import FLIGHT_KINDS

KINDS: Mapping[str, Kind] = MappingProxyType(
    {**LINK_KINDS, **ACK_KINDS, **CONTENT_KINDS, **STRANGER_KINDS, **FLIGHT_KINDS, **EVADER_KINDS}
)
