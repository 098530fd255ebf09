"""A small scene of cars at constant speed, and files of it in every layout that is read."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.truth.recorded.formats import network_of, recognise
from harness.truth.recorded.source import RecordedTrafficTruth, open_recorded_traffic

FOOT_M = 0.3048
US101_LEFT_M = 18.3
TEXT_COLUMN_COUNT = 18
NGSIM_HEADER = (
    "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,v_Vel,"
    "v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location"
)
EPOCH_MS = 1_118_846_980_200


@dataclass(frozen=True)
class Car:
    """A car at constant speed on a straight road; positions are those of its centre."""

    name: int
    lon_m: float
    lat_m: float
    speed_mps: float
    length_m: float = 4.5
    width_m: float = 1.8
    from_s: float = 0.0
    to_s: float = 5.0

    def lon_at(self, time_s: float) -> float:
        return self.lon_m + self.speed_mps * time_s

    def times(self, step_s: float) -> Iterator[tuple[int, float]]:
        for tick in range(round(self.from_s / step_s), round(self.to_s / step_s) + 1):
            yield tick, tick * step_s


CARS = (
    Car(7, 40.0, 12.8, 10.0),
    Car(12, 60.0, 9.1, 12.0, length_m=12.0, width_m=2.5),
    Car(3, 20.0, 9.3, 8.0),
    Car(21, 30.0, 1.9, 9.0, from_s=1.0, to_s=4.0),
)


def ngsim_rows(cars: Sequence[Car] = CARS, accel_ftps2: float = 99.0) -> list[list[object]]:
    return [
        [
            car.name, tick, 51, EPOCH_MS + 100 * tick, round((US101_LEFT_M - car.lat_m) / FOOT_M, 6),
            round((car.lon_at(time_s) + 0.5 * car.length_m) / FOOT_M, 6), 0.0, 0.0, round(car.length_m / FOOT_M, 6),
            round(car.width_m / FOOT_M, 6), 2, round(car.speed_mps / FOOT_M, 6), accel_ftps2, 2, 0, 0, 0.0, 0.0,
        ]
        for car in cars
        for tick, time_s in car.times(0.1)
    ]  # fmt: skip


def write_ngsim_csv(path: Path, rows: Sequence[Sequence[object]] | None = None, header: str = NGSIM_HEADER) -> Path:
    rows = ngsim_rows() if rows is None else rows
    lines = [",".join(map(str, [*row, "us-101"] if len(row) == 18 else row)) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def write_ngsim_text(path: Path, rows: Sequence[Sequence[object]] | None = None) -> Path:
    rows = ngsim_rows() if rows is None else rows
    path.write_text("\n".join("  ".join(f"{value:>8}" for value in row) for row in rows) + "\n", encoding="utf-8")
    return path


def in_plane(lon_m: float, lat_m: float, turn_rad: float) -> tuple[float, float]:
    """Return where a position beside a straight road through the origin lies in the plane."""
    return (lon_m * np.cos(turn_rad) - lat_m * np.sin(turn_rad), lon_m * np.sin(turn_rad) + lat_m * np.cos(turn_rad))


def write_commonroad(
    path: Path, cars: Sequence[Car] = CARS, version: str = "2020a", turn_rad: float = -0.7, extra: str = ""
) -> Path:
    """Write a straight road of five lanes of 3.66 m in two lanelets each, and the cars."""
    parts = [f'<?xml version="1.0"?>\n<commonRoad commonRoadVersion="{version}" timeStepSize="0.1" benchmarkID="A">']
    for lane in range(5):
        for piece, (start_m, end_m) in enumerate(((0.0, 90.0), (90.0, 200.0))):
            parts.append(f'<lanelet id="{10 * lane + piece}">')
            for side, lat_m in (("leftBound", 3.66 * (lane + 1)), ("rightBound", 3.66 * lane)):
                points = [in_plane(lon_m, lat_m, turn_rad) for lon_m in np.linspace(start_m, end_m, 12)]
                text = "".join(f"<point><x>{x:.6f}</x><y>{y:.6f}</y></point>" for x, y in points)
                parts.append(f"<{side}>{text}</{side}>")
            if piece == 0:
                parts.append(f'<successor ref="{10 * lane + 1}"/>')
            parts.append("</lanelet>")
    for car in cars:
        states = [_commonroad_state(car, tick, time_s, turn_rad) for tick, time_s in car.times(0.1)]
        tag, role = ("obstacle", "<role>dynamic</role>") if version == "2018b" else ("dynamicObstacle", "")
        parts.append(
            f'<{tag} id="{car.name}">{role}<type>car</type><shape><rectangle><length>{car.length_m}</length>'
            f"<width>{car.width_m}</width></rectangle></shape><initialState>{states[0]}</initialState>"
            f"<trajectory>{''.join(f'<state>{state}</state>' for state in states[1:])}</trajectory></{tag}>"
        )
    path.write_text("\n".join([*parts, extra, "</commonRoad>"]), encoding="utf-8")
    return path


def _commonroad_state(car: Car, tick: int, time_s: float, turn_rad: float) -> str:
    x, y = in_plane(car.lon_at(time_s), car.lat_m, turn_rad)
    return (
        f"<position><point><x>{x:.6f}</x><y>{y:.6f}</y></point></position>"
        f"<orientation><exact>{turn_rad}</exact></orientation><time><exact>{tick}</exact></time>"
        f"<velocity><exact>{car.speed_mps}</exact></velocity><acceleration><exact>9.9</exact></acceleration>"
    )


def write_highd(folder: Path, cars: Sequence[Car] = CARS, upper: Sequence[Car] = ()) -> Path:
    """Write a recording of 25 frames a second: ``cars`` on the lower lanes, ``upper`` on the other ones.

    Lower lanes lie between 20 and 31.25 m down the picture, upper ones between 4 and 15.25 m; a car's ``lat_m`` counts
    from its carriageway's right edge.
    """
    folder.mkdir()
    rows, meta = [], []
    for direction, group in ((1, upper), (2, cars)):
        for car in group:
            meta.append(f"{car.name},{direction},Car")
            for tick, time_s in car.times(0.04):
                x = car.lon_at(time_s) if direction == 2 else 400.0 - car.lon_at(time_s)
                y = 31.25 - car.lat_m if direction == 2 else 4.0 + car.lat_m
                speed = car.speed_mps if direction == 2 else -car.speed_mps
                rows.append(
                    f"{tick + 1},{car.name},{x - 0.5 * car.length_m:.6f},{y - 0.5 * car.width_m:.6f},{car.length_m},"
                    f"{car.width_m},{speed},0.0,7.7,0.0,5"
                )
    (folder / "01_tracks.csv").write_text(
        "\n".join(["frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,laneId", *rows]) + "\n"
    )
    (folder / "01_tracksMeta.csv").write_text("\n".join(["id,drivingDirection,class", *meta]) + "\n")
    (folder / "01_recordingMeta.csv").write_text(
        "id,frameRate,upperLaneMarkings,lowerLaneMarkings\n1,25,4.00;7.75;11.50;15.25,20.00;23.75;27.50;31.25\n"
    )
    return folder


def write_fcd(path: Path, cars: Sequence[Car] = CARS, step_s: float = 0.1, attributes: str = "") -> Path:
    """Write floating-car data in the plane of the network us101, which is its road frame; angles are the compass's."""
    steps: dict[int, list[str]] = {}
    for car in cars:
        for tick, time_s in car.times(step_s):
            steps.setdefault(tick, []).append(
                f'<vehicle id="{car.name}" x="{car.lon_at(time_s) + 0.5 * car.length_m:.6f}" y="{car.lat_m}" '
                f'angle="90.00" type="car" speed="{car.speed_mps}" length="{car.length_m}" width="{car.width_m}" '
                f'pos="1.0" lane="upstream_2" slope="0.0" {attributes}/>'
            )
    text = "\n".join(
        f'<timestep time="{tick * step_s:.2f}">{"".join(steps[tick])}</timestep>' for tick in sorted(steps)
    )
    path.write_text(f'<?xml version="1.0"?>\n<fcd-export>\n{text}\n</fcd-export>\n')
    return path


def edited(
    write: Callable[[Path], Path],
    pattern: str,
    new: str | Callable[[re.Match[str]], str],
    count: int = 0,
    file: str = "",
) -> Callable[[Path], None]:
    """Return what writes a recording and replaces what a pattern finds in one of its files."""

    def made(path: Path) -> None:
        write(path)
        text, changed = re.subn(pattern, new, (path / file).read_text(), count=count, flags=re.DOTALL)
        assert changed
        (path / file).write_text(text)

    return made


def opened(path: Path, ego: str = "auto", duration_s: float = 60.0, net: str | None = None) -> RecordedTrafficTruth:
    """Open a recording of whichever format it has."""
    entry = recognise(path)
    return open_recorded_traffic(path, entry.name, network_of(entry, net), ego, duration_s)
