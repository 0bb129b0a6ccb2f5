"""GPS positions in a local metric frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# WGS84: semi-major axis in metres, and first eccentricity squared.
EQUATORIAL_RADIUS = 6_378_137.0
ECCENTRICITY_SQUARED = 6.694_379_990_14e-3


def local_metres(places: Sequence[tuple[float, float, float] | None]) -> np.ndarray | None:
    """(F, 3) metres east, down and north of the mean position, NaN where unknown.

    These are right, down and forward for someone who faces north. None if fewer than three positions are known.

    Args:
        places: latitude and longitude in degrees and altitude in metres (WGS84), or None.
    """
    known = [index for index, place in enumerate(places) if place is not None]
    if len(known) < 3:
        return None
    degrees = np.array([places[index] for index in known], dtype=np.float64)
    # Beyond the 180th meridian longitudes go on at -180: their median would be on the other side of the Earth.
    degrees[:, 1] = degrees[0, 1] + (degrees[:, 1] - degrees[0, 1] + 180) % 360 - 180
    middle = np.median(degrees, axis=0)
    latitude, longitude = np.radians(middle[:2])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    axes = np.stack([east, -up, np.cross(up, east)])
    found = np.full((len(places), 3), np.nan)
    found[known] = (_earth_centred(degrees) - _earth_centred(middle[None])) @ axes.T
    return found


def _earth_centred(places: np.ndarray) -> np.ndarray:
    """(N, 3) geodetic to Earth-centred coordinates, metres."""
    latitude, longitude = np.radians(places[:, 0]), np.radians(places[:, 1])
    normal = EQUATORIAL_RADIUS / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    across = (normal + places[:, 2]) * np.cos(latitude)
    along = (normal * (1 - ECCENTRICITY_SQUARED) + places[:, 2]) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), along], axis=1)
