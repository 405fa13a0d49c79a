"""What flies a real vehicle works without the simulator."""

import subprocess
import sys

MODULES = ("fly.loop", "fly.daemon", "service", "checkup")


def test_the_loop_and_daemon_of_a_real_vehicle_import_no_simulator():
    """Catches a simulator that is loaded beside a real vehicle."""
    imported = ", ".join(f"guidance.session.{module}" for module in MODULES)
    code = f"import sys, {imported}; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    simulator = [
        name for name in done.stdout.split() if name.startswith(("guidance.sim", "sitl_mock"))
    ]
    assert simulator == []
