"""Networks: the built-in ones and the user's own SUMO networks.

A network of the project is a folder with a ``network.toml``: which edges are the main road, where the scored section
lies, and which demands are known. Adding a network is adding such a folder to ``networks/``.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

from harness.common.errors import InputError
from harness.common.isolation import ProcessLimits, isolated
from harness.common.untrusted_files import checked_path, require_file
from harness.truth.network.consistency import lanes_under_walls
from harness.truth.network.corridor import Corridor, Ramp, corridor_from_net, ramp_from_net, read_net
from harness.truth.network.demand import Demand, Drivers
from harness.truth.network.lanegraph import PlaneNetwork, read_lane_graph
from harness.truth.network.limits import check_xml
from harness.truth.network.names import METADATA_FILE, check_network, shipped_networks
from harness.truth.network.networkfile import (
    CalibrationFile,
    DemandFile,
    PlaneNetworkFile,
    file_of,
    read_network_file,
)
from harness.truth.network.sumocfg import SumoInputs, read_sumocfg
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import compile_kernels
from mmpf.map.road import Road

PLANE_OPTIONS = (("lateral-resolution", "0.92"), ("time-to-teleport", "-1"), ("collision.action", "warn"))
# Bodies that touch are collisions, and gaps that are merely too small are none.
MAIN_ROAD_OPTIONS = (*PLANE_OPTIONS, ("insertion-checks", "none"), ("collision.mingap-factor", "0"))


@dataclass(frozen=True)
class NetworkDescription:
    """One line about a network, for ``nets``; in the plane the length is that of all lanes, and ``lanes`` is 0."""

    name: str
    description: str
    demands: tuple[tuple[str, str], ...]
    section_length_m: float
    lanes: int
    size_kb: float


@dataclass(frozen=True)
class Network:
    """A network that traffic can be opened on.

    Attributes:
        corridor: The main road's edges and the road frame along them; none where the road frame is the plane.
        ego_lanes: Lanes that an ego is chosen from; none in the plane, where any will do.
        plane: The lanes of a network whose road frame is the plane; none of one with a main road.
        default_demand: The demand that is driven where the user asks for none; none where that is a density.
        sumo_inputs: What SUMO is given.
        unusual: What in its files is possible but unusual, a clause each.
    """

    name: str
    description: str
    sumo_inputs: SumoInputs
    section_m: tuple[float, float]
    corridor: Corridor | None = None
    ego_lanes: tuple[int, ...] = ()
    plane: PlaneNetwork | None = None
    on_ramps: tuple[Ramp, ...] = ()
    off_ramps: tuple[Ramp, ...] = ()
    vehicle_types_file: Path | None = None
    drivers: Drivers = field(default_factory=Drivers)
    demand_files: dict[str, DemandFile] = field(default_factory=dict)
    default_demand: str | None = None
    calibrated: tuple[str, ...] = ()
    calibration_file: Path | None = None
    measured_file: Path | None = None
    configuration: Path | None = None
    unusual: tuple[str, ...] = ()

    @property
    def layout(self) -> Corridor | PlaneNetwork:
        """The main road, or the lanes in the plane."""
        return self.plane or self.main_road

    @property
    def demands(self) -> tuple[str, ...]:
        """Names of the known demands."""
        return tuple(self.demand_files)

    @property
    def net_file(self) -> Path:
        """The file of its roads."""
        return self.sumo_inputs.net_file

    @property
    def files(self) -> tuple[Path, ...]:
        """The XML files that SUMO reads."""
        inputs = self.sumo_inputs
        types = () if self.vehicle_types_file is None else (self.vehicle_types_file,)
        return tuple(dict.fromkeys((self.net_file, *types, *inputs.additional_files, *inputs.route_files)))

    @property
    def is_shipped(self) -> bool:
        """Whether it comes with the project."""
        return any(folder.resolve() in self.net_file.resolve().parents for folder in shipped_networks().values())

    @cached_property
    def road(self) -> Road:
        """The road with the section that is scored."""
        return self.layout.road(self.section_m, self.sumo_inputs.additional_files)

    @cached_property
    def corridor_road(self) -> CorridorRoad:
        """The same where there is a main road.

        Raises:
            InputError: There is none.
        """
        return self.main_road.road(self.section_m)

    @property
    def main_road(self) -> Corridor:
        """The corridor.

        Raises:
            InputError: The network has none.
        """
        if self.corridor is None:
            raise InputError(f"`net` {self.name}: this needs a network with a main road, such as us101")
        return self.corridor

    def fingerprint(self) -> str:
        """Return eight letters that change with the road, the vehicle types and the drivers."""
        digest = hashlib.sha256()
        own = () if self.configuration is not None else (self.vehicle_types_file, *self.sumo_inputs.additional_files)
        for file in filter(None, dict.fromkeys((self.net_file, *own))):
            digest.update(file.read_bytes())
        digest.update(self.drivers.model_dump_json().encode())
        return digest.hexdigest()[:8]

    def demand(self, name: str) -> Demand:
        """Return a named demand.

        Raises:
            InputError: The network has no demand of that name.
        """
        if name not in self.demand_files:
            known = ", ".join(self.demand_files) or "none"
            raise InputError(f"`demand` {name}: {self.name} has no such demand; known are: {known}")
        entry = self.demand_files[name]
        standard = self.demand_for_density(entry.density_veh_per_km_lane)
        given = entry.model_dump(exclude={"description"}, exclude_none=True)
        return Demand(**{**standard.__dict__, **given})

    def with_demand(self, name: str, demand: DemandFile) -> Network:
        """Return the same network with one demand added or replaced."""
        return replace(self, demand_files={**self.demand_files, name: demand})

    def demand_for_density(self, density_veh_per_km_lane: float) -> Demand:
        """Return the demand that ``density`` asks for on this network.

        Raises:
            InputError: The density is not a number or out of range.
        """
        return self.layout.demand(density_veh_per_km_lane, self.drivers)


def available_networks() -> tuple[NetworkDescription, ...]:
    """Describe the networks that come with the project, by name."""
    return tuple(_describe(load_network(name)) for name in shipped_networks())


def load_network(name_or_path: str) -> Network:
    """Load a network by its name, or from a folder or ``.sumocfg`` file of the user's own.

    Raises:
        InputError: There is no such network, or its files are missing or malformed.
    """
    check_network(name_or_path)
    if (folder := shipped_networks().get(name_or_path)) is not None:
        return _from_metadata(folder, name_or_path)
    # Whoever drives on it may do so from another folder.
    path = Path(os.path.abspath(checked_path(Path(name_or_path), "net")))
    if path.suffix == ".sumocfg" and not path.is_dir():
        require_file(path, f"`net` {name_or_path}")
    compile_kernels()
    beside = path.iterdir() if path.is_dir() else path.parent.iterdir()
    return isolated(partial(_from_elsewhere, path, name_or_path), f"`net`: {path}", ProcessLimits.for_files(beside))


def default_demand(name_or_path: str) -> str | None:
    """Return the demand used by default; None where that is a density.

    Only the network's ``network.toml`` is read; of a network that does not exist nothing is known here.
    """
    metadata = shipped_networks().get(name_or_path, Path(name_or_path)) / METADATA_FILE
    return read_network_file(metadata).default_demand if metadata.is_file() else None


def _from_elsewhere(path: Path, name: str) -> Network:
    configurations = [path] if not path.is_dir() else sorted(path.glob("*.sumocfg"))
    if (path / METADATA_FILE).is_file():
        network = _from_metadata(path, name)
    elif len(configurations) == 1:
        network = _from_sumocfg(configurations[0], name)
    else:
        raise InputError(
            f"`net` {path}: the folder needs a {METADATA_FILE} or exactly one .sumocfg file; "
            f"it has {len(configurations)} of the latter"
        )
    network = replace(network, unusual=tuple(check_xml(*network.files)))
    # The road has walls, which are from elsewhere too.
    if isinstance(network.road, LaneGraphRoad) and (crossed := lanes_under_walls(network.road)):
        network = replace(network, unusual=(f"buildings stand on {crossed} of its lanes", *network.unusual))
    return network


def _from_metadata(folder: Path, name: str) -> Network:
    content = read_network_file(folder / METADATA_FILE)
    if isinstance(content, PlaneNetworkFile):
        return _in_plane(folder, name, content)
    calibration_file, measured_file = (
        None if entry is None else folder / entry for entry in (content.calibration_file, content.measured_file)
    )
    drivers, demands = content.drivers or Drivers(), content.demands
    calibrated_names: tuple[str, ...] = ()
    if calibration_file is not None and calibration_file.is_file():
        calibrated = file_of(calibration_file, CalibrationFile)
        drivers, demands = calibrated.drivers, {**demands, **calibrated.demands}
        calibrated_names = tuple(calibrated.demands)
    if content.default_demand is not None and content.default_demand not in demands:
        raise InputError(f"{folder / METADATA_FILE}: default_demand {content.default_demand} is none of its demands")
    net_file = folder / content.net_file
    net = read_net(net_file)
    types_file = folder / content.vehicle_types_file
    require_file(types_file, f"{folder / METADATA_FILE}: vehicle_types_file")
    corridor = corridor_from_net(net, content.corridor, content.corridor_start_m)
    unknown = sorted(set(content.ego_lanes) - {lane.number for lane in corridor.lanes})
    if unknown:
        raise InputError(f"{folder / METADATA_FILE}: ego_lanes: the main road has no lane {unknown[0]}")
    return Network(
        name=name,
        description=content.description,
        sumo_inputs=SumoInputs(net_file, (), (types_file,), MAIN_ROAD_OPTIONS, ()),
        section_m=content.section_m,
        corridor=corridor,
        ego_lanes=content.ego_lanes,
        on_ramps=tuple(ramp_from_net(net, ramp, corridor, entering=True) for ramp in content.on_ramps),
        off_ramps=tuple(ramp_from_net(net, ramp, corridor, entering=False) for ramp in content.off_ramps),
        vehicle_types_file=types_file,
        drivers=drivers,
        demand_files=demands,
        default_demand=content.default_demand,
        calibrated=calibrated_names,
        calibration_file=calibration_file,
        measured_file=measured_file,
    )


def _in_plane(folder: Path, name: str, content: PlaneNetworkFile) -> Network:
    routes = folder / content.routes_file
    additional = () if content.poly_file is None else (folder / content.poly_file,)
    for file in (routes, *additional):
        require_file(file, f"{folder / METADATA_FILE}: of what it names")
    net_file = folder / content.net_file
    plane = read_lane_graph(net_file)
    return Network(
        name=name,
        description=content.description,
        sumo_inputs=SumoInputs(net_file, (routes,), additional, PLANE_OPTIONS, ()),
        section_m=plane.extent_m,
        plane=plane,
        vehicle_types_file=routes,
        demand_files={key: DemandFile(**entry.model_dump()) for key, entry in content.demands.items()},
        default_demand=content.default_demand,
    )


def _from_sumocfg(path: Path, name: str) -> Network:
    """Take the whole network: all its lanes, in the plane."""
    inputs = read_sumocfg(path)
    plane = read_lane_graph(inputs.net_file)
    return Network(
        name=name,
        description=f"the user's own network of {len(plane.graph)} lanes",
        sumo_inputs=inputs,
        section_m=plane.extent_m,
        plane=plane,
        configuration=path,
    )


def _describe(network: Network) -> NetworkDescription:
    return NetworkDescription(
        name=network.name,
        description=network.description,
        demands=tuple((name, entry.description) for name, entry in network.demand_files.items()),
        section_length_m=network.layout.length_m(network.section_m),
        lanes=network.layout.main_lanes,
        size_kb=network.net_file.stat().st_size / 1024.0,
    )
