"""Resolution that falls with the distance from where the eye looks."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

HUMAN_E2_DEG = 2.3
"""Eccentricity at which the smallest detail is twice that of the fovea."""

UInt8Array = NDArray[np.uint8]
FloatArray = NDArray[np.float64]


class Foveation:
    """Coarsens pictures, of unchanged size, the more the farther from the gaze.

    The smallest detail that is distinguished grows linearly with the eccentricity e, the angle from
    the gaze: detail(e) = detail(0) (1 + e / E2), with E2 about 2.3 degrees for letters and
    gratings (Weymouth 1958; Strasburger, Rentschler and Juettner 2011, "Peripheral vision and
    pattern recognition: A review", J. Vision 11(5):13). A pixel shows the mean of the aligned block
    of 2^k x 2^k pixels around it, the largest that is no wider than the detail there.

    Args:
        height, width: of the pictures, pixels.
        vertical_fov_deg: their full vertical angle.
        e2_deg: E2.
        detail_deg: the detail at the fovea; None: a pixel in the middle of the picture, which is
            then as sharp as it was. 1/60 is a person's acuity: nothing changes where a pixel is
            coarser than that all over.
    """

    def __init__(
        self,
        height: int,
        width: int,
        *,
        vertical_fov_deg: float = 90.0,
        e2_deg: float = HUMAN_E2_DEG,
        detail_deg: float | None = None,
    ) -> None:
        self._size = height, width
        focal_px = 0.5 * height / math.tan(math.radians(vertical_fov_deg) / 2.0)
        y = 0.5 * (height - 1) - np.arange(height, dtype=np.float64)
        x = np.arange(width, dtype=np.float64) - 0.5 * (width - 1)
        rays = np.empty((3, height, width))
        rays[0], rays[1], rays[2] = x[None, :], y[:, None], focal_px
        rays /= np.sqrt((rays**2).sum(axis=0))
        self._rays = rays.reshape(3, -1)
        # The side of a square of the same solid angle as the pixel's, cos^3(angle) / f^2.
        pixel_deg = np.degrees(self._rays[2] ** 1.5 / focal_px)
        centre_deg = math.degrees(1.0 / focal_px) if detail_deg is None else detail_deg
        levels = int(math.log2(min(height, width)))
        wide = 2.0 ** np.arange(1, levels + 1)[:, None] * pixel_deg
        # Blocks of 2^k pixels where e >= E2 (2^k pixel / detail(0) - 1).
        from_deg = np.clip(e2_deg * (wide / centre_deg - 1.0), 0.0, 180.0)
        self._cosines = np.where(from_deg > 0.0, np.cos(np.radians(from_deg)), 2.0)
        self._cosines[from_deg >= 180.0] = -2.0
        self._cosines = self._cosines.astype(np.float32)
        self._rays = self._rays.astype(np.float32)
        # Where in the pyramid a pixel's block of each level is, and how many pixels blocks have.
        row, column = np.divmod(np.arange(height * width), width)
        places = [row * width + column]
        start, counts = height * width, []
        pixels = np.ones((height, width), dtype=np.uint32)
        for level in range(1, levels + 1):
            pixels = _halve(pixels)
            counts.append(pixels)
            places.append(start + (row >> level) * pixels.shape[1] + (column >> level))
            start += pixels.size
        self._places, self._counts = np.stack(places), counts
        self._ahead = self._indices(np.array([[0.0, 0.0]]))[0]

    def levels(self, gaze_deg: FloatArray) -> NDArray[np.uint8]:
        """(K, H, W) exponent k of the block of each pixel, for gazes (K, 2), right and up."""
        return self._levels(gaze_deg).reshape(-1, *self._size)

    def _levels(self, gaze_deg: FloatArray) -> NDArray[np.uint8]:
        azimuth, elevation = np.radians(gaze_deg).T[:, :, None]
        right, up = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
        ahead = np.cos(azimuth) * np.cos(elevation)
        rays = self._rays
        # Term by term: a matrix product would round differently for other numbers of users.
        cosine = rays[0] * right.astype(np.float32)
        cosine += rays[1] * up.astype(np.float32)
        cosine += rays[2] * ahead.astype(np.float32)
        level = np.zeros(cosine.shape, dtype=np.uint8)
        for from_cosine in self._cosines:
            level += cosine <= from_cosine
        return level

    def _indices(self, gaze_deg: FloatArray) -> NDArray[np.int64]:
        """Return (K, H W) indices of the pixels' values in the pyramid."""
        pixels = self._places.shape[1]
        at = self._levels(gaze_deg).astype(np.int32) * pixels + np.arange(pixels, dtype=np.int32)
        return np.take(self._places, at)

    def look(self, pictures: UInt8Array, gaze_deg: FloatArray | None = None) -> UInt8Array:
        """Return the foveated images.

        Args:
            pictures: (K, C, H, W) uint8; left unchanged.
            gaze_deg: (K, 2) direction of gaze, degrees right and up of the picture's middle; None:
                straight ahead.

        Returns:
            (K, C, H, W) uint8.
        """
        # (K, C, P) the means of all blocks of all levels, rounded.
        lead = pictures.shape[:2]
        parts = [pictures.reshape(*lead, -1)]
        # 16 bits hold the sums of 16 x 16 pixels.
        sums: NDArray[Any] = pictures.astype(np.uint16)
        for level, counts in enumerate(self._counts, start=1):
            sums = _halve(sums.astype(np.uint32) if level == 5 else sums)
            means = (sums + counts // 2) // counts
            parts.append(means.astype(np.uint8).reshape(*lead, -1))
        pyramid = np.concatenate(parts, axis=-1)
        if gaze_deg is None:
            seen = np.take(pyramid, self._ahead, axis=-1)
        else:
            indices = self._indices(np.asarray(gaze_deg, dtype=np.float64))
            seen = np.empty((*pyramid.shape[:2], indices.shape[-1]), dtype=np.uint8)
            for k, row in enumerate(indices):  # several times as quick as take_along_axis
                np.take(pyramid[k], row, axis=-1, out=seen[k], mode="clip")
        return seen.reshape(pictures.shape)


def _halve(sums: NDArray[Any]) -> NDArray[Any]:
    """Sums of blocks of 2 x 2; those at an odd edge have fewer."""
    height, width = sums.shape[-2:]
    if height % 2 or width % 2:
        room = [(0, 0)] * (sums.ndim - 2) + [(0, height % 2), (0, width % 2)]
        sums = np.pad(sums, room)
    rows = sums[..., 0::2, :] + sums[..., 1::2, :]
    halved: NDArray[Any] = rows[..., 0::2] + rows[..., 1::2]
    return halved
