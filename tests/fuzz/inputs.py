"""The kinds of input that are spoilt: each makes files in a folder and returns the command that reads them."""

import os
import random
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pandas as pd

from harness.commands.compare import Options as CompareOptions
from harness.config.options import RunOptions, options_of
from mmpf.motion.gmm.model_file import DIGEST, save_arrays
from tests.fuzz.mutations import DONE, WORDS, spoilt_bytes, spoilt_table
from tests.harness.recorded_scene import write_recorded_scene
from tests.harness.truth.recorded import layouts

ROOT = Path(__file__).parents[2]
US101 = ROOT / "networks" / "us101"
SHORT = ["--tracker", "tests.harness.stand_ins:plain_tracker", "--duration", "1"]
SAID_BELOW = ("tracker", "duration", "out")
ROUTES = (
    '<routes><vType id="t" length="5" width="1.8" maxSpeed="30"/><route id="r" edges="upstream auxiliary downstream"/>'
    '<flow id="f" type="t" route="r" begin="0" end="60" number="60" departSpeed="20"/></routes>'
)
CONFIGURATION = (
    '<configuration><net-file value="us101.net.xml"/><route-files value="a.rou.xml"/><begin value="0"/>'
    '<time-to-teleport value="-1"/></configuration>'
)


def command_line(folder: Path, rng: random.Random) -> list[str]:
    """Options of several commands with values that they do not have."""
    name = rng.choice(["run", "run", "run", "compare", "export", "report", "nets", "settings"])
    table = {"run": RunOptions, "compare": CompareOptions}.get(name)
    if table is None:
        return [name, *rng.choices([*WORDS, "--to", "mot", "--out", "--json", "--force"], k=rng.randint(0, 3))]
    words = [name]
    # Of what is given twice the last counts, so what is said below is not worth spoiling.
    entries = {key: entry for key, entry in options_of(table).items() if name != "run" or key not in SAID_BELOW}
    for option in rng.sample(sorted(entries), rng.randint(1, 3)):
        flag = entries[option].option.flag or f"--{option.replace('_', '-')}"
        words += [flag] if entries[option].types[0] is bool else [flag, rng.choice(WORDS)]
    return [*words, "--out", str(folder / "out"), *(SHORT if name == "run" else [])]


def settings(folder: Path, rng: random.Random) -> list[str]:
    """Words of --set, and configuration files."""
    keys = _setting_names()
    if rng.random() < 0.5:
        words = [f"{rng.choice(keys)}={rng.choice(WORDS)}" for _ in range(rng.randint(1, 3))]
        chosen = [word for setting in words for word in ("--set", setting)]
    else:
        config = folder / "config.toml"
        config.write_bytes(spoilt_bytes((_scene() / "config.toml").read_bytes(), rng))
        chosen = ["--config", str(config)]
    traffic = rng.choice([_scene(), layouts.write_fcd(folder / "recording"), layouts.write_fcd(folder / "recording")])
    return ["run", *chosen, *SHORT[:2], "--replay", str(traffic), "--out", str(folder / "out")]


def recording(folder: Path, rng: random.Random) -> list[str]:
    """Files of recorded traffic in every format."""
    names = ("commonroad", "fcd", "ngsim_csv", "ngsim_text", "highd")
    write: Callable[[Path], Path] = getattr(layouts, f"write_{rng.choice(names)}")
    path = write(folder / "recording")
    spoilt = rng.choice(sorted(path.iterdir())) if path.is_dir() else path
    DONE.append(spoilt.name)
    spoilt.write_bytes(spoilt_bytes(spoilt.read_bytes(), rng))
    return ["run", "--replay", str(path), *SHORT, "--out", str(folder / "out")]


def network(folder: Path, rng: random.Random) -> list[str]:
    """Folders with a network.toml, and SUMO configurations."""
    mine = folder / "net"
    mine.mkdir()
    for file in US101.iterdir():
        if file.suffix in (".xml", ".toml"):
            shutil.copy(file, mine / file.name)
    if rng.random() < 0.5:
        (mine / "network.toml").unlink()
        (mine / "a.rou.xml").write_text(ROUTES)
        (mine / "a.sumocfg").write_text(CONFIGURATION)
        chosen = mine / rng.choice(["a.rou.xml", "a.sumocfg", "us101.net.xml", "us101.net.xml"])
    else:
        names = ["network.toml", "network.toml", "vehicles.add.xml", "calibration.toml", "us101.net.xml"]
        chosen = mine / rng.choice(names)
    DONE.append(chosen.name)
    chosen.write_bytes(spoilt_bytes(chosen.read_bytes(), rng))
    return ["run", "--net", str(mine), *SHORT, "--out", str(folder / "out")]


def result_folder(folder: Path, rng: random.Random) -> list[str]:
    """Runs of others: replayed, shown, exported and compared."""
    theirs = folder / "run"
    shutil.copytree(_scene(), theirs)
    chosen = rng.choice(sorted(file for file in theirs.iterdir() if file.is_file()))
    DONE.append(chosen.name)
    if chosen.suffix == ".parquet" and rng.random() < 0.8:
        table = spoilt_table(pd.read_parquet(chosen), rng)
        try:
            table.to_parquet(chosen)
        except (ValueError, TypeError):
            chosen.write_bytes(b"PAR1")
    elif (other := rng.random()) < 0.15:
        chosen.unlink()
        # Without an end, or far larger than what it takes.
        if other < 0.05:
            chosen.symlink_to("/dev/zero")
        elif other < 0.1:
            chosen.touch()
            os.truncate(chosen, 1 << 36)
    else:
        chosen.write_bytes(spoilt_bytes(chosen.read_bytes(), rng))
    return rng.choice(
        [
            ["run", "--replay", str(theirs), *SHORT[:2], "--out", str(folder / "out")],
            ["report", str(theirs)],
            *(["export", str(theirs), "--to", name, "--out", str(folder / "out")] for name in ("mot", "fcd", "csv")),
            ["compare", str(_scene()), str(theirs)],
        ]
    )


def model(folder: Path, rng: random.Random) -> list[str]:
    """Files of fitted models."""
    path = folder / "model.npz"
    content = ROOT / "mmpf" / "models" / "lane_keeping.npz"
    if rng.random() < 0.5:
        path.write_bytes(spoilt_bytes(content.read_bytes(), rng))
    else:
        with np.load(content) as stored:
            arrays = {name: stored[name] for name in stored.files}
        name = rng.choice(sorted(arrays))
        ways = {
            "nan": arrays[name] * np.nan, "first": arrays[name][:1], "flat": arrays[name].reshape(-1),
            "negated": -arrays[name], "zero": 0.0 * arrays[name], "text": np.array(["text"]),
            "one more axis": arrays[name][..., None], "huge": 1e300 * arrays[name],
        }  # fmt: skip
        way = rng.choice(sorted(ways))
        arrays[name] = ways[way]
        DONE.append(f"{name} {way}")
        if way != "text" and rng.random() < 0.5:
            # With a digest of its own, so that what stands behind the digest's check is tried, too.
            save_arrays(path, {key: values for key, values in arrays.items() if key != DIGEST})
        else:
            np.savez(path, **arrays)
    tracker = ["--particles", "20"]
    return ["run", "--model-file", str(path), *tracker, "--replay", str(_scene()), "--out", str(folder / "out")]


INPUTS: dict[str, Callable[[Path, random.Random], list[str]]] = {
    "command line": command_line, "settings": settings, "recording": recording, "network": network,
    "result folder": result_folder, "model": model,
}  # fmt: skip


@cache
def _scene() -> Path:
    return write_recorded_scene(Path(mkdtemp(prefix="fuzz-scene-")) / "scene")


@cache
def _setting_names() -> list[str]:
    from harness.config.model import RunConfig  # noqa: PLC0415
    from harness.config.sensor import SensorSettings  # noqa: PLC0415
    from mmpf.options.base import fields_of  # noqa: PLC0415

    sensor = [f"sensor.{name}" for name in SensorSettings.model_fields]
    return [*(name for name, _ in fields_of(RunConfig)), *sensor, "traffic.recording", "tracker", "traffic", "sensor"]
