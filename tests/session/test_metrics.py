"""The metrics' page: on loopback only."""

import socket
import urllib.request

import pytest

from guidance.errors import LinkError
from guidance.session.metrics import Metrics, MetricsServer


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_metrics_are_served_on_loopback_and_nowhere_else():
    metrics = Metrics("uav1")
    metrics.order("hold", accepted=True)
    server = MetricsServer(metrics, free_port())
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/metrics", timeout=5.0) as page:
        text = page.read().decode()
    assert 'guidance_orders_total{accepted="true",order="hold",vehicle="uav1"} 1.0' in text
    with pytest.raises(LinkError, match=f"metrics.port = {server.port}"):
        MetricsServer(metrics, server.port)
    server.close()
