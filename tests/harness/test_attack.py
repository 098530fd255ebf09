"""Wrong or hostile inputs of attacks that once got through: each is now one line and harms nothing.

A row says how an input is made, which command reads it, the exit code and a word of the line. Numbers in brackets are
the attack's own.
"""

import gzip
import os
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from harness.commands.app import run_command_line
from tests.fuzz.child import state_of
from tests.harness.recorded_scene import rewrite, write_recorded_scene
from tests.harness.truth.network.test_hostile_networks import NET, US101, VEHICLES, own
from tests.harness.truth.recorded.detected.made import write_kitti
from tests.harness.truth.recorded.detected.test_av2 import write_av2
from tests.harness.truth.recorded.layouts import (
    Car,
    edited,
    ngsim_rows,
    write_commonroad,
    write_fcd,
    write_highd,
    write_ngsim_csv,
    write_ngsim_text,
)

pytestmark = pytest.mark.usefixtures("no_pictures")

OUT = ["--quiet", "--out", "out"]
TRACKER = ["--tracker", "tests.harness.stand_ins:echo_tracker"]
ECHO = [*TRACKER, "--duration", "1", *OUT]
META = "01_tracksMeta.csv"
BOXES, POSES = "annotations.feather", "city_SE3_egovehicle.feather"
KITTI, AV2 = ("--format", "kitti-tracking"), ("--format", "av2")
MODELS = Path(__file__).parents[2] / "mmpf" / "models"


class Input(NamedTuple):
    """What makes the files in an empty folder and returns the command, a word of its line, and its exit code."""

    make: Callable[[Path], list[str]]
    word: str
    code: int = 2


def scene(folder: Path) -> Path:
    return write_recorded_scene(folder / "scene")


def option(text: str, word: str) -> Input:
    return Input(lambda folder: shlex.split(text), word)


def setting(text: str, word: str, fcd: bool = False) -> Input:
    def make(folder: Path) -> list[str]:
        replay = ["--replay", str(write_fcd(folder / "a.xml"))] if fcd else []
        return ["run", *replay, "--set", text, *ECHO[2:]]

    return Input(make, word)


def toml(text: str, word: str) -> Input:
    def make(folder: Path) -> list[str]:
        (folder / "evilmod.py").write_text("open('pwned', 'w').close()\n")
        (folder / "a.toml").write_text(text)
        return ["run", "--config", "a.toml", *ECHO[2:]]

    return Input(make, word)


def recording(write: Callable[[Path], object], word: str, *form: str, code: int = 2) -> Input:
    def make(folder: Path) -> list[str]:
        write(folder / "a")
        return ["run", "--replay", "a", *TRACKER, *OUT[code == 0 :], *form]

    return Input(make, word, code)


def ngsim(**changes: object) -> Callable[[Path], None]:
    def made(path: Path) -> None:
        table = pd.read_csv(write_ngsim_csv(path), dtype={"Location": str})
        table.assign(
            **{name: change(table) if callable(change) else change for name, change in changes.items()}
        ).to_csv(path, index=False)

    return made


def side_by_side_in_metres(path: Path) -> None:
    cars = [Car(k, 30.0 + 7.0 * (k // 4), 3.0 + 3.66 * (k % 4), 10.0) for k in range(1, 12)]
    write_ngsim_csv(path, [[*row[:4], 0.3048 * row[4], *row[5:]] for row in ngsim_rows(cars)])


def comment(megabytes: int) -> Callable[[Path], None]:
    """Return what writes floating-car data behind a comment that is much longer than its packed file."""
    return lambda path: path.write_bytes(
        gzip.compress(b"<fcd-export><!--") + megabytes // 16 * gzip.compress(bytes(16 << 20).replace(b"\0", b" "))
        + gzip.compress(b"--></fcd-export>")
    )  # fmt: skip


def kitti(change: Callable[[list[str], int], list[str]]) -> Callable[[Path], None]:
    """Return what writes KITTI's files with each pose changed: its words and its number."""

    def made(path: Path) -> None:
        poses = write_kitti(path) / "poses" / "0000.txt"
        lines = poses.read_text().splitlines()
        poses.write_text("\n".join(" ".join(change(line.split(), k)) for k, line in enumerate(lines)) + "\n")

    return made


def av2(file: str, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[Path], None]:
    def made(path: Path) -> None:
        table = write_av2(path) / "log" / file
        change(pd.read_feather(table)).to_feather(table)

    return made


def many_annotations(path: Path) -> None:
    annotations = write_av2(path) / "log" / "annotations.feather"
    batch = pa.record_batch({name: np.zeros(1_000_000) for name in ("timestamp_ns", "tx_m", "ty_m", "tz_m")})
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.OSFile(str(annotations), "wb") as file, pa.ipc.new_file(file, batch.schema, options=options) as writer:
        for _ in range(150):
            writer.write_batch(batch)


def network(word: str, code: int = 2, **files: str) -> Input:
    """Return a network of one's own, in whose files ``FOLDER`` stands for the folder."""

    def make(folder: Path) -> list[str]:
        (folder / "victim").write_text("precious")
        here = {name: text.replace("FOLDER", str(folder)) for name, text in files.items()}
        return ["run", "--net", own(folder, **here), *ECHO]

    return Input(make, word, code)


def network_folder(element: str, word: str, code: int = 2) -> Input:
    def make(folder: Path) -> list[str]:
        (folder / "victim").write_text("precious")
        net = shutil.copytree(US101, folder / "net")
        types = next(path for path in net.glob("*.xml") if "<vType " in path.read_text())
        types.write_text(types.read_text().replace("<vType ", f"{element}<vType ", 1))
        return ["run", "--net", str(net), "--density", "5", *ECHO]

    return Input(make, word, code)


def within_net(element: str) -> str:
    return NET.replace("</net>", f"{element}</net>")


def run_folder(change: Callable[[Path], object], word: str, *words: str, code: int = 2) -> Input:
    def make(folder: Path) -> list[str]:
        change(scene(folder))
        return [*words, "scene", *(OUT if words[0] == "run" else [])]

    return Input(make, word, code)


def truth(change: Callable[[pd.DataFrame], pd.DataFrame], file: str = "truth.parquet") -> Callable[[Path], None]:
    return lambda folder: rewrite(folder, file, change(pd.read_parquet(folder / file)))


def swapped(found: re.Match[str]) -> str:
    return f"{'right' if found[1] == 'left' else 'left'}Bound"


def many_errors(folder: Path) -> None:
    rows = pq.read_table(folder / "errors.parquet").slice(0, 1).to_pandas()
    rows = pa.Table.from_pandas(rows.loc[rows.index.repeat(1_000_000)], preserve_index=False)
    with pq.ParquetWriter(folder / "errors.parquet", rows.schema, compression="zstd") as writer:
        for _ in range(55):
            writer.write_table(rows)


def altered_model(folder: Path) -> list[str]:
    with np.load(MODELS / "residual.npz") as stored:
        np.savez(folder / "model.npz", **{name: 1.01 * values for name, values in stored.items()})
    return ["run", "--replay", str(scene(folder)), "--model-file", "model.npz", "--particles", "20", *OUT]


SIGN = '<a><variableSpeedSign id="v" lanes="upstream_0" file="/etc/passwd"/></a>'
SSM = '<vType id="t"><param key="has.ssm.device" value="true"/></vType><route '
LOOP = '<inductionLoop id="a" lane="upstream_1" pos="1" freq="1" file="victim"/>'
PROBE = '<vTypeProbe id="p" period="1" file="victim"/>'
AT_ONCE = VEHICLES.replace('number="3"', 'number="40"')

INPUTS: dict[str, Input] = {
    # Options of commands.
    "compare over a file [opt168]": Input(
        lambda folder: ["compare", *[str(scene(folder))] * 2, "--html", write_fcd(folder / "fc.xml").name], "--html"
    ),
    "gap bias 1e308": option("drive --gap-bias 1e308", "--gap-bias"),
    "gap bias -100": option("drive --gap-bias -100", "--gap-bias"),
    "provoke a crossing on a motorway": option("drive --provoke cross --net us101", "--provoke"),
    "provoke a gap at a junction": option("drive --provoke gap --net junction", "--provoke"),
    "no models": option("study lane-keeping --models ,,", "--models"),
    "lane keeping at a junction": option("train --net junction --case lane-keeping", "junction"),
    "one setting varied and set": option("stress --vary sensor.range_m=80 --set sensor.range_m=40", "sensor.range_m"),
    "a tracker without a name": option("run --tracker mmpf: --quiet --out out", "--tracker"),
    "a sensor that aborts by its name": option("run --sensor os:abort --quiet --out out", "--sensor"),
    "seed 1.0": option("run --seed 1.0 --duration 1 --quiet --out out", "--seed"),
    "a folder whose name is not in UTF-8": Input(
        lambda folder: ["score", *("--truth", str(scene(folder)), "--tracks", "scene", "--out", "a\udcff")],
        "valid text",
    ),
    # Values of --set.
    "range 1e300": setting("sensor.range_m=1e300", "range_m"),
    "deviation 1e-300": setting("sensor.std_lon_m=1e-300", "std_lon_m"),
    "missed run 1e-300": setting("sensor.missed_run_s=1e-300", "missed_run_s"),
    "two settings in one": setting("sensor.range_m=80\nseed=5", "more than one thing"),
    "least score of a format without": setting("traffic.recording.least_score=0.5", "least_score", fcd=True),
    "a map of a format without": setting("traffic.recording.map=true", "map", fcd=True),
    "a format that is a number": setting("traffic.recording.format=9", "format", fcd=True),
    "believed range 1e-300": setting("tracker.believes.range_m=1e-300", "range_m"),
    "believed noise 1e-300": setting("tracker.believes.noise_factor=1e-300", "noise_factor"),
    "believed probability 0": setting("tracker.believes.detection_probability=0", "detection_probability"),
    "gate 1e308": setting("tracker.options.joint.association.gate_std=1e308", "gate_std"),
    "deviation 1e150 [set004]": setting("sensor.std_lon_m=1e150", "std_lon_m"),
    "share 1e9 [set014]": setting("sensor.std_range_share=1e9", "std_range_share"),
    "bearing 1e5 [set015]": setting("sensor.std_bearing_deg=1e5", "std_bearing_deg"),
    "start 1e308": setting("traffic.recording.start_s=1e308", "start_s", fcd=True),
    "a key of 100 000 letters": setting("x" * 100_000 + "=1", "xxx"),
    "a key of 5000 letters [set068]": setting("sensor." + "x" * 5000 + "=1", "xxx"),
    "a value of 5000 letters [set069]": setting("sensor.range_m=" + "x" * 5000, "range_m"),
    # Configurations.
    "a driver beside it": toml('[decisions]\ndriver = "evilmod:make"\n', "runs code"),
    "a model beside it": toml('[tracker.options]\nmodel = "evilmod:make"\n', "runs code"),
    "seed 1e3": toml("seed = 1e3\n", "seed"),
    "a sensor that aborts": toml('[sensor]\nprofile = "os:abort"\n', "runs code"),
    "a sensor that waits": toml('[sensor]\nprofile = "signal:pause"\n', "runs code"),
    # Recordings.
    "a comment of 1 GB [fcd40]": recording(comment(1024), "took more"),
    "a comment of 3 GB [fcd41]": recording(comment(3072), "took more"),
    "150 million annotations [av214]": recording(many_annotations, "count of rows", *AV2),
    "a name of 100 kB [fcd33]": recording(edited(write_fcd, 'id="7"', f'id="{"x" * 100_000}"'), "100000 letters"),
    "a pose 1e300 away [kitti11]": recording(kitti(lambda words, k: [*words[:3], "1e300", *words[4:]]), "pose", *KITTI),
    "all x equal [cr06]": recording(edited(write_commonroad, "<x>[^<]*</x>", "<x>1</x>"), "no width"),
    "bounds swapped [cr09]": recording(edited(write_commonroad, "(left|right)Bound", swapped), "no width"),
    "rows of another site": recording(ngsim(Location="i-80"), "i-80"),
    "one column in metres": recording(side_by_side_in_metres, "in one place"),
    "vehicle 7.5": recording(ngsim(Vehicle_ID=7.5), "Vehicle_ID"),
    "no speeds": recording(ngsim(v_Vel=""), "v_Vel"),
    "the last line cut": recording(edited(write_ngsim_text, r"(\s+\S+){4}\s*\Z", ""), "cut off"),
    "a lanelet twice": recording(edited(write_commonroad, "(<lanelet .*?</lanelet>)", r"\1\1", 1), "lanelet"),
    "an obstacle twice": recording(
        edited(write_commonroad, "(<dynamicObstacle .*?</dynamicObstacle>)", r"\1\1", 1), "obstacle"
    ),
    "time 5.5": recording(
        edited(write_commonroad, "<exact>5</exact></time>", "<exact>5.5</exact></time>"), "whole number"
    ),
    "no meta data of a vehicle": recording(
        edited(write_highd, "\n7,2,Car", "", 1, META), "1 without meta data", code=0
    ),
    "the wrong direction": recording(
        edited(write_highd, "\n7,2,", "\n7,1,", 1, META), "1 on the other carriageway", code=0
    ),
    "poses that mirror": recording(kitti(lambda words, k: ["-1", *words[1:]]), "pose", *KITTI),
    "an ego that jumps 20 km": recording(
        kitti(lambda words, k: [*words[:11], "20000"] if k > 30 else words), "leaps at 3.1 s", *KITTI
    ),
    "times as text": recording(
        av2(BOXES, lambda rows: rows.assign(timestamp_ns=rows.timestamp_ns.astype(str))), "timestamp_ns", *AV2
    ),
    "poses at 1e300 m": recording(av2(POSES, lambda rows: rows.assign(tx_m=1e300)), "city_SE3", *AV2),
    # Networks.
    "a net that ends at once": network("own.net.xml", net="<net>" + "x" * 10),
    "a detector in the net [own]": network("", 0, net=within_net(LOOP), routes=AT_ONCE),
    "edge data in the net [sec02]": network("crashed", net=within_net('<edgeData id="d" freq="1" file="victim"/>')),
    "a probe in the net [sec04]": network("", 0, net=within_net(PROBE), routes=AT_ONCE),
    "a probe [net25]": network("", 0, additional=f"<a>{PROBE}</a>", routes=AT_ONCE),
    "a detector in the net by a full path": network("--net", net=within_net(LOOP.replace("victim", "FOLDER/victim"))),
    "a probe by a full path": network("--net", additional=f"<a>{PROBE.replace('victim', 'FOLDER/victim')}</a>"),
    "a detector beside the net": network("", 0, additional=f"<a>{LOOP}</a>", routes=AT_ONCE),
    "a probe among the types [sec06]": network_folder(PROBE, "", 0),
    "a device that logs [net44]": network(
        "", 0, routes=AT_ONCE.replace("<route ", SSM).replace("<flow ", '<flow type="t" ')
    ),
    "a sign that reads [net23]": network("crashed", additional=SIGN),
    "a vast car park [net27]": network(
        "memory", additional='<a><parkingArea id="p" lane="upstream_0" roadsideCapacity="2000000000"/></a>'
    ),
    "a flow without end [net36]": network("--net", routes=VEHICLES.replace('number="3"', 'period="exp(1e9)"')),
    "resolution 1e-9": network("lateral-resolution", options='<lateral-resolution value="1e-9"/>'),
    "resolution 0x1p-30": network("lateral-resolution", options='<lateral-resolution value="0x1p-30"/>'),
    "braking nan": network("emergencydecel", options='<default.emergencydecel value="nan"/>'),
    "a polygon without colour [net28]": network(
        "colo", additional='<a><poly id="p" type="building" shape="0,0 1,0 1,1"/></a>'
    ),
    # Run folders.
    "55 million errors [rf45]": run_folder(many_errors, "errors.parquet", "report"),
    "nested 100 000 deep [rf29]": Input(
        lambda folder: (scene(folder) / "metrics.json").write_text("[" * 100_000) and ["compare", "scene", "scene"],
        "metrics.json",
    ),
    "scores of 64 GB that are a hole": Input(
        lambda folder: os.truncate(scene(folder) / "metrics.json", 1 << 36) or ["compare", "scene", "scene"], "scene"
    ),
    "one step of truth [rf14]": run_folder(truth(lambda rows: rows.assign(episode=rows.step)), "", "report", code=0),
    "lane 99": run_folder(truth(lambda rows: rows.assign(lane=99)), "lane of row", "run", *TRACKER, "--replay"),
    "visible fraction 5": run_folder(
        truth(lambda rows: rows.assign(visible_fraction=5.0)), "visible_fraction", "report"
    ),
    "every second step": run_folder(
        truth(lambda rows: rows[rows.step % 2 == 0]), "lacks steps", "run", *TRACKER, "--replay"
    ),
    "a replay without detections": run_folder(
        truth(lambda rows: rows[:0], "detections.parquet"), "--replay: nothing", "run", *TRACKER, "--replay"
    ),
    # Model files.
    "numbers of a model": Input(altered_model, "was altered"),
}
SLOW = re.compile(
    r"fcd4|fcd33|av214|rf45|rf14|net25|net27|net36|net44|sec0[246]|64 GB|beside the net|\[own|wrong dir|meta"
    r"|full path|net23|every second|lane 99|fraction 5"
)


def untouched(folder: Path) -> dict[str, tuple[int, int]]:
    """Return the state of what a command must leave alone."""
    own = re.compile(r"out(\.incomplete)?/|__pycache__|scene/(report.html|figures|\.mmpf)")
    return {file: state for file, state in state_of(folder).items() if not own.match(file)}


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if SLOW.search(n) else ()) for n in INPUTS])
def test_an_input_that_once_got_through_is_one_short_line_and_writes_nothing(name, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("harness.common.isolation.ProcessLimits.cpu_s", 2 if "comment of" in name else 5)
    words = INPUTS[name].make(tmp_path)
    before = untouched(tmp_path)
    code = run_command_line(words)
    told = capfd.readouterr().err
    assert code == INPUTS[name].code, told
    assert INPUTS[name].word in told
    assert code == 0 or (told.count("\n") == 1 and len(told) < 1500)
    assert untouched(tmp_path) == before
