"""Fifty-odd networks that are broken or strange, each a variant of a small crossing or a few edges drawn here."""

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

CROSSING = (Path(__file__).parents[1] / "harness/truth/network/nets/crossing.net.xml").read_text(encoding="utf-8")
LEFT_HAND = (Path(__file__).parents[1] / "harness/truth/network/nets/crossing-left.net.xml").read_text(encoding="utf-8")


def flows(*ways: tuple[str, str], kind: str = "", vehicles_per_h: int = 500) -> str:
    """Return flows from edge to edge."""
    return "".join(
        f'<flow id="f{k}" {kind} from="{a}" to="{b}" begin="0" end="900" vehsPerHour="{vehicles_per_h}"/>'
        for k, (a, b) in enumerate(ways)
    )


ACROSS = flows(("wc", "ce"), ("ec", "cs"), ("nc", "cw"), ("sc", "cn"))


@dataclass(frozen=True)
class Odd:
    """The files of a network: the net, what is between the tags of its routes, additional files and other options."""

    net: str = CROSSING
    routes: str = ACROSS
    additional: tuple[str, ...] = ()
    options: str = ""
    bytes_of: dict[str, bytes] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write them, and return the configuration."""
        (folder / "own.net.xml").write_text(self.net, encoding="utf-8")
        (folder / "own.rou.xml").write_text(f"<routes>{self.routes}</routes>", encoding="utf-8")
        names = [f"own{k}.add.xml" for k in range(len(self.additional))]
        for name, text in zip(names, self.additional, strict=True):
            (folder / name).write_text(text, encoding="utf-8")
        for name, content in self.bytes_of.items():
            (folder / name).write_bytes(content)
        listed = f'<additional-files value="{",".join(names)}"/>' if names else ""
        (folder / "own.sumocfg").write_text(
            f'<configuration><input><net-file value="own.net.xml"/><route-files value="own.rou.xml"/>{listed}</input>'
            f"{self.options}</configuration>",
            encoding="utf-8",
        )
        return folder / "own.sumocfg"


def drawn(*lines: str, width: float = 3.2, allow: str = "", location: str = "", links: str = "") -> str:
    """Return a network of edges ``e0``, ``e1``, ... of one lane along each line, which lead from nowhere to nowhere.

    Args:
        lines: Shapes of the lanes.
        width: Their width.
        allow: Who may use them, as an attribute.
        location: Attributes of the location.
        links: Elements of connections.
    """
    edges, ends = "", ""
    for k, shape in enumerate(lines):
        points = shape.split()
        edges += (
            f'<edge id="e{k}" from="a{k}" to="b{k}" priority="1"><lane id="e{k}_0" index="0" {allow} speed="13.9" '
            f'length="{length(shape):.2f}" width="{width}" shape="{shape}"/></edge>'
        )
        for name, point, into in ((f"a{k}", points[0], ""), (f"b{k}", points[-1], f"e{k}_0")):
            x, y = point.split(",")[:2]
            ends += (
                f'<junction id="{name}" type="dead_end" x="{x}" y="{y}" incLanes="{into}" intLanes="" shape="{point}"/>'
            )
    location = location or (
        'netOffset="0.00,0.00" convBoundary="0.00,0.00,900.00,900.00" origBoundary="0,0,900,900" projParameter="!"'
    )
    return f'<net version="1.20"><location {location}/>{edges}{ends}{links}</net>'


def length(shape: str) -> float:
    """Return the length of a shape, metres."""
    places = [tuple(map(float, point.split(",")[:2])) for point in shape.split()]
    return max(0.1, sum(math.dist(a, b) for a, b in pairwise(places)))


def moved(x_m: float, y_m: float) -> str:
    """Return the crossing with every place moved."""

    def shifted(found: re.Match[str]) -> str:
        points = [point.split(",") for point in found[2].split()]
        return f'{found[1]}="{" ".join(f"{float(x) + x_m:.2f},{float(y) + y_m:.2f}" for x, y in points)}"'

    net = re.sub(r'(shape)="([^"]*)"', shifted, CROSSING)
    for axis, shift in (("x", x_m), ("y", y_m)):
        net = re.sub(rf' {axis}="([^"]*)"', lambda found, a=axis, s=shift: f' {a}="{float(found[1]) + s:.2f}"', net)
    return net


def with_lane(name: str, **attributes: str) -> str:
    """Return the crossing with attributes of one of its lanes changed; an empty one goes."""

    def changed(found: re.Match[str]) -> str:
        element = found[0]
        for key, value in attributes.items():
            element = re.sub(rf' {key}="[^"]*"', "", element)
            element = element.replace("/>", f' {key}="{value}"/>') if value else element
        return element

    return re.sub(rf'<lane id="{name}"[^>]*/>', changed, CROSSING)


def without(pattern: str, net: str = CROSSING) -> str:
    """Return a network without what a pattern finds."""
    return re.sub(pattern, "", net, flags=re.DOTALL)


def buildings(*shapes: str, kind: str = "building") -> str:
    """Return an additional file with polygons."""
    polygons = "".join(
        f'<poly id="p{k}" type="{kind}" color="1,0,0" layer="1" shape="{shape}"/>' for k, shape in enumerate(shapes)
    )
    return f"<additional>{polygons}</additional>"


SQUARE = "130,130 150,130 150,150 130,150"
LOOP = drawn(
    "0,0 100,0",
    "100,0 100,100",
    "100,100 0,100",
    "0,100 0,0",
    links="".join(
        f'<connection from="e{k}" to="e{(k + 1) % 4}" fromLane="0" toLane="0" dir="l" state="M"/>' for k in range(4)
    ),
)
BRIDGE = drawn("0,300,0 600,300,0", "300,0,8 300,600,8", "0,0,-6 600,600,-6")
PEOPLE = '<person id="p{0}" depart="0"><walk edges="{1}"/></person>'

ODD: dict[str, Callable[[], Odd]] = {
    "as it is": Odd,
    "left-hand traffic": lambda: Odd(net=LEFT_HAND),
    "no edges": lambda: Odd(net='<net version="1.20"></net>', routes=""),
    "no edges but flows": lambda: Odd(net='<net version="1.20"></net>'),
    "an empty file for a net": lambda: Odd(bytes_of={"own.net.xml": b""}),
    "a net of null bytes": lambda: Odd(bytes_of={"own.net.xml": bytes(4096)}),
    "half a net": lambda: Odd(net=CROSSING[: len(CROSSING) // 2]),
    "routes for a net": lambda: Odd(net="<routes/>"),
    "no routes": lambda: Odd(routes=""),
    "routes over edges that are not there": lambda: Odd(routes=flows(("nowhere", "ce"))),
    "routes that are not connected": lambda: Odd(
        routes='<route id="r" edges="wc nc"/><flow id="f" route="r" begin="0" end="9" number="3"/>'
    ),
    "one lane of 3 m": lambda: Odd(net=drawn("0,0 3,0"), routes=flows(("e0", "e0"))),
    "one lane of 30 m": lambda: Odd(net=drawn("0,0 30,0"), routes=flows(("e0", "e0"))),
    "one straight lane": lambda: Odd(net=drawn("0,0 800,0"), routes=flows(("e0", "e0"))),
    "parts that are not connected": lambda: Odd(
        net=drawn("0,0 800,0", "0,5000 800,5000"), routes=flows(("e0", "e0"), ("e1", "e1"))
    ),
    "rails alone": lambda: Odd(
        net=drawn("0,0 800,0", allow='allow="rail"'),
        routes=flows(("e0", "e0"), kind='type="t"').replace("<flow", '<vType id="t" vClass="rail"/><flow', 1),
    ),
    "feet alone": lambda: Odd(net=drawn("0,0 800,0", allow='allow="pedestrian"'), routes=PEOPLE.format(0, "e0")),
    "bicycles alone": lambda: Odd(net=drawn("0,0 800,0", allow='allow="bicycle"'), routes=""),
    "lanes for nobody": lambda: Odd(net=drawn("0,0 800,0", allow='disallow="all"'), routes=""),
    "people on roads for cars": lambda: Odd(routes=PEOPLE.format(0, "wc ce") + ACROSS),
    "bicycles on roads for cars": lambda: Odd(
        routes='<vType id="b" vClass="bicycle"/>' + flows(("wc", "ce"), kind='type="b"')
    ),
    "a bridge over a road over a tunnel": lambda: Odd(
        net=BRIDGE, routes=flows(("e0", "e0"), ("e1", "e1"), ("e2", "e2"))
    ),
    "two roads on top of each other": lambda: Odd(
        net=drawn("0,0,0 800,0,0", "0,0,9 800,0,9"), routes=flows(("e0", "e0"), ("e1", "e1"))
    ),
    "two roads against each other in one place": lambda: Odd(
        net=drawn("0,0 800,0", "800,0 0,0"), routes=flows(("e0", "e0"), ("e1", "e1"))
    ),
    "a circle of roads": lambda: Odd(net=LOOP, routes=flows(("e0", "e3"), ("e2", "e1"))),
    "a route that goes round and round": lambda: Odd(
        net=LOOP,
        routes=f'<route id="r" edges="{"e0 e1 e2 e3 " * 40}"/><flow id="f" route="r" begin="0" end="100" number="9"/>',
    ),
    "a path across without length": lambda: Odd(
        net=with_lane(":c_1_0", shape="118.40,120.00 118.40,120.00", length="0.01")
    ),
    "a path across of one point": lambda: Odd(net=with_lane(":c_1_0", shape="118.40,120.00")),
    "no paths across": lambda: Odd(net=without(r' via="[^"]*"', without(r'<edge id=":[^"]*".*?</edge>'))),
    "one path across that is missing": lambda: Odd(net=without(r'<edge id=":c_11".*?</edge>')),
    "connections that are missing": lambda: Odd(net=without(r"<connection [^>]*/>")),
    "a connection to nowhere": lambda: Odd(net=CROSSING.replace('to="cs" fromLane="1"', 'to="nowhere" fromLane="1"')),
    "a connection to a lane that is not there": lambda: Odd(
        net=CROSSING.replace('to="cs" fromLane="1" toLane="0"', 'to="cs" fromLane="1" toLane="7"')
    ),
    "junctions that are missing": lambda: Odd(net=without(r"<junction [^>]*/>|<junction [^>]*[^/]>.*?</junction>")),
    "an edge from a junction that is not there": lambda: Odd(
        net=CROSSING.replace('from="w" to="c"', 'from="nowhere" to="c"')
    ),
    "a lane of one point": lambda: Odd(net=with_lane("wc_0", shape="0.00,115.20")),
    "a lane without a shape": lambda: Odd(net=with_lane("wc_0", shape="")),
    "a lane whose points coincide": lambda: Odd(net=with_lane("wc_0", shape="50.00,115.20 50.00,115.20 50.00,115.20")),
    "a lane with places that are no numbers": lambda: Odd(
        net=with_lane("wc_0", shape="0.00,115.20 nan,115.20 112.80,115.20")
    ),
    "a lane that goes back and forth": lambda: Odd(
        net=with_lane("wc_0", shape="0,115 112,115 0,115 112,115 0,115 112.8,115.2")
    ),
    "a lane without width": lambda: Odd(net=with_lane("wc_0", width="0.00")),
    "a lane as thin as a hair": lambda: Odd(net=with_lane("wc_0", width="0.01")),
    "a lane as wide as a square": lambda: Odd(net=with_lane("wc_0", width="150.00")),
    "a lane that is longer than its shape": lambda: Odd(net=with_lane("wc_0", length="5000.00")),
    "a lane without a speed": lambda: Odd(net=with_lane("wc_0", speed="")),
    "a lane without a name": lambda: Odd(net=CROSSING.replace('<lane id="wc_0"', "<lane")),
    "an edge twice": lambda: Odd(
        net=CROSSING.replace("</edge>", "</edge>" + re.findall(r'<edge id="wc".*?</edge>', CROSSING, re.DOTALL)[0], 1)
    ),
    "a lane twice": lambda: Odd(net=CROSSING.replace('<lane id="wc_1"', '<lane id="wc_0"')),
    "lanes in the wrong order": lambda: Odd(
        net=CROSSING.replace('<lane id="wc_1" index="1"', '<lane id="wc_1" index="5"')
    ),
    "names of other alphabets": lambda: Odd(
        net=CROSSING.replace("wc", "дорога道"), routes=ACROSS.replace("wc", "дорога道")
    ),
    "names with markup in them": lambda: Odd(
        net=CROSSING.replace("wc", "&lt;b&gt;wc"), routes=ACROSS.replace("wc", "&lt;b&gt;wc")
    ),
    "places of UTM": lambda: Odd(net=moved(691_000.0, 5_335_000.0)),
    "places on the other side of zero": lambda: Odd(net=moved(-691_000.0, -5_335_000.0)),
    "places as far as the moon": lambda: Odd(net=moved(3.8e8, 3.8e8)),
    "a road across a continent": lambda: Odd(net=drawn("0,0 3000000,0"), routes=flows(("e0", "e0"))),
    "two towns a thousand kilometres apart": lambda: Odd(
        net=drawn("0,0 800,0", "1000000,1000000 1000800,1000000"), routes=flows(("e0", "e0"), ("e1", "e1"))
    ),
    "an offset that is not a number": lambda: Odd(
        net=drawn(
            "0,0 800,0", location='netOffset="nan,inf" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"'
        ),
        routes=flows(("e0", "e0")),
    ),
    "a projection of UTM": lambda: Odd(
        net=drawn(
            "0,0 800,0",
            location='netOffset="-691000.00,-5335000.00" convBoundary="0,0,800,1" origBoundary="11.5,48.1,11.6,48.2" '
            'projParameter="+proj=utm +zone=32 +ellps=WGS84"',
        ),
        routes=flows(("e0", "e0")),
    ),
    "no location": lambda: Odd(net=without(r"<location [^>]*/>")),
    "an empty additional file": lambda: Odd(additional=("<additional/>",)),
    "an additional file of no bytes": lambda: Odd(additional=("",)),
    "a building": lambda: Odd(additional=(buildings(SQUARE),)),
    "a building on the crossing": lambda: Odd(additional=(buildings("100,100 140,100 140,140 100,140"),)),
    "buildings of two points, of one and of none": lambda: Odd(
        additional=(buildings("130,130 150,130", "130,130", ""),)
    ),
    "a building whose points coincide": lambda: Odd(additional=(buildings("130,130 130,130 130,130 130,130"),)),
    "a building that is not a number": lambda: Odd(additional=(buildings("nan,130 150,130 inf,150"),)),
    "a building that crosses itself": lambda: Odd(additional=(buildings("130,130 150,150 150,130 130,150"),)),
    "buildings in two files under one name": lambda: Odd(additional=(buildings(SQUARE), buildings(SQUARE))),
    "a roundabout of edges that are not there": lambda: Odd(
        net=CROSSING.replace("</net>", '<roundabout nodes="c nowhere" edges="nowhere wc"/></net>')
    ),
    "an empty roundabout": lambda: Odd(net=CROSSING.replace("</net>", '<roundabout nodes="" edges=""/></net>')),
    "a signal that is not there": lambda: Odd(
        net=CROSSING.replace('type="priority" x="120.00"', 'type="traffic_light" x="120.00"')
    ),
}
"""By what is odd about each."""


EXPECTED = {
    **dict.fromkeys(("as it is", "left-hand traffic", "a building", "places of UTM"), 0),
    **dict.fromkeys(("no edges", "rails alone", "half a net", "a lane with places that are no numbers"), 2),
}
"""Exit codes that are known beforehand."""
ALL = "HARNESS_ODD_NETWORKS"
EACH = 3


def chosen() -> dict[str, Callable[[], Odd]]:
    """Return every third network and those whose exit code is known; all where the variable is ``all``."""
    every = EACH if os.environ.get(ALL) != "all" else 1
    return {name: make for k, (name, make) in enumerate(ODD.items()) if k % every == 0 or name in EXPECTED}
