"""Measured headings: the headings of new particles, and the likelihood of a heading."""

import numpy as np

from mmpf.numerics.arrays import FloatArray, wrapped
from mmpf.scan import BodyHeadings

WRONG_SHARE = 0.05
"""Share of measured directions that have nothing to do with the vehicle's."""


def drawn_directions(otherwise_rad: FloatArray, headings: BodyHeadings, rng: np.random.Generator) -> FloatArray:
    """Return directions drawn around measured ones, shape (n,).

    Args:
        otherwise_rad: The direction where the measured one has nothing to do with the vehicle's, of equally many
            particles for each measured one, one after the other, shape (n,).
        headings: What was measured, of shape (k,).
        rng: Source of randomness.
    """
    count = len(otherwise_rad)
    each = count // len(headings.heading_rad)
    measured, std, flipped = (
        np.repeat(column, each) for column in (headings.heading_rad, headings.std_rad, headings.flip_probability)
    )
    drawn, doubt = rng.uniform(size=(2, count))
    heading = measured + std * rng.standard_normal(count) + np.pi * (drawn < flipped)
    return np.where(doubt < WRONG_SHARE, otherwise_rad, wrapped(heading))


def heading_ratio(direction_rad: FloatArray, headings: BodyHeadings) -> FloatArray:
    """Return the likelihood of each measured direction, given the particle's, over a uniform density 1 / (2 pi), (n,).

    Args:
        direction_rad: Directions of the particles, shape (n,).
        headings: The direction measured for each particle, struct of shape (n,).
    """
    off = np.abs(wrapped(direction_rad - headings.heading_rad)) / headings.std_rad
    back = np.pi / headings.std_rad - off
    flipped = headings.flip_probability
    peak = (1.0 - flipped) * np.exp(-0.5 * off**2) + flipped * np.exp(-0.5 * back**2)
    return np.asarray(WRONG_SHARE + (1.0 - WRONG_SHARE) * peak * np.sqrt(2.0 * np.pi) / headings.std_rad)
