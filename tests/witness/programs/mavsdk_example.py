"""Run an example of MAVSDK unchanged, except that it connects to a URL: mavsdk_example.py PATH URL [ARGUMENT...]."""

import runpy
import socket
import sys

import mavsdk


def free_port() -> int:
    """Return a free TCP port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def connect_version_3(url: str) -> None:
    """Let the server of MAVSDK 3 have a port of its own and connect to the URL."""
    begin = mavsdk.System.__init__
    connect = mavsdk.System.connect

    def begin_on_a_free_port(system: mavsdk.System, *_: object, **__: object) -> None:
        begin(system, port=free_port())

    async def connect_to_the_url(system: mavsdk.System, *_: object, **__: object) -> None:
        await connect(system, system_address=url)

    mavsdk.System.__init__ = begin_on_a_free_port
    mavsdk.System.connect = connect_to_the_url


def connect_version_4(url: str) -> None:
    """Let MAVSDK 4 connect to the URL, and its asyncio interface have the name that the examples import."""
    add = mavsdk.Mavsdk.add_any_connection

    def add_the_url(instance: mavsdk.Mavsdk, *_: object, **__: object) -> object:
        return add(instance, url)

    mavsdk.Mavsdk.add_any_connection = add_the_url


def main() -> None:
    """Run the example."""
    path = sys.argv[1]
    url = sys.argv[2]
    if hasattr(mavsdk, "Mavsdk"):
        connect_version_4(url)
    else:
        connect_version_3(url)
    sys.argv = [path, url, *sys.argv[3:]]
    runpy.run_path(path, run_name="__main__")


if __name__ == "__main__":
    main()
