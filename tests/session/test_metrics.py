"""The metrics server: on loopback only, and idle connections cost nothing."""

import contextlib
import http.client
import socket
import threading
import urllib.request

import pytest

from guidance.errors import LinkError
from guidance.session.observe.metrics import MAX_CONNECTIONS, Metrics, MetricsServer


@pytest.fixture
def served():
    """Start servers with a deadline; all are closed at the end."""
    with contextlib.ExitStack() as closing:

        def start(**deadline):
            metrics = Metrics("uav1")
            metrics.order("hold", accepted=True)
            return closing.enter_context(contextlib.closing(MetricsServer(metrics, 0, **deadline)))

        yield start


@pytest.fixture
def server(served):
    return served()


def read(server):
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/metrics", timeout=5.0) as page:
        return page.read().decode()


def connected(server):
    return socket.create_connection(("127.0.0.1", server.port), 5.0)


def test_metrics_are_served_on_loopback_and_nowhere_else(server):
    assert 'guidance_orders_total{accepted="true",order="hold",vehicle="uav1"} 1.0' in read(server)
    with pytest.raises(LinkError, match=f"metrics.port = {server.port}"):
        MetricsServer(Metrics("uav2"), server.port)


def test_only_get_is_answered(server):
    client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=5.0)
    client.request("POST", "/metrics", b"x")
    assert client.getresponse().status == http.client.METHOD_NOT_ALLOWED
    client.close()


def test_idle_connections_need_no_thread_and_keep_no_reader_out(server):
    before = threading.active_count()
    idle = [connected(server) for _ in range(5 * MAX_CONNECTIONS)]
    assert "guidance_orders_total" in read(server)
    assert threading.active_count() == before
    assert idle[0].recv(1) == b""  # the oldest was closed to make room
    for one in idle:
        one.close()


def test_a_connection_that_sends_no_whole_request_is_closed_at_the_deadline(served):
    slow = connected(served(deadline_s=0.05))
    slow.sendall(b"GET /metrics HTTP/1.1\r\n")
    assert slow.recv(1) == b""
    slow.close()
