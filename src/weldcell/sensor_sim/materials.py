"""What surfaces do with the laser's light: the materials, and which geom is made of which.

A material is a mixture of a matt share and a mirror-like share. The matt share (`diffuse_albedo`) sends light evenly
(Lambert): paint, and what rough metal scatters from its finest structure or more than once. The rest is a rough
mirror: facets with Gaussian slopes (Beckmann), `slope_roughness` alpha = sqrt(2) times the root-mean-square slope. For
heights with the standard deviation s and a Gaussian autocorrelation of length T that slope is sqrt(2) s / T, so
alpha = 2 s / T. Beckmann rather than GGX: slopes of ground, blasted and etched metal are close to Gaussian (Li and
Torrance, Background data for validation of the He-Torrance model, report PCG-05-02, Cornell 2005), and a Gaussian
light sheet mirrored by Gaussian slopes stays Gaussian, which is what the picture is drawn from. GGX's long tails (a
faint haze far from the mirror direction) are left to the matt share.

Figures. Reflectances at normal incidence follow from n and k near 650 nm, ((n-1)^2 + k^2) / ((n+1)^2 + k^2): iron 2.9
and 3.4 (Johnson and Christy, Phys. Rev. B 9, 1974) 0.56; aluminium 1.5 and 7.8 (Rakic, Appl. Opt. 34, 1995) 0.91;
magnetite 2.4 and 0.6, 0.19. They hardly differ at 450 nm. Heights are those of common finishes: ground Ra 0.8 um, cold
rolled stainless (2B) Ra 0.2, rolled aluminium Ra 0.4, mill scale some um, polished Ra 0.02; lengths T of 5 to 15 um are
reasoned. The matt shares are reasoned too: light that meets the metal twice, and the finest structure; for polished
steel half of the total integrated scatter 1 - exp(-(4 pi s / wavelength)^2) = 14 % (Bennett and Porteus, J. Opt. Soc.
Am. 51, 1961) is taken to go into all directions. Ground and brushed steel reflect differently along and across their
lines; here they are isotropic, with a roughness between.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.configuration import MaterialName
from weldcell.cell.errors import BadGeometry


@dataclass(frozen=True, kw_only=True)
class Material:
    """What a surface does with the laser's light."""

    diffuse_albedo: float
    """Share of the light that is sent back evenly."""
    mirror_share: float
    """Share of the light that meets mirror-like facets; with the albedo at most 1, so that no light is made."""
    mirror_reflectance: float
    """What such a facet reflects at normal incidence."""
    slope_roughness: float
    """Beckmann's alpha: sqrt(2) times the facets' root-mean-square slope."""
    height_sigma_m: float
    """Standard deviation of the surface's height (speckle)."""
    depolarises: bool
    """Whether scattered light has lost its polarisation (speckle): in paint it has, on bare metal not."""

    def __post_init__(self) -> None:
        for name in ("diffuse_albedo", "mirror_share", "mirror_reflectance"):
            if not 0 <= getattr(self, name) <= 1:
                raise BadGeometry(f"material: expected {name} of 0 to 1, found {getattr(self, name)}")
        if self.diffuse_albedo + self.mirror_share > 1 + 1e-12:
            raise BadGeometry(
                f"material: expected diffuse_albedo + mirror_share of 1 at most, "
                f"found {self.diffuse_albedo} + {self.mirror_share}"
            )
        if not (0 < self.slope_roughness <= 1 and 0 <= self.height_sigma_m < 1e-3):
            raise BadGeometry(
                f"material: expected slope_roughness of 0 to 1 and height_sigma_m below 1 mm, "
                f"found {self.slope_roughness}, {self.height_sigma_m}"
            )


def paint(albedo: float) -> Material:
    """Matt paint that sends this share of the light back."""
    return Material(
        diffuse_albedo=albedo,
        mirror_share=0.0,
        mirror_reflectance=0.0,
        slope_roughness=1.0,
        height_sigma_m=10e-6,
        depolarises=True,
    )


MATERIALS: dict[MaterialName, Material] = {
    "matt-white": paint(1.0),
    "mill-scale": Material(
        diffuse_albedo=0.07,
        mirror_share=0.9,
        mirror_reflectance=0.19,
        slope_roughness=0.40,
        height_sigma_m=3e-6,
        depolarises=False,
    ),
    "ground-steel": Material(
        diffuse_albedo=0.15,
        mirror_share=0.80,
        mirror_reflectance=0.56,
        slope_roughness=0.25,
        height_sigma_m=1e-6,
        depolarises=False,
    ),
    "stainless": Material(
        diffuse_albedo=0.08,
        mirror_share=0.90,
        mirror_reflectance=0.58,
        slope_roughness=0.10,
        height_sigma_m=0.25e-6,
        depolarises=False,
    ),
    "aluminium": Material(
        diffuse_albedo=0.15,
        mirror_share=0.80,
        mirror_reflectance=0.91,
        slope_roughness=0.12,
        height_sigma_m=0.5e-6,
        depolarises=False,
    ),
    "polished": Material(
        diffuse_albedo=0.04,
        mirror_share=0.86,
        mirror_reflectance=0.57,
        slope_roughness=0.004,
        height_sigma_m=0.02e-6,
        depolarises=False,
    ),
}
"""Materials by name. Matt white is the perfect diffuser that `SensorConfig.peak_grey` is stated for."""


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Materials of many geoms or points, as arrays; the fields are those of `Material`."""

    diffuse_albedo: Float[np.ndarray, "n"]
    """Share of the light that is sent back evenly."""
    mirror_share: Float[np.ndarray, "n"]
    """Share of the light that meets mirror-like facets."""
    mirror_reflectance: Float[np.ndarray, "n"]
    """What such a facet reflects at normal incidence."""
    slope_roughness: Float[np.ndarray, "n"]
    """Beckmann's alpha."""
    height_sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of the surface's height."""
    depolarises: Bool[np.ndarray, "n"]
    """Whether scattered light has lost its polarisation."""

    def at(self, index: Int[np.ndarray, "m"] | Bool[np.ndarray, "n"]) -> "Surfaces":
        """Those with these indices, or under this mask; for -1 (nothing is there) the last ones, of no meaning."""
        return Surfaces(**{name: value[index] for name, value in vars(self).items()})


def geom_materials(model: mujoco.MjModel) -> Surfaces:
    """The material of each geom of a model.

    A geom is made of what the last part of its MuJoCo material's name says (`v_groove_plate/ground-steel`); any other
    is matt paint, as bright as its colour (and its texture's mean) is grey.
    """
    return surfaces([_geom_material(model, geom) for geom in range(model.ngeom)])


def surfaces(materials: list[Material]) -> Surfaces:
    """Materials as arrays."""
    return Surfaces(**{name: np.array([getattr(m, name) for m in materials]) for name in Surfaces.__dataclass_fields__})


def _geom_material(model: mujoco.MjModel, geom: int) -> Material:
    drawn = int(model.geom_matid[geom])
    if drawn < 0:
        return paint(float(np.clip(model.geom_rgba[geom, :3].mean(), 0, 1)))
    known = MATERIALS.get(model.material(drawn).name.rpartition("/")[2])
    if known is not None:
        return known
    grey = float(model.mat_rgba[drawn, :3].mean()) * _mean_texture(model, drawn)
    return paint(float(np.clip(grey, 0, 1)))


def _mean_texture(model: mujoco.MjModel, drawn: int) -> float:
    """Mean grey (0 to 1) of a MuJoCo material's colour texture; 1 without one."""
    texture = int(model.mat_texid[drawn, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0:
        return 1.0
    first = model.tex_adr[texture]
    count = model.tex_width[texture] * model.tex_height[texture] * model.tex_nchannel[texture]
    return float(model.tex_data[first : first + count].mean() / 255)
