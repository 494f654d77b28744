"""How much lens and pixel blur each point of the scene: diffraction, defocus on a tilted picture plane, pixel box.

Thin lens. A lens of focal length f sends a point at the depth z, along the straight ray through its centre, to the
depth z' behind it with 1/z' = 1/f - 1/z. Focused at D with the picture at the principal distance c, 1/f = 1/c + 1/D.
The cone of light from the aperture of diameter A = f/N to that image leaves on a picture at the depth p a disc of
diameter A |p - z'| / z', which from the lens's centre is seen under an angle with the tangent

    A |1/z' - 1/p| = A |1/D - 1/z + 1/c - 1/p|,

which on a picture without tilt (p = c) is the textbook's blur circle A f |z - D| / (z (D - f)). On a tilted one p goes
with the pixel (`CameraModel.picture_depth`). To first order the disc stays one: left out are its stretch on the tilted
picture by 1/cos(tilt) (2 % at 10 deg), the picture's slope through the cone (3 % of a blur of 12 px) and what
distortion does to the disc. A uniform disc of diameter d has the standard deviation d/4 along any direction.

Diffraction. The Airy disc as a Gaussian has sigma 0.42 lambda N (Zhang, Zerubia, Olivo-Marin, Applied Optics 46, 2007),
with the working f-number c/A = N (1 + c/D) of a close object. A pixel of width 1 has the variance 1/12. Variances of
independent blurs add.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel

_PIXEL_VARIANCE = 1 / 12


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A thin lens in front of a picture."""

    principal_m: float
    """From the lens to the picture along the axis (c)."""
    focus_m: float
    """Depth that is in focus on the axis (D)."""
    aperture_m: float
    """Diameter of the opening."""
    airy_sigma_px: float
    """Standard deviation of the blur by diffraction."""

    @property
    def sharpest_sigma_px(self) -> float:
        """Standard deviation of the blur of what is in focus."""
        return float(np.sqrt(self.airy_sigma_px**2 + _PIXEL_VARIANCE))

    def blur_sigma_px(
        self, points_camera: Float[np.ndarray, "n 3"], pixels: Float[np.ndarray, "n 2"], camera: CameraModel
    ) -> Float[np.ndarray, "n"]:
        """Standard deviation of the blur of points (m) whose images lie at these pixels."""
        vergence = 1 / self.focus_m - 1 / points_camera[:, 2]
        vergence += (1 - 1 / camera.picture_depth(pixels)) / self.principal_m
        defocus_px = self.aperture_m / 4 * np.mean(camera.focal_px) * vergence
        return np.sqrt(defocus_px**2 + self.airy_sigma_px**2 + _PIXEL_VARIANCE)


def lens(config: SensorConfig) -> Lens:
    """The lens of a sensor; its own focal length is c D / (c + D)."""
    principal_mm, focus_mm = config.focal_mm, config.focus_mm or config.working_distance_mm
    aperture_mm = principal_mm * focus_mm / (principal_mm + focus_mm) / config.f_number
    airy_mm = 0.42 * config.wavelength_nm * 1e-6 * principal_mm / aperture_mm
    return Lens(
        principal_m=principal_mm * 1e-3,
        focus_m=focus_mm * 1e-3,
        aperture_m=aperture_mm * 1e-3,
        airy_sigma_px=airy_mm / (config.pixel_um * 1e-3),
    )
