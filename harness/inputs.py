"""Opens what a configuration asks for: live or recorded traffic before a sensor, or an earlier run's recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from harness import runfolder
from harness.config import RunConfig
from harness.cosim import Streams
from harness.errors import UserError
from harness.runinputs import RunInputs

if TYPE_CHECKING:
    from harness.truth.network import Network


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
    from harness.replay import open_recording  # noqa: PLC0415

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
    from harness.truth.network import load_network  # noqa: PLC0415
    from harness.truth.sumo import open_traffic  # noqa: PLC0415

    traffic = config.traffic
    network = load_network(traffic.net)
    if network.configuration is not None and traffic.density is not None:
        raise UserError(f"--density: {network.name} brings its own demand; leave --density out")
    truth = open_traffic(
        network,
        density=traffic.density,
        demand=traffic.demand,
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
