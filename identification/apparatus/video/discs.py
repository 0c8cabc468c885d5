"""Find discs of a known radius in a picture, by a circular Hough transform of the directions of the gradient.

Around the edge of a dark disc on a bright ground all gradients point away from its centre. The response at a pixel is
the mean outward component of the directions on a circle around it. Its maximum is 1, independent of the contrast.

Sources: Ballard, Pattern Recognition 13 (1981) 111; Loy & Zelinsky, IEEE PAMI 25 (2003) 959.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter, maximum_filter

#: Gradient with weight 1/2 [grey levels of 255 per pixel]: noise has smaller gradients, edges of bobs larger ones.
_FAINT = 2.5


@dataclass(frozen=True, eq=False)
class Discs:
    """Peaks of the response: places (M, 2) as (x, y) [pixels], and responses (M,), in descending order."""

    places: np.ndarray
    responses: np.ndarray


def reduced(picture: np.ndarray, factor: int) -> np.ndarray:
    """Average blocks of `factor` × `factor` pixels; float32."""
    height, width = (size // factor * factor for size in picture.shape)
    blocks = picture[:height, :width].reshape(height // factor, factor, width // factor, factor)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def directions(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the gradient g: x and y components of vectors of length |g|/(|g| + _FAINT)."""
    smooth = gaussian_filter(np.asarray(picture, np.float32), 1.0)
    along_y, along_x = np.gradient(smooth)
    size = np.hypot(along_x, along_y)
    shorter = 1.0 / (size + _FAINT)
    return along_x * shorter, along_y * shorter


def response(direction: tuple[np.ndarray, np.ndarray], radius: float) -> np.ndarray:
    """Compute the response to dark discs of a radius [pixels] at each pixel, (H, W); negative for bright discs."""
    shape = direction[0].shape
    size = tuple(fft.next_fast_len(n + 2 * int(radius + 4), real=True) for n in shape)
    kernel_x, kernel_y = _kernels(round(radius, 3), size)
    spectra = [np.asarray(fft.rfft2(component, size)) for component in direction]
    product = spectra[0] * kernel_x + spectra[1] * kernel_y
    return np.asarray(fft.irfft2(product, size))[: shape[0], : shape[1]]


@functools.lru_cache(maxsize=64)
def _kernels(radius: float, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Fourier transforms of the kernels that correlate the components with a ring."""
    y = fft.fftfreq(size[0], 1.0 / size[0])[:, None]
    x = fft.fftfreq(size[1], 1.0 / size[1])[None, :]
    distance = np.hypot(x, y)
    ring = np.exp(-0.5 * ((distance - radius) / 1.0) ** 2)
    ring /= ring.sum()
    outward = ring / np.maximum(distance, 1e-9)
    kernel_x, kernel_y = (np.conj(np.asarray(fft.rfft2((outward * along).astype(np.float32)))) for along in (x, y))
    return kernel_x, kernel_y


def peaks(found: np.ndarray, radius: float, least: float, most: int) -> Discs:
    """Find the highest peaks of a response.

    Peaks are at least 0.7 radii apart. Their places are accurate to about a tenth of a pixel.
    """
    reach = max(int(0.7 * radius), 1)
    top = (found == maximum_filter(found, 2 * reach + 1)) & (found >= least)
    top[[0, -1]] = top[:, [0, -1]] = False
    rows, columns = np.nonzero(top)
    order = np.argsort(-found[rows, columns])[:most]
    rows, columns = rows[order], columns[order]
    here = found[rows, columns]
    places = np.stack(
        [
            columns + vertex(found[rows, columns - 1], here, found[rows, columns + 1]),
            rows + vertex(found[rows - 1, columns], here, found[rows + 1, columns]),
        ],
        axis=-1,
    )
    return Discs(places, here)


def vertex(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Position of the maximum of a parabola through three equidistant values, in steps from the middle one."""
    return np.clip(0.5 * (before - after) / np.minimum(before - 2.0 * here + after, -1e-9), -0.5, 0.5)
