"""Made-up leader-follower pairs in the layout of the recorded ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

LEADER_LENGTH_M, FOLLOWER_LENGTH_M = 6.0, 4.0
STEP_S = 0.1


def pair_rows(name: str, seconds: float, gap_m: float = 15.0, swing_mps: float = 2.0, lane: int = 2) -> pd.DataFrame:
    """Both at 10 m/s and swinging alike, the follower a second later; positions are the integrals of the speeds."""
    time = np.arange(round(seconds / STEP_S) + 1) * STEP_S
    phase = float(len(name) + sum(map(ord, name)))

    def speed(at_s: np.ndarray) -> np.ndarray:
        return 10.0 + swing_mps * np.sin(0.5 * at_s + phase)

    def distance(at_s: np.ndarray) -> np.ndarray:
        return 10.0 * at_s - 2.0 * swing_mps * (np.cos(0.5 * at_s + phase) - np.cos(phase))

    return pd.DataFrame(
        {
            "pair_id": name,
            "time": time,
            "frame_id": 1000.0 + np.arange(len(time)),
            "local_x": 3.66 * (lane - 0.5) + 0.1 * np.sin(time),
            "local_y": distance(time - 1.0),
            "v_vel": speed(time - 1.0),
            "v_length": FOLLOWER_LENGTH_M,
            "lane_id": str(lane),
            "preceding_local_y": distance(time) + gap_m - 10.0 + LEADER_LENGTH_M,
            "preceding_vel": speed(time),
            "preceding_length": LEADER_LENGTH_M,
        }
    )


def write_pairs(path: Path, pairs: Sequence[pd.DataFrame] | None = None, count: int = 8) -> Path:
    pairs = [pair_rows(f"{k}-{k + 1}", 39.0, 12.0 + k) for k in range(count)] if pairs is None else pairs
    pd.concat(list(pairs), ignore_index=True).to_parquet(path)
    return path
