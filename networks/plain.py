"""What the scripts that draw networks in the plane share: lines, plain XML, netconvert, vehicle types and flows."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from harness.truth.network.demand import Drivers
from harness.truth.sumo.population import KINDS, Kind

Point = tuple[float, float]
LANE_M = 3.5
# A line's chord is at most this far from its arc.
SAGITTA_M = 0.02
# So many bodies of each kind; a vehicle is one of them.
BODIES = {"car": 40, "truck": 8, "motorcycle": 3}
BODY_SEED = 7
# Lateral speed is at most a tenth of the speed, so that nothing slides sideways while standing.
LATERAL = 'laneChangeModel="SL2015" lcMaxSpeedLatStanding="0" lcMaxSpeedLatFactor="0.1" minGapLat="0.4"'
MOTION = {
    "car": 'vClass="passenger" decel="3.5" emergencyDecel="8.0" maxSpeedLat="1.1"',
    "truck": 'vClass="truck" decel="2.6" emergencyDecel="6.0" maxSpeedLat="0.8"',
    "motorcycle": 'vClass="motorcycle" decel="3.8" emergencyDecel="9.0" maxSpeedLat="1.1"',
}


@dataclass
class Pen:
    """Draws a line of straights and arcs, and remembers its points.

    Attributes:
        at: Where it stands, metres.
        heading_rad: Where it points.
        points: The line so far.
    """

    at: Point
    heading_rad: float = 0.0
    points: list[Point] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.points.append(self.at)

    def straight(self, length_m: float) -> Pen:
        """Go straight on."""
        x, y = self.at
        self._go((x + length_m * np.cos(self.heading_rad), y + length_m * np.sin(self.heading_rad)))
        return self

    def bend(self, radius_m: float, turn_deg: float) -> Pen:
        """Go along an arc, to the left for a positive turn."""
        turn, sign = np.deg2rad(turn_deg), np.sign(turn_deg)
        pieces = max(2, int(np.ceil(abs(turn) / np.sqrt(8.0 * SAGITTA_M / radius_m))))
        x, y = self.at
        begin = self.heading_rad
        centre = x - sign * radius_m * np.sin(begin), y + sign * radius_m * np.cos(begin)
        for k in range(1, pieces + 1):
            self.heading_rad = begin + turn * k / pieces
            self._go((
                centre[0] + sign * radius_m * np.sin(self.heading_rad),
                centre[1] - sign * radius_m * np.cos(self.heading_rad),
            ))  # fmt: skip
        return self

    def _go(self, point: tuple[float, float]) -> None:
        self.at = round(float(point[0]), 3), round(float(point[1]), 3)
        self.points.append(self.at)


def length_of(points: Sequence[Point]) -> float:
    """Return a line's length, metres."""
    return float(np.hypot(*np.diff(np.array(points), axis=0).T).sum())


@dataclass
class Drawing:
    """A network as netconvert's plain XML, and the traffic on it.

    Attributes:
        nodes: Lines of the node file.
        edges: Lines of the edge file.
        connections: Lines of the connection file; what is not given netconvert guesses.
        buildings: Outlines of buildings.
        flows: Routes with the vehicles an hour that take them at scale 1.
        options: More of netconvert's options.
    """

    nodes: list[str] = field(default_factory=list)
    edges: list[str] = field(default_factory=list)
    connections: list[str] = field(default_factory=list)
    buildings: list[list[Point]] = field(default_factory=list)
    flows: list[tuple[tuple[str, ...], float]] = field(default_factory=list)
    options: tuple[str, ...] = ()

    def node(self, name: str, at: Point, kind: str = "priority", more: str = "") -> None:
        """Add a node."""
        self.nodes.append(f'<node id="{name}" x="{at[0]:.3f}" y="{at[1]:.3f}" type="{kind}"{_more(more)}/>')

    def edge(
        self, name: str, ends: tuple[str, str], shape: Sequence[Point], lanes: int, speed_mps: float, more: str = ""
    ) -> None:
        """Add an edge along a line."""
        text = " ".join(f"{x:.3f},{y:.3f}" for x, y in shape)
        self.edges.append(
            f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{lanes}" speed="{speed_mps:g}" '
            f'width="{LANE_M:g}"{_more(more)} shape="{text}"/>'
        )

    def connect(self, first: str, second: str, lanes: Iterable[tuple[int, int]]) -> None:
        """Connect lanes of two edges; lanes count from the right."""
        for one, other in lanes:
            self.connections.append(f'<connection from="{first}" to="{second}" fromLane="{one}" toLane="{other}"/>')

    def block(self, low: Point, high: Point) -> None:
        """Add a building with walls along the axes."""
        self.buildings.append([low, (high[0], low[1]), high, (low[0], high[1])])

    def blocks_at_corners(self, blocks: Iterable[tuple[Point, Point]]) -> None:
        """Add buildings at all four corners of a crossing at the origin, given those of the upper right one."""
        for sign_x, sign_y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            for low, high in blocks:
                x, y = sorted((sign_x * low[0], sign_x * high[0])), sorted((sign_y * low[1], sign_y * high[1]))
                self.block((x[0], y[0]), (x[1], y[1]))


def build(drawing: Drawing, folder: Path, name: str) -> None:
    """Write a network's files: ``.net.xml``, ``.rou.xml`` and, if there are buildings, ``.poly.xml``."""
    from sumo import SUMO_HOME  # noqa: PLC0415  (only these scripts need the large package)

    net = folder / f"{name}.net.xml"
    with TemporaryDirectory() as temporary:
        source = Path(temporary)
        _write(source / "a.nod.xml", "nodes", drawing.nodes)
        _write(source / "a.edg.xml", "edges", drawing.edges)
        _write(source / "a.con.xml", "connections", drawing.connections)
        subprocess.run(
            [
                str(Path(SUMO_HOME) / "bin" / "netconvert"),
                *("--node-files", str(source / "a.nod.xml")),
                *("--edge-files", str(source / "a.edg.xml")),
                *("--connection-files", str(source / "a.con.xml")),
                *("--output-file", str(net)),
                "--offset.disable-normalization",
                "--no-turnarounds",
                *("--geometry.max-angle.fix", "false"),
                *("--precision", "3"),
                *drawing.options,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
    net.write_text(without_build_stamp(net.read_text(encoding="utf-8")), encoding="utf-8")
    _write(folder / f"{name}.rou.xml", "routes", [*vehicle_types(), *_flows(drawing.flows)])
    if drawing.buildings:
        _write(folder / f"{name}.poly.xml", "additional", _polygons(drawing.buildings))


def without_build_stamp(text: str) -> str:
    """Return the network without the comment that netconvert writes with the time and the builder's paths."""
    return re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)


def vehicle_types() -> list[str]:
    """Return vehicle types of natural sizes, spread as those of ``us101`` are: shares, lengths, widths, headways."""
    rng, drivers = np.random.default_rng(BODY_SEED), Drivers()
    lines = ['<vTypeDistribution id="traffic">']
    for kind, entry in KINDS.items():
        for body in range(BODIES[kind]):
            share = entry.share / BODIES[kind]
            lines.append(f'    <vType id="{kind}{body}" probability="{share:.6f}" {_body(rng, kind, entry, drivers)}/>')
    return [*lines, "</vTypeDistribution>"]


def _body(rng: np.random.Generator, kind: str, entry: Kind, drivers: Drivers) -> str:
    def draw(mean: float, spread: float, lowest: float, highest: float) -> float:
        return float(np.clip(rng.normal(mean, spread), lowest, highest))

    headway_s = entry.headway_scale * draw(drivers.headway_s, drivers.headway_spread_s, 0.8, 2.6)
    return (
        f'{MOTION[kind]} {LATERAL} carFollowModel="EIDM" '
        f'length="{draw(*entry.length_m):.2f}" width="{draw(*entry.width_m):.2f}" '
        f'minGap="{draw(drivers.minimum_gap_m, drivers.minimum_gap_spread_m, 1.4, 7.0):.2f}" tau="{headway_s:.2f}" '
        f'accel="{draw(*entry.accel_mps2):.2f}" '
        f'speedFactor="normc({entry.speed_scale:g},{drivers.desired_speed_spread:g},0.7,1.2)"'
    )


def _flows(flows: Sequence[tuple[tuple[str, ...], float]]) -> list[str]:
    lines = []
    for number, (route, vehicles_per_h) in enumerate(flows):
        period = f"exp({vehicles_per_h / 3600.0:.6f})"
        lines += [
            f'<flow id="flow{number}" type="traffic" begin="0" end="1000000" period="{period}" '
            'departLane="best" departSpeed="avg">',
            f'    <route edges="{" ".join(route)}"/>',
            "</flow>",
        ]
    return lines


def _polygons(buildings: Sequence[Sequence[Point]]) -> list[str]:
    return [
        f'<poly id="building{number}" type="building" color="0.75,0.75,0.75" fill="1" layer="-1" '
        f'shape="{" ".join(f"{x:.2f},{y:.2f}" for x, y in [*outline, outline[0]])}"/>'
        for number, outline in enumerate(buildings)
    ]


def _more(text: str) -> str:
    return f" {text}" if text else ""


def _write(path: Path, root: str, lines: Iterable[str]) -> None:
    body = "\n".join(f"    {line}" for line in lines)
    path.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<{root}>\n{body}\n</{root}>\n', encoding="utf-8")
