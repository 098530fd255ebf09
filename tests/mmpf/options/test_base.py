"""What a setting is: its meaning at run time, its unit, its dotted key."""

from typing import Annotated

import pytest
from pydantic import ValidationError

from mmpf.options.base import Positive, Settings, fields_of, in_unit, unit_of


class Wheel(Settings):
    """A wheel."""

    radius_m: Positive = 0.3
    """Half its width."""
    decay_per_s: float = 0.1
    """How fast it wears."""
    noise: Annotated[float, in_unit("m²/s³")] = 1.0
    """How much it shakes."""


class Cart(Settings):
    """A cart."""

    wheels: int = 4
    """How many."""
    front: Wheel = Wheel()
    """The front ones."""
    spare: Wheel | None = None
    """One more."""


def test_settings_are_found_by_their_path_with_meaning_and_unit() -> None:
    found = {key: (unit_of(key, field), field.description) for key, field in fields_of(Cart)}
    wheel = {
        "radius_m": ("m", "Half its width."),
        "decay_per_s": ("1/s", "How fast it wears."),
        "noise": ("m²/s³", "How much it shakes."),
    }
    expected = {"wheels": ("", "How many.")}
    for group in ("front", "spare"):
        expected |= {f"{group}.{name}": words for name, words in wheel.items()}
    assert found == expected
    assert list(found) == list(expected)


def test_settings_can_not_be_changed_nor_take_a_key_that_does_not_exist() -> None:
    with pytest.raises(ValidationError):
        Cart().wheels = 3
    with pytest.raises(ValidationError, match=r"front\.width_m"):
        Cart.model_validate({"front": {"width_m": 1.0}})


class Lamp(Settings):
    """A lamp."""

    on: bool = False
    """Whether it shines."""
    bulbs: int | None = None
    """How many."""
    dimmed: bool | float = False
    """Whether, or by how much."""


@pytest.mark.parametrize("value", [True, False])
def test_a_truth_value_is_no_number(value: bool) -> None:
    for kind, name in ((Wheel, "radius_m"), (Wheel, "noise"), (Cart, "wheels"), (Lamp, "bulbs")):
        with pytest.raises(ValidationError, match="should be a number"):
            kind.model_validate({name: value})
    assert Lamp.model_validate({"on": value, "dimmed": value}) == Lamp(on=value, dimmed=value)
