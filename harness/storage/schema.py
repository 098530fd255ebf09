"""The names of columns and of states in the tables on disk."""

VISIBLE, PARTIAL, HIDDEN, OUT = range(4)
VISIBILITY_STATES = ("visible", "partial", "hidden", "out")

# Columns of the truth table that hold a frame's window; absent where it is everywhere.
WINDOW_COLUMNS = ("window_start_m", "window_end_m")
# Column of the truth table that holds the directions that vehicles are scored along; absent where that is the road's.
DIRECTION_COLUMN = "direction_rad"
# Column of the truth table that says who is parked; absent where the source does not know.
PARKED_COLUMN = "parked"
# Column of the truth table that says who is on a roundabout; absent where the network has none, or none that is known.
ROUNDABOUT_COLUMN = "on_roundabout"
# Column of the truth table that says who is on foot; absent where the source knows of nobody who could be.
PEDESTRIAN_COLUMN = "pedestrian"
# Column of the truth table with the share of each vehicle that walls hide; absent where there are no walls.
WALL_COLUMN = "wall_fraction"
# Column of the truth table that holds the states of signals; absent where the road has none.
SIGNALS_COLUMN = "signals"

TRUTH_NUMBERS = (
    "lon_m",
    "lat_m",
    "heading_rad",
    "speed_mps",
    "lat_speed_mps",
    "accel_mps2",
    "lane",
    "length_m",
    "width_m",
)
DETECTION_NUMBERS = ("lon_m", "lat_m", "speed_mps", "std_lon_m", "std_lat_m", "std_speed_mps")
DETECTION_SIZES = ("length_m", "width_m", "std_length_m", "std_width_m")
DETECTION_CORRELATION = "correlation"
DETECTION_HEADINGS = ("heading_rad", "std_heading_rad", "flip_probability")
TRACK_NUMBERS = (
    "lon_m",
    "lat_m",
    "speed_mps",
    "lat_speed_mps",
    "accel_mps2",
    "std_lon_m",
    "std_lat_m",
    "std_speed_mps",
    "existence",
)

# Columns that say which cell of a grid a row is of.
NET, DENSITY, DEMAND, SEED, RECORDING, MISMATCH = "net", "density", "demand", "seed", "replay", "mismatch"

DENSITY_RANGE = (5.0, 65.0)
"""Lowest and highest density that may be asked for, vehicles per kilometre and lane."""
NOMINAL_LENGTH_M, NOMINAL_WIDTH_M = 4.7, 1.9
"""A car's usual size, for tables without sizes."""
