"""The plot of a calibration: command, real vehicle, mock, and the difference below."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from sitl_mock.calibrate.comparison import RMS_LIMIT_M_S, Comparison
from sitl_mock.calibrate.step_log import StepLog
from sitl_mock.errors import ConfigError

_AXES = ("north", "east", "down")


def draw(path: Path, log: StepLog, comparison: Comparison) -> None:
    """Write the plot to a file; its ending decides the format.

    Raises:
        ConfigError: The ending is not a picture format, or the file cannot be written.
    """
    figure = Figure(figsize=(14.0, 10.0), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(3, 3, 3, 2))
    mock = comparison.mock_velocity_ned_m_s
    for axis, (panel, name) in enumerate(zip(panels[:3], _AXES, strict=True)):
        panel.step(
            log.time_s,
            log.command_ned_m_s[:, axis],
            "k--",
            linewidth=0.8,
            where="post",
            label="command",
        )
        panel.plot(
            log.time_s, log.velocity_ned_m_s[:, axis], color="tab:blue", linewidth=1.4, label="real"
        )
        panel.plot(log.time_s, mock[:, axis], color="tab:orange", linewidth=1.0, label="mock")
        panel.set_ylabel(f"{name} velocity (m/s)")
        panel.set_title(
            f"{name}: RMS difference {comparison.rms_ned_m_s[axis]:.3f} m/s",
            loc="left",
            fontsize="medium",
        )
        panel.grid(alpha=0.3)
        panels[3].plot(
            log.time_s, mock[:, axis] - log.velocity_ned_m_s[:, axis], linewidth=0.8, label=name
        )
    panels[0].legend(loc="upper center", ncols=3)
    panels[3].axhspan(-RMS_LIMIT_M_S, RMS_LIMIT_M_S, color="tab:green", alpha=0.1)
    panels[3].set_ylabel("mock less real (m/s)")
    panels[3].set_xlabel("time (s)")
    panels[3].legend(loc="upper right", ncols=3)
    panels[3].grid(alpha=0.3)
    figure.suptitle(f"{comparison.flavour.value}: the mock against the real autopilot")
    try:
        with mpl.rc_context({"svg.hashsalt": "sitl-mock"}):
            figure.savefig(path, dpi=100)
    except (OSError, ValueError) as error:
        msg = f"the plot {path} cannot be written: {error}"
        raise ConfigError(msg) from error
