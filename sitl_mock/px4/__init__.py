"""The PX4 flavour."""

from sitl_mock.px4.flavour import PX4

__all__ = ["PX4"]
