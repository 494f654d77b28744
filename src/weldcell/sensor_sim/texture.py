"""How the texture of parts changes the laser's stripe: read from the compiled model, looked up at lit points.

The picture and its place on the part (`models.surface_texture`) are in the model: the MuJoCo material's texture, which
the rendered picture shows too, and a custom number of the material's name with the box and the pixel's size.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Float, Int

from weldcell.models.surface_texture import SurfaceTexture


class SceneTextures:
    """The textures of a model's geoms."""

    def __init__(self, model: mujoco.MjModel) -> None:
        numbers = {model.numeric(k).name: np.array(model.numeric(k).data) for k in range(model.nnumeric)}
        self._body_id = model.geom_bodyid.copy()
        self._textures: dict[int, SurfaceTexture] = {}
        for geom in np.flatnonzero(model.geom_matid >= 0):
            drawn = int(model.geom_matid[geom])
            texture = int(model.mat_texid[drawn, mujoco.mjtTextureRole.mjTEXROLE_RGB])
            box = numbers.get(model.material(drawn).name)
            if texture >= 0 and box is not None:
                self._textures[int(geom)] = SurfaceTexture(
                    grey=_grey(model, texture), low_part=box[:3], high_part=box[3:6], texel_m=float(box[6])
                )

    def factor(
        self,
        data: mujoco.MjData,
        points_base: Float[np.ndarray, "n 3"],
        normals_base: Float[np.ndarray, "n 3"],
        geom_id: Int[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n"]:
        """Brightness of surface points (m) relative to the plain material; 1 where the geom has no texture."""
        factor = np.ones(len(geom_id))
        for texture, here, places_px in self.places(data, points_base, normals_base, geom_id):
            factor[here] = texture.brightness(places_px)
        return factor

    def places(
        self,
        data: mujoco.MjData,
        points_base: Float[np.ndarray, "n 3"],
        normals_base: Float[np.ndarray, "n 3"],
        geom_id: Int[np.ndarray, "n"],
    ) -> Iterator[tuple[SurfaceTexture, Int[np.ndarray, "k"], Float[np.ndarray, "k 2"]]]:
        """Each texture with the indices of the points that lie on it and their places in it."""
        for geom, texture in self._textures.items():
            here = np.flatnonzero(geom_id == geom)
            if len(here) == 0:
                continue
            body = self._body_id[geom]  # the part's frame is its body's; the geom's is moved to the mesh's middle
            R_base_part = data.xmat[body].reshape(3, 3)
            points_part = (points_base[here] - data.xpos[body]) @ R_base_part
            yield texture, here, texture.places_px(points_part, normals_base[here] @ R_base_part)


def _grey(model: mujoco.MjModel, texture: int) -> np.ndarray:
    rows, columns, channels = model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture]
    first = model.tex_adr[texture]
    return model.tex_data[first : first + rows * columns * channels].reshape(rows, columns, channels)[..., 0].copy()
