"""The scene in the cell's light, rendered by MuJoCo as the sensor's camera sees it.

The only module that knows that MuJoCo's camera axes (x right, y up, z back) differ from OpenCV's.

The view is set in MuJoCo's drawn scene, not in the model: the model needs no camera, and the pose and intrinsics of the
actual camera can differ from anything that was compiled.

Rendered in software, time goes into filling pixels, so geoms out of view are left out and small ones are drawn first:
what they hide of the large ones behind is then never shaded. Leaving out changes no bit of the picture; the order is
fixed by the model, and compared with any other order it may round some pixels by one level of 255.
"""

import copy
import os
import sys
import weakref
from types import TracebackType

import cv2
import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry, NotReady
from weldcell.cell.optics import CameraModel
from weldcell.opengl import OPENGL_HELP

_NEAR_M, _FAR_M = 0.01, 20.0
_KNOT_SPACING_PX = 16  # of the lens's map; cubic splines between are right to 1e-6 px
_HEAD_GROUP = 3
_LEFT_OUT_GROUP = mujoco.mjNGROUP - 1
_BOXED = tuple(
    getattr(mujoco.mjtGeom, f"mjGEOM_{kind}").value
    for kind in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
"""Kinds of geoms that lie within their bounding boxes; planes have none."""
_BOX_MARGIN = 1e-4  # of the box, and metres: a tenth of a pixel's view is 1e-5 m
_MOST_GEOMS = 10_000  # mujoco.Renderer's own limit
_LARGEST_PX = 16_384  # what OpenGL drivers offer; a picture this large means a distortion gone wild


class AmbientRenderer:
    """Renders grey pictures of a model as it was when the renderer was made; use it in a `with` block."""

    def __init__(
        self, model: mujoco.MjModel, camera: CameraModel, white_grey: float, blur_sigma_px: float = 0.0
    ) -> None:
        """`white_grey` is the grey level of what MuJoCo renders as full white, `blur_sigma_px` the lens's blur.

        One blur for all that is in view: depth of field is left out.

        Raises NotReady, naming the missing packages, where there is no OpenGL.
        """
        self._model = copy.copy(model)  # whose geom groups say what is drawn when
        self._layers = _layers(model)
        self._white_grey, self._blur_sigma_px = white_grey, blur_sigma_px
        self._pinhole, self._warp = _lens(camera)
        self._scene = mujoco.MjvScene(model, maxgeom=_MOST_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = 0
        self._shown = model.geom_group < _HEAD_GROUP  # as MuJoCo draws by default, without the sensor's head
        self._rgb = np.empty((self._pinhole.height_px, self._pinhole.width_px, 3), np.uint8)
        graphics = _open_graphics(self._model, self._pinhole.width_px, self._pinhole.height_px)
        self._gl_context, self._buffers = graphics
        self._finalizer = weakref.finalize(self, _close_graphics, *graphics)
        self._finalizer.atexit = False  # at exit the driver may be gone already; the process frees all

    def __enter__(self) -> "AmbientRenderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the graphics memory; a second call does nothing."""
        self._finalizer()

    def render(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> Float[np.ndarray, "height width"]:
        """Grey levels (float32) of the scene seen from `T_base_camera`, distorted by the lens.

        `data` needs up-to-date kinematics, and lights (mj_camlight) if the model has lights of its own.
        """
        if not self._finalizer.alive:
            raise NotReady("ambient picture: the renderer is closed")
        self._look(data, T_base_camera)
        self._gl_context.make_current()
        whole = mujoco.MjrRect(0, 0, self._pinhole.width_px, self._pinhole.height_px)
        mujoco.mjr_render(whole, self._scene, self._buffers)
        mujoco.mjr_readPixels(self._rgb, None, whole, self._buffers)
        grey = cv2.cvtColor(self._rgb, cv2.COLOR_RGB2GRAY)
        distorted = cv2.remap(grey, *self._warp, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        levels = distorted * np.float32(self._white_grey / 255)
        if self._blur_sigma_px > 0:  # after the product: rounded to whole levels, the blur would leave steps
            cv2.GaussianBlur(levels, (0, 0), self._blur_sigma_px, dst=levels)
        return levels

    def _look(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> None:
        """Draw the scene with the view at the camera.

        A free camera first, which places the headlight and endless planes; it cannot roll or look off-centre, so the
        exact view replaces it.
        """
        centre_base, R_base_camera = T_base_camera.translation, T_base_camera.rotation.as_matrix()
        _, down_base, forward_base = R_base_camera.T
        free = mujoco.MjvCamera()
        free.type = mujoco.mjtCamera.mjCAMERA_FREE
        free.distance = 1.0
        free.lookat = centre_base + forward_base
        free.azimuth = np.rad2deg(np.arctan2(forward_base[1], forward_base[0]))
        free.elevation = np.rad2deg(np.arcsin(np.clip(forward_base[2], -1, 1)))
        self._draw(data, free, _in_view(self._model, data, centre_base, R_base_camera, self._pinhole))
        left, right, bottom, top = _frustum(self._pinhole)
        for view in self._scene.camera:  # left and right eye
            view.pos, view.forward, view.up = centre_base, forward_base, -down_base
            view.frustum_near, view.frustum_far = _NEAR_M, _FAR_M
            view.frustum_bottom, view.frustum_top = bottom, top
            view.frustum_center, view.frustum_width = ((left + right) / 2, (right - left) / 2)  # half the width

    def _draw(self, data: mujoco.MjData, free: mujoco.MjvCamera, in_view: Bool[np.ndarray, "geoms"]) -> None:
        """Fill the drawn scene, geoms layer by layer."""
        self._model.geom_group[:] = np.where(in_view & self._shown, self._layers, _LEFT_OUT_GROUP)
        everything, options = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjvOption()
        options.geomgroup[:] = np.arange(mujoco.mjNGROUP) == 0
        mujoco.mjv_updateScene(self._model, data, options, None, free, everything, self._scene)
        for others in ("site", "joint", "tendon", "actuator", "skin", "flex"):
            getattr(options, f"{others}group")[:] = 0  # once is enough
        for layer in range(1, _LEFT_OUT_GROUP):
            options.geomgroup[:] = np.arange(mujoco.mjNGROUP) == layer
            mujoco.mjv_addGeoms(self._model, data, options, mujoco.MjvPerturb(), everything, self._scene)


def _layers(model: mujoco.MjModel) -> Int[np.ndarray, "geoms"]:
    """Which geoms are drawn when: small ones, which stand in front, before large ones, and endless ones last."""
    endless = ~np.isin(model.geom_type, _BOXED)
    rank = np.argsort(np.argsort(np.where(endless, np.inf, model.geom_rbound), kind="stable"))
    last = _LEFT_OUT_GROUP - 1
    return np.where(endless, last, np.minimum(rank * last // max(int((~endless).sum()), 1), last - 1))


def _in_view(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    centre_base: Float[np.ndarray, "3"],
    R_base_camera: Float[np.ndarray, "3 3"],
    pinhole: CameraModel,
) -> Bool[np.ndarray, "geoms"]:
    """Whether a geom's bounding box may reach into the picture: it is not wholly beyond one of the picture's sides."""
    left, right, bottom, top = (side / _NEAR_M for side in _frustum(pinhole))
    inward_camera = np.array([[1, 0, -left], [-1, 0, right], [0, 1, top], [0, -1, -bottom], [0, 0, 1]])
    inward_base = inward_camera @ R_base_camera.T
    R_base_geom = data.geom_xmat.reshape(-1, 3, 3)
    box_centre = data.geom_xpos + np.einsum("nij,nj->ni", R_base_geom, model.geom_aabb[:, :3]) - centre_base
    half_sizes = model.geom_aabb[:, 3:] * (1 + _BOX_MARGIN) + _BOX_MARGIN
    reach = np.einsum("pi,nij,nj->pnj", inward_base, R_base_geom, half_sizes)
    farthest_in = inward_base @ box_centre.T + np.abs(reach).sum(axis=2)
    return np.all(farthest_in >= 0, axis=0) | ~np.isin(model.geom_type, _BOXED)


def _frustum(pinhole: CameraModel) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the picture on the near plane (m), with OpenGL's y up.

    Pixel (0, 0) is a pixel's centre, so the picture reaches from -0.5 to width - 0.5.
    """
    (fx, fy), (cx, cy) = pinhole.focal_px, pinhole.principal_px
    left, right = (-0.5 - cx) / fx, (pinhole.width_px - 0.5 - cx) / fx
    top, bottom = (cy + 0.5) / fy, (cy + 0.5 - pinhole.height_px) / fy
    return tuple(float(_NEAR_M * side) for side in (left, right, bottom, top))  # type: ignore[return-value]


def _lens(camera: CameraModel) -> tuple[CameraModel, tuple[np.ndarray, np.ndarray]]:
    """A pinhole camera that sees all that the lens sees, and cv2.remap's maps from its picture to the lens's."""
    u_knots, v_knots = (
        np.linspace(-0.5, size - 0.5, size // _KNOT_SPACING_PX + 4) for size in (camera.width_px, camera.height_px)
    )
    knots = np.stack(np.meshgrid(u_knots, v_knots), axis=-1)
    pixels = camera.unproject(knots)[..., :2] * camera.focal_px + camera.principal_px
    if not np.all(np.isfinite(pixels)):
        raise BadGeometry("camera: the lens distortion cannot be inverted over the whole picture")
    low = np.floor(pixels.min(axis=(0, 1))) - 1
    width_px, height_px = (np.ceil(pixels.max(axis=(0, 1))) - low + 2).astype(int)
    if max(width_px, height_px) > _LARGEST_PX:
        raise BadGeometry(f"camera: lens distortion needs a picture of {width_px}x{height_px} pixels to cover its view")
    pinhole = CameraModel(
        width_px=int(width_px),
        height_px=int(height_px),
        focal_px=camera.focal_px,
        principal_px=camera.principal_px - low,
    )
    columns, rows = (
        RectBivariateSpline(v_knots, u_knots, pixels[..., axis] - low[axis])(
            np.arange(camera.height_px), np.arange(camera.width_px)
        )
        for axis in (0, 1)
    )
    rows = height_px - 1 - rows  # OpenGL's pictures start at the bottom row
    return pinhole, cv2.convertMaps(columns.astype(np.float32), rows.astype(np.float32), cv2.CV_16SC2)


def _open_graphics(model: mujoco.MjModel, width_px: int, height_px: int) -> tuple[mujoco.GLContext, mujoco.MjrContext]:
    """An off-screen context without multisampling and shadows, which is set in the model: let it be a copy.

    Set for a moment in a model that two threads share, one of them would undo it for the other.

    Not mujoco.Renderer: it takes the platform that was chosen when mujoco was first imported, and one without a screen
    ends the process.
    """
    quality, buffer = model.vis.quality, model.vis.global_
    quality.offsamples, quality.shadowsize, buffer.offwidth, buffer.offheight = (0, 0, width_px, height_px)
    try:
        gl_context = _context_class()(width_px, height_px)
        gl_context.make_current()
        buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    except (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError) as error:
        raise NotReady(OPENGL_HELP.format(cause=str(error) or type(error).__name__)) from error
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return gl_context, buffers


def _context_class() -> type[mujoco.GLContext]:
    """EGL, which needs no screen, unless MUJOCO_GL asks for another platform."""
    if sys.platform == "linux" and os.environ.get("MUJOCO_GL", "egl").lower() == "egl":
        from mujoco.egl import GLContext  # not at the top: it fails where EGL is missing

        return GLContext
    return mujoco.GLContext


def _close_graphics(gl_context: mujoco.GLContext, buffers: mujoco.MjrContext) -> None:
    gl_context.make_current()
    buffers.free()
    gl_context.free()
