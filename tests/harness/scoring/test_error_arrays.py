"""The numbers of an error table."""

import pandas as pd

from harness.scoring.evidence.errors import error_arrays


def test_a_vehicle_of_the_same_name_in_another_episode_is_another_vehicle():
    numbers = ("lon_error_m", "lat_error_m", "speed_error_mps", "lat_speed_error_mps", "seconds_hidden")
    errors = pd.DataFrame(
        {
            "episode": [0, 0, 1, 1],
            "vehicle_id": ["a", "b", "a", "b"],
            "state": "visible",
            "outcome": "tracked",
            **dict.fromkeys(numbers, 0.0),
        }
    )
    assert len(set(error_arrays(errors).vehicle)) == 4
