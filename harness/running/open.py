"""Opens what a configuration asks for: live or recorded traffic before a sensor, or an earlier run's recording."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.config.model import RunConfig
from harness.errors import UserError
from harness.runfolder import folder as runfolder
from harness.running.follow import AnyTracker, Streams
from harness.sensor.observation import Sensor
from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import TrackerSetting
from harness.truth.frame import TruthSource
from mmpf.registry import UnknownNameError
from mmpf.road import highway
from mmpf.scan import SensorModel

if TYPE_CHECKING:
    from harness.truth.network.network import Network


def open_inputs(config: RunConfig, streams: Streams, gui: bool = False) -> RunInputs:
    """Open what the configuration asks for.

    Args:
        config: The configuration.
        streams: The run's randomness, of which the traffic uses its part.
        gui: Whether simulated traffic is shown in a window.

    Raises:
        UserError: There is no such network, demand, sensor or recording, or it is broken; or no window can be opened.
    """
    if config.replay is None:
        return _open_live(config, streams, gui)
    path = Path(config.replay)
    if not runfolder.is_run_folder(path):
        return _open_recorded_traffic(path, config)
    from harness.running.replay import open_recording  # noqa: PLC0415

    return open_recording(path, config)


def _open_recorded_traffic(path: Path, config: RunConfig) -> RunInputs:
    from harness.sensor.detector import build_sensor  # noqa: PLC0415
    from harness.sensor.profiles import sensor_settings  # noqa: PLC0415
    from harness.truth.recorded.formats import files_of  # noqa: PLC0415
    from harness.truth.recorded.source import open_recorded_traffic  # noqa: PLC0415

    traffic, recording = config.traffic, config.traffic.recording
    if recording is None:
        raise UserError(f"--replay: {path} is not a run's folder, and no format of recorded traffic is set")
    sensor = build_sensor(sensor_settings(config.sensor.profile, config.sensor.overrides))
    truth = open_recorded_traffic(
        path, recording.format, traffic.net, recording.ego, traffic.duration_s, recording.start_s
    )
    return RunInputs(
        truth=truth,
        sensor=sensor,
        files={f"replay/{file.name}": file for file in files_of(path)},
        report=truth.report(),
        about={"recording": truth.summary()},
    )


def _open_live(config: RunConfig, streams: Streams, gui: bool) -> RunInputs:
    from harness.sensor.detector import build_sensor  # noqa: PLC0415
    from harness.sensor.profiles import sensor_settings  # noqa: PLC0415

    # The sensor is checked first: it costs nothing, while opening traffic starts a simulation.
    sensor = build_sensor(sensor_settings(config.sensor.profile, config.sensor.overrides))
    from harness.truth.network.network import load_network  # noqa: PLC0415
    from harness.truth.sumo.simulation import open_traffic  # noqa: PLC0415

    traffic = config.traffic
    network = load_network(traffic.net)
    if network.configuration is not None and traffic.density is not None:
        raise UserError(f"--density: {network.name} brings its own demand; leave --density out")
    truth = open_traffic(
        network,
        demand=traffic.density if traffic.demand is None else traffic.demand,
        duration_s=traffic.duration_s,
        seed=streams.truth,
        gui=gui,
    )
    return RunInputs(truth=truth, sensor=sensor, files=_network_files(network))


def _network_files(network: Network) -> dict[str, Path]:
    files = {"net_file": network.net_file}
    if network.vehicle_types_file is not None:
        files["vehicle_types_file"] = network.vehicle_types_file
    if network.calibration_file is not None and network.calibration_file.is_file():
        files["calibration_file"] = network.calibration_file
    return files


def check_tracker(config: RunConfig) -> None:
    """Build the tracker once for nothing, so that a wrong option is told before any traffic is simulated.

    Raises:
        UserError: There is no such tracker or it refuses its options.
    """
    setting = TrackerSetting(road=highway(), sensor=SensorModel(), rng=np.random.default_rng(0))
    _build_tracker(config, setting)


def check_gui(config: RunConfig) -> None:
    """Check that there is traffic to be shown, and a window to show it in.

    Raises:
        UserError: The traffic is recorded, there is no screen, or sumo-gui is not installed.
    """
    if config.replay is not None:
        raise UserError(
            "--gui: --replay uses recorded traffic, so no SUMO runs and there is nothing to open; leave it out"
        )
    from harness.truth.sumo.window import check_window  # noqa: PLC0415

    check_window()


def _build_tracker(config: RunConfig, setting: TrackerSetting) -> AnyTracker:
    try:
        return build_tracker(config.tracker.name, setting, config.tracker.all_options())
    except UnknownNameError as error:
        raise UserError(f"--model: {error}") from None
    except (ValueError, TypeError) as error:
        raise UserError(f"--tracker {config.tracker.name!r}: {error}") from None


@dataclass(frozen=True)
class RunInputs:
    """Truth and sensor of a run.

    Attributes:
        truth: Yields the frames.
        sensor: Looks at them.
        files: The files that decided them, by a name for the manifest.
        report: What the user should know about them; empty if nothing.
        about: Tables about them for ``metrics.json``, by name.
    """

    truth: TruthSource
    sensor: Sensor
    files: Mapping[str, Path] = field(default_factory=dict)
    report: str = ""
    about: Mapping[str, object] = field(default_factory=dict)

    def hashes(self) -> dict[str, str]:
        """Return the SHA-256 of each input file."""
        return {name: _sha256(path) for name, path in self.files.items()}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
