"""A setting: a frozen field with bounds, meaning and unit, addressed by a dotted key."""

from collections.abc import Iterator
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic.fields import FieldInfo

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
LARGEST = 1e100
"""Of finite numbers; the squares of larger ones are none."""
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class NamesCode:
    """Marks a setting that may be ``module:attribute``, which is imported: code, which no file of settings chooses."""


CodeName = Annotated[str, Field(min_length=1), NamesCode()]

# Of two endings that fit a name the longer one comes first.
UNITS_BY_ENDING = {
    "_per_s": "1/s",
    "_per_scan": "1/scan",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_rad": "rad",
    "_deg": "°",
    "_std": "σ",  # noqa: RUF001
    "_m": "m",
    "_s": "s",
}


class WithoutTruthValues(BaseModel):
    """Refuses true, false and texts such as 1_0 where a number is asked for; pydantic would take them for numbers."""

    @field_validator("*", mode="before")
    @classmethod
    def _is_no_truth_value(cls, value: object, info: ValidationInfo) -> object:
        annotation = cls.model_fields[str(info.field_name)].annotation
        if isinstance(value, bool) and _is_number(annotation):
            raise ValueError("input should be a number")
        if isinstance(value, int | float) and LARGEST < abs(value) < float("inf"):
            raise ValueError(f"no number is as large; {LARGEST:g} is the largest, and inf is none at all")
        if isinstance(value, float) and _is_whole(annotation):
            raise ValueError("input should be a whole number without a point")
        # Python reads 1_0 as 10; nobody who writes it in quotes or as an option means that.
        if isinstance(value, str) and "_" in value and _is_number(annotation):
            raise ValueError("input should be a number")
        return value


def _is_number(annotation: object) -> bool:
    """Return whether a type is a number, or one of several of which none is a truth value."""
    kinds = get_args(annotation) or (annotation,)
    return bool not in kinds and any(kind in (int, float) or (get_args(kind) and _is_number(kind)) for kind in kinds)


def _is_whole(annotation: object) -> bool:
    kinds = get_args(annotation) or (annotation,)
    return int in kinds and float not in kinds


class Settings(WithoutTruthValues):
    """Base of all settings: frozen, a key that does not exist is an error, and each field says what it means."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


def in_unit(unit: str) -> Any:  # noqa: ANN401
    """Return what states the unit of a setting whose name does not tell it, for ``Annotated``."""
    return Field(json_schema_extra={"unit": unit})


def unit_of(key: str, field: FieldInfo) -> str:
    """Return a setting's unit: what stands beside it, or the ending of its name; empty for a pure number or a word."""
    if isinstance(field.json_schema_extra, dict) and "unit" in field.json_schema_extra:
        return str(field.json_schema_extra["unit"])
    return next((unit for ending, unit in UNITS_BY_ENDING.items() if key.endswith(ending)), "")


def names_code(field: FieldInfo) -> bool:
    """Return whether a setting may name code."""

    def marked(kind: object) -> bool:
        return isinstance(kind, NamesCode) or any(map(marked, (*get_args(kind), *getattr(kind, "__metadata__", ()))))

    return any(map(marked, (field.annotation, *field.metadata)))


def fields_of(settings: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield each setting with its dotted key, those of groups within groups too, in the order of their definition."""
    for name, field in settings.model_fields.items():
        kinds = [kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type)]
        group = next((kind for kind in kinds if issubclass(kind, BaseModel)), None)
        if group is None:
            yield f"{prefix}{name}", field
        else:
            yield from fields_of(group, f"{prefix}{name}.")
