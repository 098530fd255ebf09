"""The schema of all tables: each column declared once for writers, readers, checks and documentation."""

from dataclasses import dataclass, replace
from functools import partial

from harness.common.bounds import OF_THINGS, PLACE_M, Numbers
from mmpf.options.base import UNITS_BY_ENDING
from mmpf.scan import VEHICLE_CLASSES

SCHEMA_VERSION = 1
"""Version of the tables; it grows when a column goes or takes another meaning, not when an optional one comes."""
VERSION_KEY = "schema_version"

VISIBLE, PARTIAL, HIDDEN, OUT = range(4)
VISIBILITY_STATES = ("visible", "partial", "hidden", "out")
REPORTED_STATES = ("tentative", "confirmed", "hidden")
OUTCOMES = ("tracked", "missed", "lost", "hijacked", "untracked")
MATCHED_BY = ("", "gate", "identity")
BRAKING_KINDS = ("missed", "phantom")
FATES = ("none", "lost", "displaced", "hijacked", "ghost")

# Columns that say which cell of a grid a row is of.
NET, DENSITY, DEMAND, SEED, RECORDING, MISMATCH = "net", "density", "demand", "seed", "replay", "mismatch"
MODEL_FILE = "model_file"
AS_IS = "as is"
"""The world of a column ``mismatch`` that nothing alters."""

DENSITY_RANGE = (5.0, 65.0)
"""Lowest and highest density that may be asked for, vehicles per kilometre and lane."""
NOMINAL_LENGTH_M, NOMINAL_WIDTH_M = 4.7, 1.9
"""A car's usual size, for tables without sizes."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        type: ``int64``, ``float64``, ``float32``, ``bool`` or ``string``, as Arrow names them.
        unit: Unit; empty for a word, a count or a pure number.
        absent: What it means that a table lacks the column; empty where every table has it.
        trackers: Whether trackers get it, or made it; everything else is for scoring alone.
        words: What a text is one of, in the order of its codes; empty for any text.
        numbers: What its numbers may be; None of texts, and where gaps are usual.
        named: Whether it is a text that no row may lack.
    """

    type: str
    name: str
    meaning: str
    unit: str = ""
    absent: str = ""
    trackers: bool = False
    words: tuple[str, ...] = ()
    numbers: Numbers | None = None
    named: bool = False

    @property
    def is_text(self) -> bool:
        """Whether it holds texts."""
        return self.type == "string"


@dataclass(frozen=True)
class Table:
    """A table of a folder: what a row is, its columns in their order, and whether rows must be in the order of time."""

    meaning: str
    columns: tuple[Column, ...]
    in_order: bool = False

    @property
    def needed(self) -> tuple[str, ...]:
        """Names of the columns that every such table has."""
        return tuple(column.name for column in self.columns if not column.absent)

    def of(self, name: str) -> Column:
        """Return a column; of a name that is not declared, one of numbers, as a grid's metrics are."""
        return next((column for column in self.columns if column.name == name), _number(name, ""))


def _number(name: str, meaning: str, unit: str | None = None, **more: object) -> Column:
    """Return a column of numbers; its unit is the name's ending unless given."""
    by_name = next((unit for ending, unit in UNITS_BY_ENDING.items() if name.endswith(ending)), "")
    return replace(Column("float64", name, meaning, by_name if unit is None else unit), **more)  # type: ignore[arg-type]


SHARE, POSITIVE, GAPS = Numbers(0.0, 1.0), Numbers(1e-12, 1e8), Numbers(gaps=True)
COUNT, WHOLE, FLAG = Numbers(0.0, 1e9), Numbers(0, 1e9, whole=True), Numbers(0, 1, whole=True)
_whole, _flag, _text = (partial(Column, kind) for kind in ("int64", "bool", "string"))

STEP = _whole("step", "number of the step, from 0", numbers=WHOLE)
TIME = _number("time_s", "time since the first step", numbers=COUNT)
EPISODE = _whole("episode", "number of the episode, one for each ego; no identity goes on in another", numbers=WHOLE)
WHEN = (STEP, TIME, EPISODE)
LON = _number("lon_m", "longitudinal position of the centre; in the plane, x", numbers=PLACE_M)
LAT = _number("lat_m", "lateral position of the centre, positive to the left; in the plane, y", numbers=PLACE_M)
LON_SPEED = _number("speed_mps", "speed along the road, in the plane along the heading")
LAT_SPEED = _number("lat_speed_mps", "lateral speed, positive to the left")
ACCEL = _number("accel_mps2", "longitudinal acceleration")
STDS = (
    _number("std_lon_m", "standard deviation of `lon_m`, as it was reported"),
    _number("std_lat_m", "standard deviation of `lat_m`, likewise"),
    _number("std_speed_mps", "standard deviation of `speed_mps`, likewise"),
)
VEHICLE = _text("vehicle_id", "name of the vehicle, as its source calls it", named=True)
TRACK = _whole("track_id", "identity of the track, never used again", numbers=Numbers(-1, 2.0**53, whole=True))
OR_NONE = replace(TRACK, meaning="identity of the track, -1 for none")
STATE = _text("state", "how much of the vehicle the sensor sees", words=VISIBILITY_STATES)
NO_SIZES = "the sensor measures no sizes"
NO_HEADINGS = "the sensor measures no directions"
WHOLE_ROAD = "the source knows of all vehicles everywhere"


def _true(*columns: Column) -> tuple[Column, ...]:
    """Return columns of what is true of a vehicle, whose numbers are as things on roads have them."""
    known = {name: replace(numbers, gaps=False) for name, numbers in OF_THINGS.items()}
    return tuple(replace(column, numbers=known.get(column.name, column.numbers)) for column in columns)


def _seen(*columns: Column) -> tuple[Column, ...]:
    """Return columns as trackers get or make them."""
    return tuple(replace(column, trackers=True) for column in columns)


RUN_IDENTITY = (
    _text("net", "network", named=True),
    _number("density", "density that was asked for, vehicles per kilometre and lane", numbers=Numbers(0.0, gaps=True)),
    _text("demand", "traffic demand"),
    _text("tracker", "tracker", named=True),
    _text("variant", "label of the tracker with its options", named=True),
    _text("model", "motion model"),
    _text("update", "update rule"),
    _whole("seed", "root seed", numbers=Numbers(0, 2.0**53, whole=True)),
)
RUN_OUTCOME = (
    _flag("succeeded", "whether the run ended well"),
    _text("error", "what went wrong, if it did not"),
    _number("total_s", "wall time of the run"),
)

TABLES: dict[str, Table] = {
    "truth.parquet": Table(
        "A row for each vehicle and step. A tracker gets the ego's pose, and no more of it.",
        (
            *WHEN, VEHICLE,
            *_true(
                LON, LAT,
                _number("heading_rad", "heading against the road's direction, positive to the left"),
                LON_SPEED, LAT_SPEED, ACCEL,
                _whole("lane", "lane number; 0 off the road"),
                _number("length_m", "length"),
                _number("width_m", "width"),
            ),
            _flag("is_ego", "whether it is the vehicle with the sensor; one in every step"),
            _flag("in_range", "whether its centre is within the sensor's range"),
            _number("visible_fraction", "share of it that the sensor can see, 0 to 1; 1 for the ego", numbers=SHARE),
            STATE,
            _text("occluder_id", "vehicle that covers most of it; empty where none does"),
            _number("window_start_m", "where the part of the road begins that is on record", absent=WHOLE_ROAD),
            _number("window_end_m", "where it ends; beyond it nothing is scored", absent=WHOLE_ROAD),
            _number("direction_rad", "direction that its errors are taken along", absent="that is the road's own"),
            _flag("parked", "whether it stands still for as long as it is on record", absent="nobody tells"),
            _flag("pedestrian", "whether it is a person on foot, who is not scored", absent="none is known"),
            _flag("on_roundabout", "whether it is on a roundabout", absent="none is known"),
            _text("vehicle_class", "class of the vehicle", absent="no detection has one", words=VEHICLE_CLASSES),
            _number("pseudo_hidden_s", "length of the time for which its detections are withheld, 0 if they are not",
                    absent="no vehicle is hidden on purpose"),
            _number("wall_fraction", "share of it that walls hide, 0 to 1", absent="the road has no walls",
                    numbers=SHARE),
            _text("signals", "a letter for each signal of the road, `1` open and `0` closed; trackers are told them by "
                  "`tracker.knows_signals`", absent="there are none, or their states are not on record"),
        ),
        in_order=True,
    ),
    "detections.parquet": Table(
        "A row for each detection.",
        (
            STEP, *_seen(TIME), EPISODE,
            _whole("detection", "its number in the scan"),
            *_seen(
                LON, LAT,
                replace(LON_SPEED, meaning="measured longitudinal speed; nan where it is not measured", numbers=GAPS),
                *(replace(std, numbers=replace(POSITIVE, gaps=std.name == "std_speed_mps")) for std in STDS),
                _number("length_m", "length of the box fitted to the vehicle", absent=NO_SIZES),
                _number("width_m", "its width, likewise", absent=NO_SIZES),
                _number("std_length_m", "standard deviation of `length_m`, as the sensor reports it", absent=NO_SIZES),
                _number("std_width_m", "standard deviation of `width_m`, likewise", absent=NO_SIZES),
                _number("heading_rad", "direction of the box against the longitudinal axis", absent=NO_HEADINGS),
                _number("std_heading_rad", "its standard deviation, if front is not back", absent=NO_HEADINGS),
                _number("flip_probability", "probability that the front is taken for the back", absent=NO_HEADINGS),
                _number("correlation", "correlation of the noise of both places", absent="the sensor tells none",
                        numbers=Numbers(1e-12 - 1.0, 1.0 - 1e-12)),
                _number("score", "confidence of the detector, 0 to 1", absent="the detector gives none"),
                _text("vehicle_class", "class that the detector takes it for", absent="the detector gives none",
                      words=VEHICLE_CLASSES),
            ),
            _number("visible_fraction", "share of the vehicle that the sensor can see; nan of a false detection"),
            _text("truth_id", "vehicle that it came from; empty of a false detection"),
        ),
        in_order=True,
    ),
    "tracks.parquet": Table(
        "A row for each track and step.",
        (
            *WHEN,
            *_seen(
                TRACK, LON, LAT, LON_SPEED, LAT_SPEED, ACCEL, *STDS,
                _number("existence", "probability that the track is a vehicle", numbers=SHARE),
                _text("state", "the tracker's own state; `tentative` is not scored", words=REPORTED_STATES),
            ),
        ),
        in_order=True,
    ),
    "errors.parquet": Table(
        "A row for each vehicle in range and step, from its first detection until 10 s after its last: estimate minus "
        "truth, position along and across the vehicle's direction.",
        (
            *WHEN, VEHICLE, OR_NONE, STATE,
            _number("seconds_hidden", "time since the last detection while hidden, else 0", "s"),
            _number("lon_error_m", "error of the position along the direction"),
            _number("lat_error_m", "error across it"),
            _number("speed_error_mps", "error of the longitudinal speed"),
            _number("lat_speed_error_mps", "error of the lateral speed"),
            *STDS,
            _text("matched_by", "how the track was found: within the gate, or as the one before", words=MATCHED_BY),
            _text("outcome", "what became of the vehicle; only `tracked` counts in a mean", words=OUTCOMES),
        ),
    ),
    "events.parquet": Table(
        "A row for each occlusion.",
        (
            EPISODE, VEHICLE,
            _whole("from_step", "step of the last detection before"),
            _number("from_s", "its time"),
            _whole("to_step", "step of the detection at which the vehicle is back"),
            _number("to_s", "its time"),
            _number("duration_s", "time between the two"),
            OR_NONE,
            _text("outcome", "what happened to the vehicle's track", words=("same_id", "survived", "hijacked", "lost")),
            _number("reacquire_s", "time from the return until a track is on the vehicle"),
        ),
    ),
    "brakings.parquet": Table(
        "A row for each missed or phantom braking of the ego's driver.",
        (
            _text("kind", "braking by the truth only (`missed`) or the tracks only (`phantom`)", words=BRAKING_KINDS),
            EPISODE,
            _whole("from_step", "step at which it begins"),
            _whole("to_step", "its last step"),
            replace(STEP, meaning="step at which truth and tracks differ most"),
            _number("duration_s", "how long it lasts"),
            _number("truth_mps2", "what the driver would do by the truth there"),
            _number("tracks_mps2", "what it would do by the tracks"),
            _text("vehicle_id", "vehicle to blame, or that the track to blame follows; empty for none"),
            _text("visibility", "the vehicle's state; empty for none", words=("", *VISIBILITY_STATES)),
            _number("unseen_s", "time since the vehicle's last detection; nan if it had none"),
            OR_NONE,
            _text("fate", "what happened to the vehicle's track", words=FATES),
        ),
    ),
    "commands.parquet": Table(
        "A row for each step: what the ego's driver would do by the truth and by the tracks.",
        (
            *WHEN,
            _flag("judged", "whether the step counts in the scores"),
            *(
                column
                for by, name in (("the truth", "truth"), ("the tracks", "tracks"))
                for column in (
                    _number(f"{name}_mps2", f"acceleration by {by}"),
                    _number(f"{name}_gap_m", f"gap by {by} to the vehicle right ahead; infinite where there is none"),
                    _flag(f"{name}_left", f"whether the gap on the left is accepted by {by}"),
                    _flag(f"{name}_right", f"whether the gap on the right is accepted by {by}"),
                )
            ),
        ),
    ),
    "unseen.parquet": Table(
        "Twice a second a row for each stretch of lane of 25 m that lies within range from end to end.",
        (
            *WHEN,
            _whole("stretch", "number of the stretch"),
            _number("from_lon_m", "where its middle line begins"),
            _number("from_lat_m", "likewise"),
            _number("to_lon_m", "where its middle line ends"),
            _number("to_lat_m", "likewise"),
            _number("expected", "vehicles expected there that no track stands for"),
        ),
    ),
    "particles.parquet": Table(
        "A few particles of each step, of a tracker that has some.",
        (STEP, replace(LON, type="float32"), replace(LAT, type="float32")),
    ),
    "diagnostics.parquet": Table(
        "A row for each step: what happened inside a tracker that tells it.",
        (
            *WHEN,
            _whole("components", "components after the step"),
            _number("effective_share", "mean effective sample size after weighting, as a share of the particles"),
            _whole("births", "components added"),
            _whole("deaths", "components removed"),
            _whole("merges", "components merged into others"),
            _whole("reclusterings", "components clustered anew or identified again"),
            _number("association_entropy", "mean entropy of the association", "nats"),
        ),
    ),
    "runs.parquet": Table(
        "A row for each run of a grid; every other column is a setting that was varied, or a number of `metrics.json` "
        "by its [key](metrics.md).",
        (
            *RUN_IDENTITY, *RUN_OUTCOME,
            _text("replay", "file name of the recording", absent="the traffic is simulated"),
            _text(MODEL_FILE, "file of a fitted model and its SHA-256", absent="it is the packaged model"),
            _text("mismatch", "what the sensor's data sheet does not tell", absent="nothing was altered"),
            *(_text(f"recording.{name}", f"{name} of the recording", absent="the traffic is simulated")
              for name in ("file", "format", "ego")),
            *(_text(name, meaning, absent="it is no grid of `drive`") for name, meaning in (
                ("episode.kind", "`free`, or how the episode is provoked"), ("episode.ego", "vehicle that is driven"),
                ("episode.provoked", "vehicle that provokes it"), ("drive.ended", "why it ended"),
                ("drive.collided_with", "vehicle that the ego collided with"),
            )),
        ),
    ),
}  # fmt: skip
"""Each table by its file."""
