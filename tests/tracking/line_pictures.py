"""Pictures of a laser line as a camera takes them, and the Cramer-Rao bound of its centre: the tests' own generator."""

import numpy as np
from scipy.special import ndtr


def line_shape(centre_px, sigma_px, height_px):
    """Gaussian of height 1 integrated over each pixel; one column for each centre."""
    rows = np.arange(height_px)[:, None]
    upper, lower = (ndtr((rows + half - np.asarray(centre_px)) / sigma_px) for half in (0.5, -0.5))
    return (upper - lower) * sigma_px * np.sqrt(2 * np.pi)


def noisy_line(
    centre_px,
    *,
    height_px=300,
    peak_grey=100.0,
    sigma_px=2.0,
    background=18.0,
    read_grey=0.5,
    electrons_per_grey=41.0,
    speckle=1.0,
    most=255,
    rng,
):
    """The picture (8 bits, or 16 if `most` is larger) with read noise and, if electrons are finite, photon noise."""
    grey = background + peak_grey * line_shape(centre_px, sigma_px, height_px) * speckle
    noise = np.sqrt(read_grey**2 + grey / electrons_per_grey) * rng.standard_normal(grey.shape)
    return np.clip(np.rint(grey + noise), 0, most).astype(np.uint8 if most < 256 else np.uint16)


def centre_bound_px(
    centre_px, *, height_px=300, peak_grey=100.0, sigma_px=2.0, background=18.0, read_grey=0.5, electrons_per_grey=41.0
):
    """Least standard deviation of an unbiased centre (Cramer-Rao), amplitude, width and background unknown.

    The Fisher information of the four is sum_k dI_k dI_k' / var_k; the bound is from its inverse's first element. The
    rounding to whole grey levels counts as noise of variance 1/12.
    """
    step = 1e-4
    shape = line_shape(centre_px, sigma_px, height_px)
    by_centre = line_shape(np.asarray(centre_px) + step, sigma_px, height_px)
    by_centre = peak_grey * (by_centre - line_shape(np.asarray(centre_px) - step, sigma_px, height_px)) / (2 * step)
    by_width = line_shape(centre_px, sigma_px + step, height_px) - line_shape(centre_px, sigma_px - step, height_px)
    slopes = np.stack([by_centre, shape, peak_grey * by_width / (2 * step), np.ones_like(shape)])
    variance = read_grey**2 + 1 / 12 + (background + peak_grey * shape) / electrons_per_grey
    information = np.einsum("ivc,jvc,vc->cij", slopes, slopes, 1 / variance)
    return np.sqrt(np.linalg.inv(information)[:, 0, 0])


def grained_speckle(shape, contrast, grain_px, rng):
    """Factors of mean 1 and this contrast: sums of squared normal fields that are correlated over the grain."""
    looks = round(1 / contrast**2)
    kernel = np.exp(-((np.arange(-6, 7) / grain_px) ** 2))
    kernel /= np.sqrt(np.sum(kernel**2))
    total = np.zeros(shape)
    for _ in range(2 * looks):
        field = rng.standard_normal((shape[0] + 12, shape[1] + 12))
        field = np.apply_along_axis(np.convolve, 0, field, kernel, "valid")
        total += np.apply_along_axis(np.convolve, 1, field, kernel, "valid") ** 2
    return total / (2 * looks)
